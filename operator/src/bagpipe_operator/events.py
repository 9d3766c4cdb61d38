"""Kubernetes Events for the transitions of a job: which ones (pure), and how they are written.

An Event is told after the status that it speaks of was written, so each transition is told at
most once: whoever reconciles next finds it in the status.
"""

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from uuid import uuid4

from bagpipe_operator import conditions, names, reasons
from bagpipe_operator.api import Api, ApiError
from bagpipe_operator.view import JobView, Json

logger = logging.getLogger(__name__)

NORMAL = "Normal"
WARNING = "Warning"
COMPONENT = "bagpipe-operator"
# The API server's limit for an Event's message.
LONGEST_NOTE = 1024


@dataclass(frozen=True)
class Note:
    """One thing to tell."""

    type: str
    reason: str
    message: str


def transitions(old: Iterable[Json], new: Iterable[Json]) -> list[Note]:
    """What is worth telling of the way from the old conditions to the new."""
    before = list(old)
    notes: list[Note] = []
    for condition in new:
        known = conditions.find(before, condition["type"])
        if known is not None and _same(known, condition):
            continue
        type_ = _worth(condition)
        told = any(note.reason == condition["reason"] for note in notes)
        if type_ is not None and not told:
            notes.append(Note(type_, condition["reason"], condition["message"]))
    return notes


def _same(known: Json, condition: Json) -> bool:
    return all(known.get(key) == condition[key] for key in ("status", "reason"))


def _worth(condition: Json) -> str | None:
    true = condition["status"] == "True"
    match condition["type"]:
        case conditions.FAILED:
            return WARNING if true else None
        case conditions.RUNNING if not true:
            return WARNING if condition["reason"] in reasons.TROUBLES else None
        case conditions.ACCEPTED if not true:
            return WARNING if condition["reason"] != reasons.IN_PROGRESS else None
        case _:
            return NORMAL if true else None


def manifest(job: JobView, note: Note, now: datetime) -> Json:
    """The Event as core/v1 wants it."""
    moment = conditions.timestamp(now)
    return {
        "apiVersion": "v1",
        "kind": "Event",
        "metadata": {"name": f"{job.name}.{uuid4().hex[:16]}", "namespace": job.namespace},
        "involvedObject": {
            "apiVersion": names.API_VERSION,
            "kind": names.KIND,
            "namespace": job.namespace,
            "name": job.name,
            "uid": job.uid,
            "resourceVersion": job.resource_version,
        },
        "type": note.type,
        "reason": note.reason,
        "message": note.message[:LONGEST_NOTE],
        "source": {"component": COMPONENT},
        "firstTimestamp": moment,
        "lastTimestamp": moment,
        "count": 1,
    }


async def tell(api: Api, job: JobView, notes: Iterable[Note], now: datetime) -> None:
    """Writes the Events; one that can't be written is logged, since the status says the same."""
    for note in notes:
        try:
            await api.create("events", manifest(job, note, now))
        except ApiError as error:
            logger.warning(
                "%s/%s: the event %s was not written: %s",
                job.namespace, job.name, note.reason, error,
            )  # fmt: skip
