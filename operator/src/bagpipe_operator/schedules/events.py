"""The Events of schedules: how they look, and how they are written.

An Event is told after the status that it speaks of was written, so it is told at most once:
whoever reconciles next finds it in the status.
"""

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from typing import Protocol
from uuid import uuid4

from bagpipe_operator import conditions, names
from bagpipe_operator.api import ApiError
from bagpipe_operator.events import COMPONENT, LONGEST_NOTE
from bagpipe_operator.schedules.view import ScheduleView
from bagpipe_operator.view import Json

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Told:
    """One thing to tell; `type` is Normal or Warning."""

    type: str
    reason: str
    message: str


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
            "name": f"{schedule.name}.{uuid4().hex[:16]}",
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


async def tell(api: Creator, schedule: ScheduleView, notes: Iterable[Told], now: datetime) -> None:
    """Writes the Events; one that can't be written is logged, since the status says the same."""
    for told in notes:
        try:
            await api.create("events", manifest(schedule, told, now))
        except ApiError as error:
            logger.warning(
                "%s/%s: the event %s was not written: %s",
                schedule.namespace, schedule.name, told.reason, error,
            )  # fmt: skip
