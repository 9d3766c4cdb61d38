"""The loop's body: look at one job, decide, write its status once, report what changed.

Level-triggered: it is right whenever and however often it is called.
"""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Protocol

from bagpipe.spec import DEFAULT_BACKOFF_LIMIT, SimulationJobSpec
from bagpipe_operator.api import names, readings, reasons
from bagpipe_operator.api.objects import Json
from bagpipe_operator.api.pool_driver import own_driver_in_pool
from bagpipe_operator.cluster.client import Api, ApiError, get_if_there
from bagpipe_operator.cluster.lent_pods import may_lend_pods
from bagpipe_operator.jobs import transitions
from bagpipe_operator.jobs.announcer import Announcer
from bagpipe_operator.jobs.claim import driver_name, is_asked_for, taken
from bagpipe_operator.jobs.driver.ending import Ending, ending_of, has_ended, lost_driver
from bagpipe_operator.jobs.driver.progress import Progress
from bagpipe_operator.jobs.driver.rounds import Rounds, serves
from bagpipe_operator.jobs.event_recorder import EventRecorder
from bagpipe_operator.jobs.kueue.queueing import Queueing
from bagpipe_operator.jobs.observation import Halt, Observation
from bagpipe_operator.jobs.pods.children import create_children
from bagpipe_operator.jobs.pods.job_config import JobTooLargeError, UnusableSpecError, read_spec
from bagpipe_operator.jobs.pods.pinned import followed_schedule, pinned_baseline
from bagpipe_operator.jobs.pods.refusal import Refusal
from bagpipe_operator.jobs.policies.halt import halt_as_seen, halt_of
from bagpipe_operator.jobs.policies.last_passed import (
    CannotCompareError,
    Handover,
    find_last_passed,
)
from bagpipe_operator.jobs.policies.places import living, needs_stop
from bagpipe_operator.jobs.policies.replacement import pausing
from bagpipe_operator.jobs.policies.resume import CannotResumeError, find_earlier
from bagpipe_operator.jobs.policies.stuck import fatal
from bagpipe_operator.jobs.policies.suspend import is_reported
from bagpipe_operator.jobs.policies.ttl import expired
from bagpipe_operator.jobs.policies.urgency import is_urgent
from bagpipe_operator.jobs.status import acknowledged, decide
from bagpipe_operator.jobs.troubles.diagnose import troubles
from bagpipe_operator.jobs.troubles.lookout import Lookout
from bagpipe_operator.jobs.troubles.refusals import Refusals
from bagpipe_operator.jobs.view import JobView, PodView, View
from bagpipe_operator.jobs.warm_start import (
    NoOffers,
    Offers,
    WarmStarts,
    Working,
)
from bagpipe_operator.jobs.whole_job import whole
from bagpipe_operator.runtime.clock import utc_now
from bagpipe_operator.runtime.patience import Patience
from bagpipe_operator.runtime.write_pace import WritePace
from bagpipe_operator.settings import Settings

logger = logging.getLogger(__name__)

# A driver that has been silent for this long is looked for: the watch may have lost its end.
SILENT_DRIVER_SECONDS = 30.0
# How often a status may change in one visit while a driver is asked whether it takes the job.
_MOST_ASKED = 3


class Drivers(Working, Protocol):
    """Who asks drivers for their progress; each is known by its pod's UID."""

    async def read(self, uid: str, ip: str, whose: tuple[str, int]) -> Progress | None:
        """The last account of the driver of a job's (UID's) attempt."""

    def silent_seconds(self, uid: str) -> float:
        """How long it has not answered."""

    def forget(self, uid: str) -> None:
        """Nobody will ask it again."""


@dataclass
class Reconciler:
    """One per operator; knows no job by itself, all is in the view and in the API server."""

    api: Api
    view: View
    drivers: Drivers
    settings: Settings
    now: Callable[[], datetime] = utc_now
    monotonic: Callable[[], float] = lambda: asyncio.get_running_loop().time()
    counted: Callable[[JobView, JobView], None] = lambda _before, _after: None
    paced: Callable[[str], None] = lambda _what: None  # urgent, progress, put_off
    queueing: Queueing | None = None
    offers: Offers = field(default_factory=NoOffers)
    announcer: Announcer = field(default_factory=Announcer)
    pace: WritePace = field(init=False)
    _patience: Patience = field(init=False)
    _missing: Patience = field(init=False)
    _lookout: Lookout = field(init=False)
    _refusals: Refusals = field(init=False)
    _rounds: Rounds = field(init=False)
    _handover: Handover = field(init=False)
    _warm: WarmStarts = field(init=False)
    _asked: dict[str, str] = field(default_factory=dict)  # the driver last asked, by its job
    # Jobs as they were before a write that was not answered: it may have happened.
    _unanswered: dict[str, JobView] = field(default_factory=dict)
    _recorder: EventRecorder = field(init=False)

    def __post_init__(self) -> None:
        self._recorder = EventRecorder(self.api, self.monotonic)
        self.begin_to_lead()

    def begin_to_lead(self) -> None:
        """Forgets what was seen when this replica led before: another may have led since."""
        self.pace = WritePace(self.settings.progress_wait_seconds, self.monotonic)
        self._patience, self._missing = Patience(), Patience()
        self._lookout = Lookout(self.api, self.settings, self.monotonic)
        self._refusals = Refusals(self.settings.stuck_seconds, self.monotonic)
        self._rounds = Rounds(self.monotonic)
        self._handover = Handover(self.api, self.monotonic)
        self._warm = WarmStarts(
            self.api, self.view, self.offers, self.drivers, self.settings, self.now, self.monotonic
        )
        for uid in list(self._asked):
            self._forget_driver(uid)
        self._unanswered.clear()
        if self.queueing is not None:
            self.queueing.begin_to_lead()
        self.announcer.begin_to_lead()
        self._recorder.begin_to_lead(job.uid for job in self.view.jobs())

    def progress_wait(self) -> float:
        """For how many seconds progress of jobs waits at present."""
        return self.pace.interval()

    async def reconcile(self, uid: str) -> None:
        """Brings one job forward; raises ApiError when it should be tried again."""
        job = self.view.job(uid)
        if job is None or job.deleting:
            self._forget_gone(uid)
            return
        before = self._unanswered.get(uid)
        if before is not None and before.resource_version != job.resource_version:
            self._written(before, job)
        await self._recorder.catch_up(job, self.now())
        if not job.finished:
            job = await self._advance(job)
        else:
            job = await self._write(job, acknowledged(job))
        if job is None:
            return
        if job.finished:
            self.announcer.announce(job)
            await self._stop_leftovers(job)
            self._forget(uid)
        unwritten = await self._recorder.write(job, self.now())
        # What others wait for, a place in a queue above all, waits for no Event.
        if self.queueing is not None:
            await self.queueing.settle(job)
        if await self._is_due_to_go(job):
            await self._remove(job)
        elif unwritten is not None:
            raise unwritten  # else nothing might ever ask for a job that has ended or rests

    def _forget_gone(self, uid: str) -> None:
        """There is no such job any more; its children go by their ownerReferences."""
        self._forget(uid)
        self._warm.forget_driver(uid)
        self._unanswered.pop(uid, None)
        self._recorder.forget(uid)
        self.announcer.forget(uid)
        self._handover.forget(uid)
        if self.queueing is not None:
            self.queueing.gone(uid)

    async def _is_due_to_go(self, job: JobView) -> bool:
        """Whether a job was kept for as long as its spec says, and nothing is owed of it."""
        if not expired(job, self.now()) or self.announcer.owes(job) or self._recorder.owes(job):
            return False
        own = own_driver_in_pool(job.name, job.status)
        if await may_lend_pods(self.api, job.namespace, own, job.uid):
            return False
        return not await self._handover.waits(job)

    async def _advance(self, job: JobView) -> JobView | None:
        """Looks, decides, writes and stops what has to stop; the job as it is now."""
        asked = await self._asked_in_pool(job)
        if asked is None:
            return None
        job = asked
        seen = replace(await self._observe(job), kueue=self.queueing is not None)
        if await self._was_behind(seen):
            return job  # the next visit decides by what is known now
        status = decide(seen, self.now(), self.settings.stuck_seconds)
        await self._stop_earlier_attempts(job)
        written = await self._write(job, status)
        if written is not None and not written.finished and seen.halt is not None:
            await self._stop_gracefully(written)
        return written

    async def _asked_in_pool(self, job: JobView) -> JobView | None:
        """The job, once it is written which driver it has asked, or that it has pods of its own."""
        if job.status.get("driver") or _resumes(job) or _follows(job):
            return job
        halted = halt_of(job, self.now()) is not None
        for _ in range(_MOST_ASKED):
            pool = await self._warm.next_status(job, halted)
            if pool is None or pool == job.status.get("pool"):
                break
            written = await self._write(job, job.status | {"pool": pool})
            if written is None:
                return None
            job = written
        return job

    async def _was_behind(self, seen: Observation) -> bool:
        """Whether the pod whose trouble is about to end the job is another by now, or gone."""
        trouble = fatal(seen, self.settings.stuck_seconds)
        if trouble is None or seen.ending is not None or seen.halt is not None:
            return False
        pods = self.view.pods(seen.job.uid)
        pod = next((pod for pod in pods if pod.name == trouble.pod), None)
        if pod is None:
            return False
        live = await self._refreshed(pod)
        return live is None or replace(live, resource_version=pod.resource_version) != pod

    async def _observe(self, job: JobView) -> Observation:
        """Everything that the decision needs; creates the children if they were never there."""
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
            driver, ending = await self._look_for(job, attempt, at_once=halt is not None)
        elif driver is None and halt is None and self._may_start(job):
            driver, refusal, ending = await self._start(job, attempt)
        if driver is not None:
            seen, driver = driver, await self._refreshed_if_silent(driver)
            if driver is None:
                ending = lost_driver(job.namespace, seen.name, seen)
        progress = None
        if driver is not None:
            ending = ending_of(driver, self.now())
            if ending is None and serves(driver):
                progress = await self._account_of(driver)
                ending = has_ended(progress)
        running = driver is not None and ending is None and serves(driver)
        ending = await self._excused(job, ending)
        account = ending.progress if ending else progress
        halt = halt_as_seen(halt, job, running, account, self.now())
        return await self._observation(job, attempt, driver, progress, refusal, ending, halt)

    async def _excused(self, job: JobView, ending: Ending | None) -> Ending | None:
        """Not counted where the job that this one's pods were made for was deleted, and they with
        it; in the foreground it is there until they are gone."""
        claim = taken(job.status)
        if ending is None or not ending.lost or claim is None:
            return ending
        try:
            home = JobView.from_object(await self.api.get_job(job.namespace, claim.job))
        except ApiError as error:
            if error.status != 404:
                raise
            return replace(ending, voluntary=True)
        stays = home.uid == claim.uid and not home.deleting
        return ending if stays else replace(ending, voluntary=True)

    def _may_start(self, job: JobView) -> bool:
        return not pausing(job, self.now()) and not is_asked_for(job.status)

    async def _looked_up(self, job: JobView, attempt: int) -> Observation | None:
        """The earlier jobs that this one depends on, one at a time; None when they are written."""
        if _resumes(job):
            return await self._resumed(job, attempt)
        if _follows(job):
            return await self._compared(job, attempt)
        return None

    async def _resumed(self, job: JobView, attempt: int) -> Observation:
        """Where to go on from; it is written before there is a driver, since the old job may go."""
        try:
            entire = await self._whole(job)
            earlier = await find_earlier(self.api, entire, read_spec(entire))
        except UnusableSpecError as error:
            return Observation(job, attempt, ending=_refused(reasons.SPEC_INVALID, error))
        except CannotResumeError as error:
            return Observation(job, attempt, ending=_refused(reasons.RESUME_REFUSED, error))
        return Observation(job, attempt, resumed_from=earlier)

    async def _compared(self, job: JobView, attempt: int) -> Observation:
        """With what; it is written before there is a driver, so that all of them go by it."""
        try:
            return Observation(job, attempt, baseline=await find_last_passed(self.api, job))
        except CannotCompareError as error:
            return Observation(job, attempt, ending=_refused(reasons.BASELINE_REFUSED, error))

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
        looked_up = await self._lookout.look(job, attempt, pods, left)
        found = tuple(troubles(pods, self.now(), gone, looked_up))
        wants = {t.reason for t in found} | ({refusal.reason} if refusal else set())
        on_nodes = any(pod.unschedulable for pod in pods)
        self._warm.note_room(job, reasons.QUOTA_EXCEEDED in wants, on_nodes)
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

    async def _start(
        self, job: JobView, attempt: int
    ) -> tuple[PodView | None, Refusal | None, Ending | None]:
        """Creates ConfigMap and driver; what can't be run ends the job with a sentence."""
        standing = self._refusals.standing(job, attempt)
        if standing is not None:
            return None, standing, None
        again = self._refusals.asked(job.uid)
        await self._stop_driver_before(job, attempt)
        try:
            entire = await self._whole(job)
            spec = await self._place(entire)
            made = (
                spec
                if isinstance(spec, Refusal)
                else await self._create(entire, spec, attempt, again)
            )
        except UnusableSpecError as error:
            return None, None, _refused(reasons.SPEC_INVALID, error)
        except JobTooLargeError as error:
            return None, None, _refused(reasons.JOB_TOO_LARGE, error)
        if isinstance(made, Refusal):
            self._refusals.keep(job, attempt, made)
            return None, made, None
        self._refusals.forget(job.uid)
        self.view.put_pod(made)
        return made, None, None

    async def _create(
        self, entire: JobView, spec: SimulationJobSpec, attempt: int, again: bool
    ) -> PodView | Refusal:
        shape = self._warm.shape_to_keep(entire, spec)
        return await create_children(self.api, entire, spec, attempt, self.settings, again, shape)

    async def _place(self, entire: JobView) -> SimulationJobSpec | Refusal:
        """The job's spec, with its pods where its queue wants them if it has one."""
        spec = read_spec(entire)
        return spec if self.queueing is None else await self.queueing.placed(entire, spec)

    async def _stop_driver_before(self, job: JobView, attempt: int) -> None:
        """Deletes the driver that is replaced; a new operator's watch may not have brought it."""
        if attempt == 1 or self.view.driver(job.uid, attempt - 1) is not None:
            return
        pod = await self._get_pod(job.namespace, names.driver_name(job.name, attempt - 1))
        if pod is not None and pod.job_uid == job.uid and not (pod.ended or pod.deleting):
            await self._delete(pod)

    async def _whole(self, job: JobView) -> JobView:
        try:
            return await whole(self.api, job)
        except ApiError as error:
            if error.status == 404:
                await self._reread(job)
            raise

    async def _look_for(
        self, job: JobView, attempt: int, at_once: bool
    ) -> tuple[PodView | None, Ending | None]:
        """A driver that may be there and is not in sight: wait for the watch, then ask."""
        name = driver_name(job.name, attempt, job.status)
        missing_for = self._missing.observe(job.uid, [name], self.monotonic())[name]
        went = next((p for p in self.view.gone_pods(job.uid) if p.name == name), None)
        at_once = at_once or went is not None
        if not at_once and missing_for < self.settings.missing_driver_seconds:
            return None, None
        driver = await self._get_pod(job.namespace, name)
        if driver is None or driver.job_uid != job.uid:
            return None, lost_driver(job.namespace, name, went)
        return driver, None

    async def _account_of(self, driver: PodView) -> Progress | None:
        """The account of this driver; what the one before it reported is not its account."""
        if self._asked.get(driver.job_uid) != driver.uid:
            self._forget_driver(driver.job_uid)
        self._asked[driver.job_uid] = driver.uid
        whose = (driver.job_uid, driver.attempt)
        return await self.drivers.read(driver.uid, driver.ip, whose)

    async def _refreshed_if_silent(self, driver: PodView) -> PodView | None:
        """The driver as it is now if it was silent for long; None when it is gone."""
        self._missing.forget(driver.job_uid)
        silent = self.drivers.silent_seconds(driver.uid) >= SILENT_DRIVER_SECONDS
        if serves(driver) and not silent:
            self._rounds.forget(driver.job_uid)
            return driver
        if driver.ended or not self._rounds.due(driver, at_once=silent):
            return driver
        live = await self._refreshed(driver)
        self._rounds.looked(driver)
        return live

    async def _refreshed(self, pod: PodView) -> PodView | None:
        """The pod as the API server has it, and the view from now on; None when it is gone."""
        live = await self._get_pod(pod.namespace, pod.name)
        if live is None or live.uid != pod.uid:
            self.view.drop_pod(pod)
            return None
        return live

    async def _get_pod(self, namespace: str, name: str) -> PodView | None:
        """A pod as the API server has it, which the view has from now on; None for none."""
        found = await get_if_there(self.api, "pods", namespace, name)
        if found is None:
            return None
        pod = PodView.from_object(found)
        self.view.put_pod(pod)
        return self.view.shown(pod)

    async def _write(self, job: JobView, status: Json) -> JobView | None:
        """Writes what changed, then reports it; the job as it is now, None when it is gone."""
        status = self.announcer.with_notifications(job, status, self.now())
        changed = {key: value for key, value in status.items() if job.status.get(key) != value}
        changed |= {key: None for key in job.status if key not in status}
        if not changed:
            return job
        urgent = is_urgent(job.status, status)
        if not urgent and self.pace.puts_off(job.uid):
            self.paced("put_off")
            return job  # a later visit writes what is known then
        self.paced("urgent" if urgent else "progress")
        # With the version that was decided on, a job that has changed since answers 409.
        patch = {"metadata": {"resourceVersion": job.resource_version}, "status": changed}
        self._unanswered[job.uid] = job
        try:
            with self.pace.writing(job.uid, urgent):
                written = await self.api.patch_status(job.namespace, job.name, patch, urgent)
        except ApiError as error:
            if error.status in {404, 409}:
                await self._reread(job)
            if error.status == 404:
                return None
            raise
        now = JobView.from_object(written)
        self.view.put_job(now)
        self._written(job, now)
        return now

    def _written(self, before: JobView, now: JobView) -> None:
        """Counts what a write has changed, and keeps it to be reported."""
        self._unanswered.pop(now.uid, None)
        self.counted(before, now)
        notes = transitions.transitions(
            before.status.get("conditions") or [], now.status.get("conditions") or []
        )
        self._recorder.add(now, notes)

    async def _reread(self, job: JobView) -> None:
        """The watch is behind: takes the job from the API server itself."""
        try:
            live = JobView.from_object(await self.api.get_job(job.namespace, job.name))
        except ApiError as error:
            if error.status != 404:
                raise
            self.view.drop_job(job.uid)
            return
        if live.uid == job.uid:
            self.view.put_job(live)
        else:
            self.view.drop_job(job.uid)

    async def _stop_earlier_attempts(self, job: JobView) -> None:
        """Deletes the executors of drivers that were replaced: their places are needed."""
        attempt = int(job.status.get("attempt") or 1)
        for pod in self.view.pods(job.uid):
            if pod.attempt < attempt and not pod.ended and not pod.deleting:
                await self._delete(pod)

    async def _stop_leftovers(self, job: JobView) -> None:
        """Deletes the pods of an ended job that have not ended themselves.

        The driver first: it owns the executors and would replace them. Pods that have ended stay
        for their logs until the job is deleted.
        """
        pods = [p for p in self.view.pods(job.uid) if not p.ended and not p.deleting]
        if not pods:
            self._warm.forget_driver(job.uid)
        elif await self._warm.keeps(job):
            return
        for pod in sorted(pods, key=lambda p: p.role != names.ROLE_DRIVER):
            if needs_stop(pod, self.now()):
                await self._delete(pod)

    async def _stop_gracefully(self, job: JobView) -> None:
        """Deletes the driver, which journals what is done; then what it has left of executors."""
        alive = living(self.view.pods(job.uid), self.now())
        working = [pod for pod in alive if needs_stop(pod, self.now())]
        drivers = [pod for pod in working if pod.role == names.ROLE_DRIVER]
        for pod in drivers or working:
            if not pod.deleting:
                await self._delete(pod)
        if not alive:
            self._forget(job.uid)

    async def _delete(self, pod: PodView) -> None:
        """Deletes a pod; if it went while the watch was being restarted, no event reports it."""
        if not await self.api.delete_pod(pod.namespace, pod.name, pod.uid):
            self.view.drop_pod(pod)

    async def _remove(self, job: JobView) -> None:
        """Deletes a job that was kept for long enough; one that has changed is looked at again."""
        try:
            await self.api.delete_unchanged_job(
                job.namespace, job.name, job.uid, job.resource_version
            )
        except ApiError as error:
            if error.status not in {404, 409}:
                raise
            await self._reread(job)
            return
        self._handover.forget(job.uid)
        self.view.drop_job(job.uid)

    def _forget(self, uid: str) -> None:
        self._warm.forget(uid)
        self.pace.forget(uid)
        self._patience.forget(uid)
        self._missing.forget(uid)
        self._lookout.forget(uid)
        self._refusals.forget(uid)
        self._rounds.forget(uid)
        self._forget_driver(uid)

    def _forget_driver(self, uid: str) -> None:
        asked = self._asked.pop(uid, None)
        if asked is not None:
            self.drivers.forget(asked)


def _has_driver(job: JobView) -> bool:
    """Whether a driver's pod must be there, in sight or not: its own, or the one that took it."""
    return bool(job.status.get("driver")) or taken(job.status) is not None


def _resumes(job: JobView) -> bool:
    """Whether it is still to be written from which job this one goes on."""
    return bool(job.spec.get("resumeFrom")) and not job.status.get("resumedFrom")


def _follows(job: JobView) -> bool:
    """Whether it is still to be written with which job this one is compared."""
    return bool(followed_schedule(job)) and pinned_baseline(job) is None


def _backoff_limit(job: JobView) -> int:
    """The API server writes the default; a job of an older CRD has none."""
    limit = readings.whole(job.spec.get("backoffLimit"))
    return DEFAULT_BACKOFF_LIMIT if limit is None else limit


def _refused(reason: str, error: Exception) -> Ending:
    """The end of a job that can't be begun."""
    return Ending(False, reason, str(error))
