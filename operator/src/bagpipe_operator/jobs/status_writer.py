"""Writes a job's status: what has changed, when it is its turn; what is written becomes Events."""

from collections.abc import Callable
from datetime import datetime

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import Api, ApiError
from bagpipe_operator.jobs import transitions
from bagpipe_operator.jobs.announcer import Announcer
from bagpipe_operator.jobs.event_recorder import EventRecorder
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.policies.urgency import is_urgent
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.write_pace import WritePace


class StatusWriter:
    """One per operator."""

    def __init__(
        self,
        api: Api,
        view: View,
        announcer: Announcer,
        recorder: EventRecorder,
        *,
        pace: WritePace,
        now: Callable[[], datetime],
        counted: Callable[[JobView, JobView], None],
        paced: Callable[[str], None],
    ) -> None:
        """`counted` is called with a job before and after a write, `paced` with what was decided of
        each: urgent, progress or put_off."""
        self._api = api
        self._view = view
        self._announcer = announcer
        self._recorder = recorder
        self._pace = pace
        self._now = now
        self._counted = counted
        self._paced = paced
        # Jobs as they were before a write that was not answered: it may have happened.
        self._unanswered: dict[str, JobView] = {}

    async def write(self, job: JobView, status: Json) -> JobView | None:
        """Writes what changed, then reports it; the job as it is now, None when it is gone.

        Raises ApiError.
        """
        status = self._announcer.with_notifications(job, status, self._now())
        changed = {key: value for key, value in status.items() if job.status.get(key) != value}
        changed |= {key: None for key in job.status if key not in status}
        if not changed:
            return job
        urgent = is_urgent(job.status, status)
        if not urgent and self._pace.puts_off(job.uid):
            self._paced("put_off")
            return job  # a later visit writes what is known then
        self._paced("urgent" if urgent else "progress")
        # With the version that was decided on, a job that has changed since answers 409.
        patch = {"metadata": {"resourceVersion": job.resource_version}, "status": changed}
        self._unanswered[job.uid] = job
        try:
            with self._pace.writing(job.uid, urgent):
                written = await self._api.patch_status(job.namespace, job.name, patch, urgent)
        except ApiError as error:
            gone = error.is_gone(job.name)
            if gone or error.status == 409:
                await self.reread(job)
            if gone:
                return None
            raise
        now = JobView.from_object(written)
        self._view.put_job(now)
        self._written(job, now)
        return now

    def take_in(self, job: JobView) -> None:
        """A job as it is now: it may show that a write that was not answered has happened."""
        before = self._unanswered.get(job.uid)
        if before is not None and before.resource_version != job.resource_version:
            self._written(before, job)

    async def reread(self, job: JobView) -> None:
        """The watch is behind: takes the job from the API server itself."""
        try:
            live = JobView.from_object(await self._api.get_job(job.namespace, job.name))
        except ApiError as error:
            if not error.is_gone(job.name):
                raise
            self._view.drop_job(job.uid)
            return
        if live.uid == job.uid:
            self._view.put_job(live)
        else:
            self._view.drop_job(job.uid)

    def forget_gone(self, uid: str) -> None:
        """There is no such job any more."""
        self._unanswered.pop(uid, None)

    def _written(self, before: JobView, now: JobView) -> None:
        """Counts what a write has changed, and keeps it to be reported."""
        self._unanswered.pop(now.uid, None)
        self._counted(before, now)
        notes = transitions.transitions(
            before.status.get("conditions") or [], now.status.get("conditions") or []
        )
        self._recorder.add(now, notes)
