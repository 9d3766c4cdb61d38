"""The loop's body for schedules: look, decide, start what is due, write the status once, report.

Level-triggered: it is right whenever and however often it is called, and by whomever: a run's job
has one name, so that a second operator meets AlreadyExists.
"""

import contextlib
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Protocol

from bagpipe_operator.api import names, reasons
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.event_backlog import Creator
from bagpipe_operator.cluster.events import Note
from bagpipe_operator.cluster.write_turns import WriteTurns
from bagpipe_operator.schedules import events
from bagpipe_operator.schedules.alarms import Alarms
from bagpipe_operator.schedules.decide import Decision, Verdict, decide, time_zone_of
from bagpipe_operator.schedules.job import job_manifest, name_taken, refusal_of, too_many
from bagpipe_operator.schedules.metrics import ScheduleMetrics
from bagpipe_operator.schedules.removal import Deleter, JobRemoval
from bagpipe_operator.schedules.status import Outcome, Refused, notes_of, status_of
from bagpipe_operator.schedules.view import ScheduledJob, Schedules, ScheduleView, job_name
from bagpipe_operator.schedules.zones import Zones

logger = logging.getLogger(__name__)

# A run that waits for a job asks this often whether it is still there: a deletion that falls
# between two watches is reported by no event.
LIST_EVERY = timedelta(seconds=30)
# A schedule keeps 200 that have ended. Anybody may give others its label, and each list would hold
# one of the workers of all schedules for as long as they are read.
MOST_LISTED = 1000
# An API server that answers late writes late; older ones it has given up.
MOST_UNANSWERED = 3


class ScheduleApi(Deleter, Creator, Protocol):
    """What schedules need of an API server; every method raises ApiError."""

    async def create_job(self, manifest: Json) -> Json:
        """Creates a SimulationJob."""

    async def try_job(self, manifest: Json) -> None:
        """Has a SimulationJob judged as if it were created; nothing is kept."""

    async def list_jobs(self, namespace: str, label: str, most: int | None = None) -> list[Json]:
        """The SimulationJobs with a label, written `key=value`; not more than `most`."""

    async def get_schedule(self, namespace: str, name: str) -> Json:
        """One SimulationSchedule."""

    async def patch_schedule_status(self, namespace: str, name: str, patch: Json) -> Json:
        """Merges into a schedule's status; the schedule as it is afterwards."""


@dataclass(frozen=True)
class _Write:
    """What a write that was not answered would have changed and reported.

    It may have happened, or happen as long as the schedule has the version that was decided on.
    """

    version: str
    changed: Json
    notes: list[Note]

    def is_in(self, status: Json) -> bool:
        return all(status.get(key) == value for key, value in self.changed.items())


@dataclass
class ScheduleReconciler:
    """One per operator; what it knows is in the view and in the API server."""

    api: ScheduleApi
    view: Schedules
    alarms: Alarms
    metrics: ScheduleMetrics
    now: Callable[[], datetime]
    _listed: dict[str, datetime] = field(default_factory=dict)
    _crowded: set[str] = field(default_factory=set)  # those with more than MOST_LISTED
    _unanswered: dict[str, list[_Write]] = field(default_factory=dict)
    _zones: Zones = field(default_factory=Zones)
    # One at a time, and one more beside another namespace's that is slow, as behind a webhook.
    _large: WriteTurns = field(default_factory=lambda: WriteTurns(1, 0, 1))
    _recorder: events.EventRecorder = field(init=False)
    _removal: JobRemoval = field(init=False)

    def __post_init__(self) -> None:
        self._recorder = events.EventRecorder(self.api)
        self._removal = JobRemoval(self.api, self.view, self.now)

    async def reconcile(self, uid: str) -> None:
        """Brings one schedule forward; raises ApiError when it should be tried again."""
        now = self.now()
        schedule = await self._to_look_at(uid, now)
        if schedule is None:
            return
        if uid not in self._listed:
            # A new operator's watch may not have brought the jobs yet.
            await self._list(schedule)
        decision = await self._decided(schedule, now)
        # A list of a time to come was read before the clock was set back.
        if decision.verdict is Verdict.WAIT and abs(now - self._listed[uid]) >= LIST_EVERY:
            await self._list(schedule)
            decision = await self._decided(schedule, now)
        if decision.verdict is Verdict.START:
            schedule = await self._refreshed(schedule)
            if schedule is None:
                return
            decision = await self._decided(schedule, now)
        outcome = await self._carried_out(schedule, decision)
        await self._write(schedule, outcome, now)
        moments = [decision.wake, await self._recorder.write(schedule, now)]
        moments.append(await self._removal.of_surplus(schedule, decision, now))
        if outcome.refused is not None:
            # The queue's growing pauses apply until the run is started, or the next one is due.
            raise ApiError(422, outcome.refused.reason, outcome.refused.message)
        if decision.verdict is Verdict.WAIT:
            moments.append(self._listed[uid] + LIST_EVERY)
        self.alarms.set(uid, min((at for at in moments if at is not None), default=None))

    async def _to_look_at(self, uid: str, now: datetime) -> ScheduleView | None:
        """The schedule; None when it is gone, and so forgotten."""
        schedule = self.view.schedule(uid)
        if schedule is None or schedule.deleting:
            self.alarms.forget(uid)
            self._listed.pop(uid, None)  # its jobs go by their ownerReferences
            self._crowded.discard(uid)
            self._unanswered.pop(uid, None)
            self._recorder.forget(uid)
            self._removal.forget(uid)
            return None
        self.alarms.set(uid, now)  # stands when a call below fails, so that it is tried again
        return await self._settled(schedule) if uid in self._unanswered else schedule

    async def _decided(self, schedule: ScheduleView, now: datetime) -> Decision:
        zone = await self._zones.read(time_zone_of(schedule))
        decision = decide(schedule, self.view.jobs(schedule.uid), now, zone)
        self.alarms.set_next(schedule.uid, decision.wake)
        return decision

    async def _refreshed(self, schedule: ScheduleView) -> ScheduleView | None:
        """The schedule and its jobs as the API server has them: a lagging watch starts nothing."""
        await self._list(schedule)
        return await self._reread(schedule)

    async def _list(self, schedule: ScheduleView) -> None:
        """Takes over what the API server has, unless that is too much: then what the watch has
        brought stays, and no run is started."""
        label, uid = f"{names.LABEL_SCHEDULE}={schedule.name}", schedule.uid
        found = await self.api.list_jobs(schedule.namespace, label, MOST_LISTED + 1)
        self._listed[uid] = self.now()
        if len(found) > MOST_LISTED:
            self._crowded.add(uid)
            return
        self._crowded.discard(uid)
        self.view.replace_jobs(uid, [ScheduledJob.from_object(job) for job in found])

    async def _reread(self, schedule: ScheduleView) -> ScheduleView | None:
        """The schedule from the API server; None when it is gone."""
        try:
            live = ScheduleView.from_object(
                await self.api.get_schedule(schedule.namespace, schedule.name)
            )
        except ApiError as error:
            if not error.is_gone(schedule.name):
                raise
            self.view.drop_schedule(schedule.uid)
            return None
        if live.uid != schedule.uid or live.deleting:
            self.view.drop_schedule(schedule.uid)
            return None
        self.view.put_schedule(live)
        return live

    async def _carried_out(self, schedule: ScheduleView, decision: Decision) -> Outcome:
        """Starts the run that is due, if one is to be started."""
        started, refused = "", None
        if decision.verdict is Verdict.START and decision.run is not None:
            if schedule.uid in self._crowded:
                refused = too_many(schedule.name, schedule.namespace, MOST_LISTED)
            if refused is None and decision.replaced:
                async with self._turn(schedule):
                    refused = await self._tried(schedule, decision.run)
            if refused is None:
                refused = await self._removal.of_replaced(decision.replaced)
            if refused is None:
                async with self._turn(schedule):
                    refused = await self._start(schedule, decision.run)
            started = "" if refused else job_name(schedule.name, decision.run)
        jobs, passed = self.view.jobs(schedule.uid), self.view.last_passed(schedule.uid)
        return Outcome(decision, jobs, started, refused, passed)

    def _turn(self, schedule: ScheduleView) -> contextlib.AbstractAsyncContextManager[None]:
        """Large ones take turns: each takes a hundred megabytes while it makes its job."""
        large = self._large.taken(schedule.namespace)
        return large if schedule.large else contextlib.nullcontext()

    async def _tried(self, schedule: ScheduleView, run: datetime) -> Refused | None:
        """Why the run's job would be refused: what works is not replaced by what can't.

        A quota may be full of what is to be replaced.
        """
        name = job_name(schedule.name, run)
        try:
            await self.api.try_job(job_manifest(schedule, run))
        except ApiError as error:
            if error.name_is_taken:
                return await self._not_ours(schedule, name)
            refused = refusal_of(error, name)
            passes = error.status == 409 and refused is None
            if passes or error.webhook_is_not_tried:
                return None
            if refused is None:
                raise
            return None if refused.reason == reasons.QUOTA_EXCEEDED else refused
        return None

    async def _not_ours(self, schedule: ScheduleView, name: str) -> Refused | None:
        """The refusal for a job of this name that is there, unless it is the schedule's."""
        await self._list(schedule)
        ours = any(job.name == name for job in self.view.jobs(schedule.uid))
        return None if ours else name_taken(name, schedule.namespace)

    async def _start(self, schedule: ScheduleView, run: datetime) -> Refused | None:
        """Creates the run's job, or finds that another operator has."""
        name = job_name(schedule.name, run)
        try:
            made = await self.api.create_job(job_manifest(schedule, run))
        except ApiError as error:
            if error.name_is_taken:
                return await self._not_ours(schedule, name)
            refused = refusal_of(error, name)
            if refused is None or error.timed_out:
                self._listed.pop(schedule.uid, None)  # it may be there: the next visit looks
            if refused is None:
                raise
            return refused
        self.view.put_job(ScheduledJob.from_object(made))
        self.metrics.started.inc()
        self.metrics.lateness.observe((self.now() - run).total_seconds())
        logger.info("%s/%s: started %s", schedule.namespace, schedule.name, name)
        return None

    async def _write(self, schedule: ScheduleView, outcome: Outcome, now: datetime) -> None:
        """Writes what changed, and keeps it to be reported."""
        status = status_of(schedule, outcome, now)
        old = schedule.status
        changed = {key: value for key, value in status.items() if old.get(key) != value}
        changed |= {key: None for key in old if key not in status}
        if not changed:
            return
        # With the version that was decided on, a schedule that has changed since answers 409.
        patch = {"metadata": {"resourceVersion": schedule.resource_version}, "status": changed}
        notes = notes_of(schedule, outcome, now)
        before = self._unanswered.get(schedule.uid, [])
        write = _Write(schedule.resource_version, changed, notes)
        self._unanswered[schedule.uid] = [*before, write][-MOST_UNANSWERED:]
        try:
            written = await self.api.patch_schedule_status(schedule.namespace, schedule.name, patch)
        except ApiError as error:
            gone = error.is_gone(schedule.name)
            if gone or error.status == 409:
                # This one did not happen; one before it may have.
                self._unanswered.pop(schedule.uid)
                if before and not gone:
                    self._unanswered[schedule.uid] = before
                await self._reread(schedule)
            if gone:
                return
            raise
        self._unanswered.pop(schedule.uid)
        current = ScheduleView.from_object(written)
        self.view.put_schedule(current)
        self._recorder.add(current, notes)

    async def _settled(self, schedule: ScheduleView) -> ScheduleView | None:
        """The schedule as it is after a write without an answer, reported if it happened."""
        live = await self._reread(schedule)
        writes = self._unanswered.pop(schedule.uid)
        if live is None:
            return None
        happened = next((write for write in writes if write.is_in(live.status)), None)
        if happened is not None:
            self._recorder.add(live, happened.notes)
        elif live.resource_version == writes[-1].version:
            self._unanswered[schedule.uid] = writes
        return live
