"""Kubernetes Events: how they look. Pure.

An Event's name follows from what it reports, so whoever writes it a second time (a retry, the
operator's next run) finds it written.
"""

import hashlib
from dataclasses import dataclass, field
from datetime import datetime
from typing import Protocol

from bagpipe_operator.api import conditions, names
from bagpipe_operator.api.objects import Json

NORMAL = "Normal"
WARNING = "Warning"
COMPONENT = "bagpipe-operator"
# The API server's limit for an Event's message.
LONGEST_NOTE = 1024


@dataclass(frozen=True)
class Note:
    """One thing to report."""

    type: str
    reason: str
    message: str
    # What makes it this transition and no other of the same reason.
    mark: str = field(default="", compare=False)


class Subject(Protocol):
    """An object of ours that an Event can be about."""

    @property
    def namespace(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def uid(self) -> str: ...
    @property
    def resource_version(self) -> str: ...


def event(about: Subject, kind: str, note: Note, mark: str, now: datetime) -> Json:
    """The Event as core/v1 wants it; its name is always the same for one mark of one reason."""
    moment = conditions.timestamp(now)
    identity = f"{about.uid} {note.reason} {mark}"
    name = f"{about.name}.{hashlib.sha256(identity.encode()).hexdigest()[:16]}"
    return {
        "apiVersion": "v1",
        "kind": "Event",
        "metadata": {"name": name, "namespace": about.namespace},
        "involvedObject": {
            "apiVersion": names.API_VERSION,
            "kind": kind,
            "namespace": about.namespace,
            "name": about.name,
            "uid": about.uid,
            "resourceVersion": about.resource_version,
        },
        "type": note.type,
        "reason": note.reason,
        "message": note.message[:LONGEST_NOTE],
        "source": {"component": COMPONENT},
        "firstTimestamp": moment,
        "lastTimestamp": moment,
        "count": 1,
    }
