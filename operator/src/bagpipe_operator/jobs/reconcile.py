"""The loop's body: look at one job, decide, write its status once, report what changed.

Level-triggered: it is right whenever and however often it is called.
"""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from typing import Protocol

from bagpipe_operator.api.pool_driver import own_driver_in_pool
from bagpipe_operator.cluster.client import Api, ApiError
from bagpipe_operator.cluster.lent_pods import may_lend_pods
from bagpipe_operator.jobs.announcer import Announcer
from bagpipe_operator.jobs.driver.lookup import Accounts, DriverLookup
from bagpipe_operator.jobs.driver_start import DriverStart
from bagpipe_operator.jobs.event_recorder import EventRecorder
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.kueue.queueing import Queueing
from bagpipe_operator.jobs.observer import Observer, follows, resumes
from bagpipe_operator.jobs.pod_removal import PodRemoval
from bagpipe_operator.jobs.policies.halt import halt_of
from bagpipe_operator.jobs.policies.last_passed import Handover
from bagpipe_operator.jobs.policies.ttl import expired
from bagpipe_operator.jobs.specs import Specs
from bagpipe_operator.jobs.status import acknowledged, decide
from bagpipe_operator.jobs.status_writer import StatusWriter
from bagpipe_operator.jobs.view import View
from bagpipe_operator.jobs.warm_start import (
    NoOffers,
    Offers,
    WarmStarts,
    Working,
)
from bagpipe_operator.runtime.clock import utc_now
from bagpipe_operator.runtime.write_pace import WritePace
from bagpipe_operator.settings import Settings

# How often a status may change in one visit while a driver is asked whether it takes the job.
_MOST_ASKED = 3


class Drivers(Accounts, Working, Protocol):
    """Who asks drivers what they do."""


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
    _handover: Handover = field(init=False)
    _specs: Specs = field(init=False)
    _warm: WarmStarts = field(init=False)
    _recorder: EventRecorder = field(init=False)
    _removal: PodRemoval = field(init=False)
    _lookup: DriverLookup = field(init=False)
    _writer: StatusWriter = field(init=False)
    _starts: DriverStart = field(init=False)
    _observer: Observer = field(init=False)

    def __post_init__(self) -> None:
        self._recorder = EventRecorder(self.api, self.monotonic)
        self._removal = PodRemoval(self.api, self.view, self.now)
        missing = self.settings.missing_driver_seconds
        self._lookup = DriverLookup(self.api, self.view, self.drivers, missing, self.monotonic)
        self.begin_to_lead()

    def begin_to_lead(self) -> None:
        """Forgets what was seen when this replica led before: another may have led since."""
        self.pace = WritePace(self.settings.progress_wait_seconds, self.monotonic)
        self._handover = Handover(self.api, self.monotonic)
        self._specs = Specs(self.api)
        self._warm = WarmStarts(
            self.api, self.view, self.offers, self.drivers, self.settings, self.now,
            self.monotonic, self._specs,
        )  # fmt: skip
        self._writer = StatusWriter(
            self.api, self.view, self.announcer, self._recorder,
            pace=self.pace, now=self.now, counted=self.counted, paced=self.paced,
        )  # fmt: skip
        self._starts = DriverStart(
            self.api, self.view, self.settings, self.monotonic, queueing=self.queueing,
            warm=self._warm, lookup=self._lookup, writer=self._writer, removal=self._removal,
            specs=self._specs,
        )  # fmt: skip
        self._observer = Observer(
            self.api, self.view, self.settings, self.now, self.monotonic, queueing=self.queueing,
            warm=self._warm, lookup=self._lookup, starts=self._starts,
        )  # fmt: skip
        self._lookup.begin_to_lead()
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
        if job is None:
            self._forget_gone(uid)
            return
        self._writer.take_in(job)
        await self._recorder.catch_up(job, self.now())
        if not job.finished:
            job = await self._advance(job)
        else:
            job = await self._writer.write(job, acknowledged(job))
        if job is None:
            self._forget_if_gone(uid)
            return
        undeleted = await self._over(job) if job.finished else None
        unwritten = await self._recorder.write(job, self.now())
        if undeleted is not None:
            raise undeleted  # what its pods hold is nobody else's yet
        # What others wait for, a place in a queue above all, waits for no Event.
        if self.queueing is not None:
            await self.queueing.settle(job)
        if await self._is_due_to_go(job):
            await self._remove(job)
            return
        if unwritten is not None:
            raise unwritten  # else nothing might ever ask for a job that has ended or rests

    async def _advance(self, job: JobView) -> JobView | None:
        """Stops what was replaced, then all else; the job as it is now."""
        undeleted = None
        try:
            # Before there is another driver: a call that fails below would leave two.
            await self._removal.of_earlier_attempts(job)
        except ApiError as error:
            undeleted = error
        # What is known of the job is reported also where no pod can be deleted.
        now = await self._decided(job)
        if undeleted is not None:
            raise undeleted
        return now

    async def _decided(self, job: JobView) -> JobView | None:
        """Looks, decides, writes and stops what has to stop; the job as it is now."""
        asked = await self._asked_in_pool(job)
        if asked is None:
            return None
        job = asked
        seen = await self._observer.observe(job)
        if seen.driver is not None:  # also one whose creation seemed to be refused
            self._starts.forget(job.uid)
        if await self._observer.was_behind(seen):
            return job  # the next visit decides by what is known now
        status = decide(seen, self.now(), self.settings.stuck_seconds)
        try:
            written = await self._writer.write(job, status)
        except ApiError as error:
            # Anybody may fill his job until no status fits it: that keeps no pod.
            if seen.halt is not None and error.refuses:
                await self._removal.gracefully(job)
            raise
        halted = written is not None and not written.finished and seen.halt is not None
        if written is not None and halted and await self._removal.gracefully(written):
            self._forget(written.uid)
        return written

    async def _asked_in_pool(self, job: JobView) -> JobView | None:
        """The job, once it is written which driver it has asked, or that it has pods of its own."""
        if job.status.get("driver") or resumes(job) or follows(job):
            return job
        halted = halt_of(job, self.now()) is not None
        for _ in range(_MOST_ASKED):
            pool = await self._warm.next_status(job, halted)
            if pool is None or pool == job.status.get("pool"):
                break
            written = await self._writer.write(job, job.status | {"pool": pool})
            if written is None:
                return None
            job = written
        return job

    async def _over(self, job: JobView) -> ApiError | None:
        """A job has ended; what kept its pods from being deleted, which holds up no report."""
        self.announcer.announce(job)
        try:
            await self._stop_leftovers(job)
        except ApiError as error:
            return error
        finally:
            self._forget(job.uid)
        return None

    async def _stop_leftovers(self, job: JobView) -> None:
        """Deletes the pods of an ended job that have not ended themselves, unless they wait for the
        next one: those of earlier attempts never do, nor those of a job that is deleted."""
        left = self._removal.left_of(job)
        if not left:
            self._warm.forget_driver(job.uid)
        elif not job.deleting and await self._warm.keeps(job):
            await self._removal.of_earlier_attempts(job)
        else:
            await self._removal.of_leftovers(left)

    async def _is_due_to_go(self, job: JobView) -> bool:
        """Whether a job was kept for as long as its spec says, and nothing is owed of it."""
        if job.deleting or not expired(job, self.now()):
            return False
        if self.announcer.owes(job) or self._recorder.owes(job):
            return False
        own = own_driver_in_pool(job.name, job.status)
        if await may_lend_pods(self.api, job.namespace, own, job.uid):
            return False
        return not await self._handover.waits(job)

    async def _remove(self, job: JobView) -> None:
        """Deletes a job that was kept for long enough; one that has changed is looked at again."""
        try:
            await self.api.delete_unchanged_job(
                job.namespace, job.name, job.uid, job.resource_version
            )
        except ApiError as error:
            # What a webhook denies is tried again after growing pauses, whatever code it chose.
            if error.status not in {404, 409} or error.admission_denies:
                raise
            await self._writer.reread(job)
        else:
            self.view.drop_job(job.uid)
        self._forget_if_gone(job.uid)

    def _forget_if_gone(self, uid: str) -> None:
        """A call has shown that a job is gone, or may be: no event may say so any more."""
        if self.view.job(uid) is None:
            self._forget_gone(uid)

    def _forget_gone(self, uid: str) -> None:
        """There is no such job any more; its children go by their ownerReferences."""
        self._forget(uid)
        self._warm.forget_driver(uid)
        self._writer.forget_gone(uid)
        self._recorder.forget(uid)
        self.announcer.forget(uid)
        self._handover.forget(uid)
        if self.queueing is not None:
            self.queueing.gone(uid)

    def _forget(self, uid: str) -> None:
        self._specs.forget(uid)
        self._warm.forget(uid)
        self.pace.forget(uid)
        self._observer.forget(uid)
        self._starts.forget(uid)
        self._lookup.forget(uid)
