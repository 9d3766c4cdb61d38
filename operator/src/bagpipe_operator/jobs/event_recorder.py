"""Writes the Events of jobs, each exactly once: after its status, and again until it is written.

The status is the record of what has to be reported. When an operator ends before it has written the
Events of a status, the next one writes them; an Event's name shows whether that has happened.
"""

import logging
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime

from bagpipe_operator.cluster.client import Api, ApiError
from bagpipe_operator.cluster.event_backlog import EventBacklog
from bagpipe_operator.cluster.events import Note
from bagpipe_operator.jobs import transitions
from bagpipe_operator.jobs.view import JobView

logger = logging.getLogger(__name__)


@dataclass
class EventRecorder:
    """One per operator."""

    api: Api
    _met: set[str] = field(default_factory=set)
    _backlog: EventBacklog = field(init=False)

    def __post_init__(self) -> None:
        self._backlog = EventBacklog(self.api)

    def begin_to_lead(self, known: Iterable[str]) -> None:
        """Meets all jobs again: another operator may have led, written a status and died.

        Events that this one could not write before are kept, except those of jobs that are gone:
        where the other operator has written one, the Event's name shows it.
        """
        self._met.clear()
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
        try:
            await self.write(job, now)
        except ApiError as error:
            logger.warning("%s/%s: Events are written later: %s", job.namespace, job.name, error)

    def add(self, job: JobView, notes: Iterable[Note]) -> None:
        """Keeps Events to be written, marked now: by then the job may be at another attempt."""
        self._backlog.add(job.uid, [transitions.marked(job, note) for note in notes])

    async def write(self, job: JobView, now: datetime) -> None:
        """Writes what is kept; raises the ApiError after which to try again."""
        await self._backlog.write(job, lambda note: transitions.manifest(job, note, now))

    def forget(self, uid: str) -> None:
        """The job is gone."""
        self._met.discard(uid)
        self._backlog.forget(uid)
