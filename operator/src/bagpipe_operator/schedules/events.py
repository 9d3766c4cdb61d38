"""The Events of schedules, and how they are written.

An Event is told after the status that it speaks of was written, and again until it is written: its
name follows from what it tells, so one whose answer was lost is found written. What an operator has
not told when it ends, nobody tells; the status says it.
"""

import logging
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime, timedelta

from bagpipe_operator.api import names
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.events import Note, event
from bagpipe_operator.cluster.untold import Creator, Untold
from bagpipe_operator.runtime.queue import retry_delay
from bagpipe_operator.schedules.view import ScheduleView

logger = logging.getLogger(__name__)


@dataclass
class Teller:
    """One per operator. An API server that takes no Events holds no run up: they wait beside it."""

    api: Creator
    _untold: Untold = field(init=False)
    _failures: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._untold = Untold(self.api)

    def add(self, schedule: ScheduleView, notes: Iterable[Note]) -> None:
        """Keeps what is to be told."""
        self._untold.add(schedule.uid, notes)

    async def tell(self, schedule: ScheduleView, now: datetime) -> datetime | None:
        """Writes what is kept; when to try again, or None when nothing is left."""
        kind = names.SCHEDULE_KIND
        try:
            await self._untold.write(schedule, lambda n: event(schedule, kind, n, n.mark, now))
        except ApiError as error:
            logger.warning("%s/%s: told later: %s", schedule.namespace, schedule.name, error)
            failures = self._failures.get(schedule.uid, 0) + 1
            self._failures[schedule.uid] = failures
            return now + timedelta(seconds=retry_delay(failures))
        self._failures.pop(schedule.uid, None)
        return None

    def forget(self, uid: str) -> None:
        """The schedule is gone."""
        self._untold.forget(uid)
        self._failures.pop(uid, None)
