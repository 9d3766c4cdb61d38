"""Writes the Events of jobs, each exactly once: after its status, and again until it is written.

The status is the record of what is to be told. What an operator has written into it and not told
any more, the next one tells; an Event's name says whether that has happened.
"""

import logging
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime

from bagpipe_operator.cluster.client import Api, ApiError
from bagpipe_operator.cluster.events import Note
from bagpipe_operator.cluster.untold import Untold
from bagpipe_operator.jobs import transitions
from bagpipe_operator.jobs.view import JobView

logger = logging.getLogger(__name__)


@dataclass
class Teller:
    """One per operator."""

    api: Api
    _met: set[str] = field(default_factory=set)
    _untold: Untold = field(init=False)

    def __post_init__(self) -> None:
        self._untold = Untold(self.api)

    def begin_to_lead(self, known: Iterable[str]) -> None:
        """All jobs are to be met anew: another may have led, written and died.

        What this one could not write before is kept, but for jobs that went since: where the other
        has told it, the Event's name says so.
        """
        self._met.clear()
        self._untold.keep_only(known)

    async def meet(self, job: JobView, now: datetime) -> None:
        """The first sight of a job by this leader: tells what its predecessor owes.

        At once: the next status may say something else, and this operator be killed in its turn.
        Release 0.1.0 wrote no lostDrivers and named its Events at random: they would be told twice.
        """
        if job.uid in self._met:
            return
        self._met.add(job.uid)
        if "lostDrivers" in job.status:
            self.add(job, transitions.recent(job.status.get("conditions") or [], now))
        try:
            await self.tell(job, now)
        except ApiError as error:
            logger.warning("%s/%s: told later: %s", job.namespace, job.name, error)

    def add(self, job: JobView, notes: Iterable[Note]) -> None:
        """Keeps what is to be told, marked now: by then the job may be at another attempt."""
        self._untold.add(job.uid, [transitions.marked(job, note) for note in notes])

    async def tell(self, job: JobView, now: datetime) -> None:
        """Writes what is kept; raises the ApiError after which to try again."""
        await self._untold.write(job, lambda note: transitions.manifest(job, note, now))

    def forget(self, uid: str) -> None:
        """The job is gone."""
        self._met.discard(uid)
        self._untold.forget(uid)
