"""The Events of schedules, and how they are written.

An Event is written after the status that it reports, and again until the API server has taken it:
its name follows from its content, so one whose answer was lost is found written. Events that an
operator has not written when it ends are lost; the status holds the same.
"""

import logging
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime, timedelta

from bagpipe_operator.api import names
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.event_backlog import Creator, EventBacklog
from bagpipe_operator.cluster.events import Note, event
from bagpipe_operator.runtime.queue import retry_delay
from bagpipe_operator.schedules.view import ScheduleView

logger = logging.getLogger(__name__)


@dataclass
class EventRecorder:
    """One per operator. An API server that takes no Events delays no run: they wait separately."""

    api: Creator
    _backlog: EventBacklog = field(init=False)
    _failures: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._backlog = EventBacklog(self.api)

    def add(self, schedule: ScheduleView, notes: Iterable[Note]) -> None:
        """Keeps Events to be written."""
        self._backlog.add(schedule.uid, notes)

    async def write(self, schedule: ScheduleView, now: datetime) -> datetime | None:
        """Writes what is kept; when to try again, or None when nothing is left."""
        kind = names.SCHEDULE_KIND
        try:
            await self._backlog.write(schedule, lambda n: event(schedule, kind, n, n.mark, now))
        except ApiError as error:
            logger.warning(
                "%s/%s: Events are written later: %s", schedule.namespace, schedule.name, error
            )
            failures = self._failures.get(schedule.uid, 0) + 1
            self._failures[schedule.uid] = failures
            return now + timedelta(seconds=retry_delay(failures))
        self._failures.pop(schedule.uid, None)
        return None

    def forget(self, uid: str) -> None:
        """The schedule is gone."""
        self._backlog.forget(uid)
        self._failures.pop(uid, None)
