"""Writes the Events of jobs, each exactly once: after its status, and again until it is written.

The status is the record of what has to be reported. When an operator ends before it has written the
Events of a status, the next one writes them; an Event's name shows whether that has happened.
"""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from datetime import datetime

from bagpipe_operator.cluster.client import Api, ApiError
from bagpipe_operator.cluster.event_backlog import EventBacklog
from bagpipe_operator.cluster.events import Note
from bagpipe_operator.jobs import transitions
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.policies.suspend import is_swept
from bagpipe_operator.runtime.queue import retry_delay

logger = logging.getLogger(__name__)

# A webhook that is down, or a limit of a namespace's Events, may refuse them for ever.
MOST_SECONDS = 600.0
# So many tries in a row are made as visits come, so that one refusal loses no Event to the next
# status; after that visits of every few seconds would only add to what is refused.
_TRIES_AT_VISITS = 4


@dataclass
class _Refused:
    """Since when no Event of a job was taken, how often in a row, and when to try again."""

    since: float
    failures: int = 0
    until: float = float("-inf")


@dataclass
class EventRecorder:
    """One per operator; `monotonic` is a clock of seconds."""

    api: Api
    monotonic: Callable[[], float]
    _met: set[str] = field(default_factory=set)
    _refused: dict[str, _Refused] = field(default_factory=dict)
    _backlog: EventBacklog = field(init=False)

    def __post_init__(self) -> None:
        self._backlog = EventBacklog(self.api)

    def begin_to_lead(self, known: Iterable[str]) -> None:
        """Meets all jobs again: another operator may have led, written a status and died.

        Events that this one could not write before are kept, except those of jobs that are gone:
        where the other operator has written one, the Event's name shows it.
        """
        self._met.clear()
        self._refused.clear()
        self._backlog.keep_only(known)

    async def catch_up(self, job: JobView, now: datetime) -> None:
        """Writes the Events that are owed, at the first sight of a job those of the predecessor.

        Before the job goes on: the next status may be another one, which does not show them any
        more, and this operator may be killed. Events that are refused do not hold the job up.
        """
        if job.uid not in self._met:
            self._met.add(job.uid)
            # Release 0.1.0 wrote no lostDrivers and named its Events at random: again, they
            # would appear twice.
            if "lostDrivers" in job.status:
                self.add(job, transitions.recent(job.status.get("conditions") or [], now))
        error = await self.write(job, now)
        if error is not None:
            _log(job, error)

    def add(self, job: JobView, notes: Iterable[Note]) -> None:
        """Keeps Events to be written, marked now: by then the job may be at another attempt."""
        self._backlog.add(job.uid, [transitions.marked(job, note) for note in notes])

    async def write(self, job: JobView, now: datetime) -> ApiError | None:
        """Writes what is kept; the ApiError after which the job is to be visited again.

        None where nothing is left, or where what is left waits by itself: a job that is swept is
        not to be visited less because its Events are refused for long.
        """
        refused = self._refused.get(job.uid)
        if refused is not None and is_swept(job) and self.monotonic() < refused.until:
            return None
        try:
            await self._backlog.write(job, lambda note: transitions.manifest(job, note, now))
        except ApiError as error:
            waits = self._waits_after_refusal(job.uid)
            if not (waits and is_swept(job)):
                return error
            _log(job, error)
            return None
        self._refused.pop(job.uid, None)
        return None

    def owes(self, job: JobView) -> bool:
        """Whether a job that has ended is to stay for its Events; not for longer than MOST_SECONDS
        of refusals."""
        refused = self._refused.get(job.uid)
        return refused is not None and self.monotonic() - refused.since < MOST_SECONDS

    def forget(self, uid: str) -> None:
        """The job is gone."""
        self._met.discard(uid)
        self._refused.pop(uid, None)
        self._backlog.forget(uid)

    def _waits_after_refusal(self, uid: str) -> bool:
        """Whether so many tries in a row have failed that there is a pause before the next."""
        now = self.monotonic()
        refused = self._refused.setdefault(uid, _Refused(now))
        refused.failures += 1
        if refused.failures <= _TRIES_AT_VISITS:
            return False
        refused.until = now + retry_delay(refused.failures)
        return True


def _log(job: JobView, error: ApiError) -> None:
    logger.warning("%s/%s: Events are written later: %s", job.namespace, job.name, error)
