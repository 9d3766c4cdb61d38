"""The Events of schedules: how they look, and how they are written.

An Event is told after the status that it speaks of was written, and again until it is written: its
name follows from what it tells, so one whose answer was lost is found written. What an operator has
not told when it ends, nobody tells; the status says it.
"""

import hashlib
import logging
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Protocol

from bagpipe_operator import conditions, names
from bagpipe_operator.api import ApiError
from bagpipe_operator.events import COMPONENT, LONGEST_NOTE
from bagpipe_operator.queue import retry_delay
from bagpipe_operator.schedules.view import ScheduleView
from bagpipe_operator.teller import MOST_UNTOLD, TRANSIENT
from bagpipe_operator.view import Json

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Told:
    """One thing to tell; `type` is Normal or Warning."""

    type: str
    reason: str
    message: str
    # What makes it this transition and no other of the same reason.
    mark: str = field(default="", compare=False)


class Creator(Protocol):
    """What telling needs of an API server."""

    async def create(self, resource: str, manifest: Json) -> Json:
        """Creates a core/v1 object in its namespace; raises ApiError."""


def manifest(schedule: ScheduleView, told: Told, now: datetime) -> Json:
    """The Event as core/v1 wants it."""
    moment = conditions.timestamp(now)
    return {
        "apiVersion": "v1",
        "kind": "Event",
        "metadata": {
            "name": _name(schedule, told),
            "namespace": schedule.namespace,
        },
        "involvedObject": {
            "apiVersion": names.API_VERSION,
            "kind": names.SCHEDULE_KIND,
            "namespace": schedule.namespace,
            "name": schedule.name,
            "uid": schedule.uid,
            "resourceVersion": schedule.resource_version,
        },
        "type": told.type,
        "reason": told.reason,
        "message": told.message[:LONGEST_NOTE],
        "source": {"component": COMPONENT},
        "firstTimestamp": moment,
        "lastTimestamp": moment,
        "count": 1,
    }


def _name(schedule: ScheduleView, told: Told) -> str:
    """Of one transition always the same."""
    identity = f"{schedule.uid} {told.reason} {told.mark}"
    return f"{schedule.name}.{hashlib.sha256(identity.encode()).hexdigest()[:16]}"


@dataclass
class Teller:
    """One per operator. An API server that takes no Events holds no run up: they wait beside it."""

    api: Creator
    _untold: dict[str, list[Told]] = field(default_factory=dict)
    _failures: dict[str, int] = field(default_factory=dict)

    def add(self, schedule: ScheduleView, notes: Iterable[Told]) -> None:
        """Keeps what is to be told."""
        notes = [*self._untold.get(schedule.uid, ()), *notes][-MOST_UNTOLD:]
        if notes:
            self._untold[schedule.uid] = notes

    async def tell(self, schedule: ScheduleView, now: datetime) -> datetime | None:
        """Writes what is kept; when to try again, or None when nothing is left."""
        notes = self._untold.get(schedule.uid, [])
        while notes:
            try:
                await self.api.create("events", manifest(schedule, notes[0], now))
            except ApiError as error:
                if error.status != 409:  # 409: its answer was lost
                    logger.warning(
                        "%s/%s: the event %s was not written: %s",
                        schedule.namespace, schedule.name, notes[0].reason, error,
                    )  # fmt: skip
                if error.status in TRANSIENT:
                    failures = self._failures.get(schedule.uid, 0) + 1
                    self._failures[schedule.uid] = failures
                    return now + timedelta(seconds=retry_delay(failures))
            del notes[0]  # only now: a call that is cancelled is made again
        self.forget(schedule.uid)
        return None

    def forget(self, uid: str) -> None:
        """The schedule is gone, or all is told."""
        self._untold.pop(uid, None)
        self._failures.pop(uid, None)
