"""Looks at one job: everything that the decision needs, and what has to be there for it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import datetime

from bagpipe.spec import DEFAULT_BACKOFF_LIMIT
from bagpipe_operator.api import names, readings, reasons
from bagpipe_operator.cluster.client import Api, ApiError
from bagpipe_operator.jobs.claim import is_asked_for, taken
from bagpipe_operator.jobs.driver.ending import Ending, ending_of, has_ended, lost_driver, refused
from bagpipe_operator.jobs.driver.lookup import DriverLookup
from bagpipe_operator.jobs.driver.progress import Progress
from bagpipe_operator.jobs.driver.rounds import serves
from bagpipe_operator.jobs.driver_start import DriverStart
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.kueue.queueing import Queueing
from bagpipe_operator.jobs.observation import Halt, Observation
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.pods.job_config import UnusableSpecError
from bagpipe_operator.jobs.pods.pinned import followed_schedule, pinned_baseline
from bagpipe_operator.jobs.pods.refusal import Refusal
from bagpipe_operator.jobs.policies.halt import halt_as_seen, halt_of
from bagpipe_operator.jobs.policies.last_passed import CannotCompareError, find_last_passed
from bagpipe_operator.jobs.policies.places import living
from bagpipe_operator.jobs.policies.replacement import pausing
from bagpipe_operator.jobs.policies.resume import CannotResumeError, find_earlier
from bagpipe_operator.jobs.policies.stuck import fatal
from bagpipe_operator.jobs.policies.suspend import is_reported
from bagpipe_operator.jobs.troubles.diagnose import troubles
from bagpipe_operator.jobs.troubles.lookout import Lookout
from bagpipe_operator.jobs.view import View
from bagpipe_operator.jobs.warm_start import WarmStarts
from bagpipe_operator.runtime.patience import Patience
from bagpipe_operator.settings import Settings


@dataclass
class Observer:
    """One per operator; every method that asks raises ApiError."""

    api: Api
    view: View
    settings: Settings
    now: Callable[[], datetime]
    monotonic: Callable[[], float]
    queueing: Queueing | None
    warm: WarmStarts
    lookup: DriverLookup
    starts: DriverStart
    _patience: Patience = field(default_factory=Patience)
    # By job: the attempt whose pod has confirmed an end that is not written yet, and that end.
    _confirmed: dict[str, tuple[int, Ending]] = field(default_factory=dict)
    _lookout: Lookout = field(init=False)

    def __post_init__(self) -> None:
        self._lookout = Lookout(self.api, self.settings, self.monotonic)

    async def observe(self, job: JobView) -> Observation:
        """Everything that the decision needs; creates the children if they were never there."""
        seen = await self._observe(job)
        return replace(seen, kueue=self.queueing is not None)

    async def was_behind(self, seen: Observation) -> bool:
        """Whether the pod whose trouble is about to end the job is another by now, or gone."""
        trouble = fatal(seen, self.settings.stuck_seconds)
        if trouble is None or seen.ending is not None or seen.halt is not None:
            return False
        pods = self.view.pods(seen.job.uid)
        pod = next((pod for pod in pods if pod.name == trouble.pod), None)
        if pod is None:
            return False
        live = await self.lookup.refreshed(pod)
        return live is None or replace(live, resource_version=pod.resource_version) != pod

    def forget(self, uid: str) -> None:
        """Of a job that has ended, rests or is gone nothing is kept."""
        self._patience.forget(uid)
        self._lookout.forget(uid)
        self._confirmed.pop(uid, None)

    async def _observe(self, job: JobView) -> Observation:
        halt = halt_of(job, self.now())
        if halt is None and self.queueing is not None:
            halt = await self.queueing.halt(job)
        attempt = int(job.status.get("attempt") or 1)
        if halt is None and job.suspended:
            return Observation(job, attempt)  # the status first states that there may be pods again
        if halt is None and (looked_up := await self._looked_up(job, attempt)) is not None:
            return looked_up
        driver = self.view.driver(job.uid, attempt)
        refusal: Refusal | None = None
        ending: Ending | None = None
        if driver is None and (_has_driver(job) or (halt and not is_reported(job))):
            driver, ending = await self.lookup.look_for(job, attempt, at_once=halt is not None)
        elif driver is None and halt is None and self._may_start(job):
            driver, refusal, ending = await self.starts.start(job, attempt)
        if driver is not None:
            seen, driver = driver, await self.lookup.refreshed_if_silent(driver)
            if driver is None:
                ending = lost_driver(job.namespace, seen.name, seen)
        progress = None
        if driver is not None:
            ending = ending_of(driver, self.now())
            if ending is None and serves(driver):
                driver, progress, ending = await self._reported(driver)
        ending = await self._excused(job, self._as_confirmed(job, attempt, ending))
        running = driver is not None and ending is None and serves(driver)
        account = ending.progress if ending else progress
        halt = halt_as_seen(halt, job, running, account, self.now())
        return await self._observation(job, attempt, driver, progress, refusal, ending, halt)

    async def _reported(
        self, driver: PodView
    ) -> tuple[PodView | None, Progress | None, Ending | None]:
        """The account of a driver that serves it, or the end that it reports.

        That counts where its pod is there: else another may have its address, and have answered.
        """
        progress = await self.lookup.account_of(driver)
        ending = has_ended(progress, driver.job_uid, driver.attempt)
        if ending is None:
            return driver, progress, None
        live = await self.lookup.refreshed(driver)
        if live is None:
            return None, None, lost_driver(driver.namespace, driver.name, driver)
        shown = ending_of(live, self.now())
        if shown is None and serves(live) and live.ip == driver.ip:
            self._confirmed[driver.job_uid] = (driver.attempt, ending)
            return live, progress, ending
        return live, None, shown

    def _as_confirmed(self, job: JobView, attempt: int, ending: Ending | None) -> Ending | None:
        """The end that the attempt's pod has confirmed, whatever became of the pod since: it is
        chance whether it is evicted, killed or deleted before that end is written, or after."""
        of, confirmed = self._confirmed.get(job.uid, (0, None))
        if confirmed is None or of != attempt:
            return ending
        return confirmed if ending is None or ending.lost else ending

    async def _excused(self, job: JobView, ending: Ending | None) -> Ending | None:
        """Not counted where the job that this one's pods were made for was deleted, and they with
        it; in the foreground it is there until they are gone."""
        claim = taken(job.status)
        if ending is None or not ending.lost or claim is None:
            return ending
        try:
            home = JobView.from_object(await self.api.get_job(job.namespace, claim.job))
        except ApiError as error:
            if not error.is_gone(claim.job):
                raise
            return replace(ending, voluntary=True)
        stays = home.uid == claim.uid and not home.deleting
        return ending if stays else replace(ending, voluntary=True)

    def _may_start(self, job: JobView) -> bool:
        return not pausing(job, self.now()) and not is_asked_for(job.status)

    async def _looked_up(self, job: JobView, attempt: int) -> Observation | None:
        """The earlier jobs that this one depends on, one at a time; None when they are written."""
        if resumes(job):
            return await self._resumed(job, attempt)
        if follows(job):
            return await self._compared(job, attempt)
        return None

    async def _resumed(self, job: JobView, attempt: int) -> Observation:
        """Where to go on from; it is written before there is a driver, since the old job may go."""
        try:
            earlier = await find_earlier(self.api, *await self.starts.read(job))
        except UnusableSpecError as error:
            return Observation(job, attempt, ending=refused(reasons.SPEC_INVALID, error))
        except CannotResumeError as error:
            return Observation(job, attempt, ending=refused(reasons.RESUME_REFUSED, error))
        return Observation(job, attempt, resumed_from=earlier)

    async def _compared(self, job: JobView, attempt: int) -> Observation:
        """With what; it is written before there is a driver, so that all of them go by it."""
        try:
            return Observation(job, attempt, baseline=await find_last_passed(self.api, job))
        except CannotCompareError as error:
            return Observation(job, attempt, ending=refused(reasons.BASELINE_REFUSED, error))

    async def _observation(
        self,
        job: JobView,
        attempt: int,
        driver: PodView | None,
        progress: Progress | None,
        refusal: Refusal | None,
        ending: Ending | None,
        halt: Halt | None,
    ) -> Observation:
        all_pods = self.view.pods(job.uid)
        pods = self.view.pods_of(job.uid, attempt)
        gone = [pod for pod in self.view.gone_pods(job.uid) if pod.attempt == attempt]
        wanting = progress is not None and progress.phase == "Running" and halt is None
        left = progress.cases.left if progress is not None and wanting else None
        # Why pods wait that are to go is nobody's question, and the answer may take a while.
        looked_up = () if halt else await self._lookout.look(job, attempt, pods, left)
        found = tuple(troubles(pods, self.now(), gone, looked_up))
        wants = {t.reason for t in found} | ({refusal.reason} if refusal else set())
        on_nodes = any(pod.unschedulable for pod in pods)
        self.warm.note_room(job, reasons.QUOTA_EXCEEDED in wants, on_nodes)
        keys = [t.key for t in found] + ([refusal.key] if refusal else [])
        seen_for = self._patience.observe(job.uid, keys, self.monotonic())
        return Observation(
            job=job,
            attempt=attempt,
            driver=driver,
            executors=tuple(pod for pod in pods if pod.role == names.ROLE_EXECUTOR),
            progress=progress,
            refusal=refusal,
            troubles=found,
            seen_for=seen_for,
            refused_for=seen_for.get(refusal.key, 0.0) if refusal else 0.0,
            ending=ending,
            backoff_limit=_backoff_limit(job),
            halt=halt,
            alive=living(all_pods, self.now()),
        )


def resumes(job: JobView) -> bool:
    """Whether it is still to be written from which job this one goes on."""
    return bool(job.spec.get("resumeFrom")) and not job.status.get("resumedFrom")


def follows(job: JobView) -> bool:
    """Whether it is still to be written with which job this one is compared."""
    return bool(followed_schedule(job)) and pinned_baseline(job) is None


def _has_driver(job: JobView) -> bool:
    """Whether a driver's pod must be there, in sight or not: its own, or the one that took it."""
    return bool(job.status.get("driver")) or taken(job.status) is not None


def _backoff_limit(job: JobView) -> int:
    """The API server writes the default; a job of an older CRD has none."""
    limit = readings.whole(job.spec.get("backoffLimit"))
    return DEFAULT_BACKOFF_LIMIT if limit is None else limit
