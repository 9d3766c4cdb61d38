"""Conditions as Kubernetes writes them, and the rule for lastTransitionTime."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime

from bagpipe_operator.api.objects import Json

ACCEPTED = "Accepted"
PLANNED = "Planned"
RUNNING = "Running"
COMPLETE = "Complete"
FAILED = "Failed"
SUSPENDED = "Suspended"
PASSED = "Passed"
BASELINE_FOUND = "BaselineFound"
NOTIFIED = "Notified"

ENDS = (COMPLETE, FAILED)

LONGEST_MESSAGE = 1024
_STATUS = {True: "True", False: "False", None: "Unknown"}


@dataclass(frozen=True)
class Condition:
    """One statement about a job: True, False or (None) unknown, with the reason and a sentence."""

    type: str
    status: bool | None
    reason: str
    message: str


def timestamp(now: datetime) -> str:
    """A moment as Kubernetes writes it: UTC, whole seconds."""
    return now.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def find(conditions: Iterable[Json], type_: str) -> Json | None:
    """The condition of a type, if it was ever written."""
    return next((c for c in conditions if c.get("type") == type_), None)


def merged(
    old: Iterable[Json], new: Iterable[Condition], generation: int, now: datetime
) -> list[Json]:
    """The new conditions; one whose status did not change keeps its lastTransitionTime."""
    before = list(old)
    result: list[Json] = []
    for condition in new:
        known = find(before, condition.type)
        kept = known is not None and known.get("status") == _STATUS[condition.status]
        since = known["lastTransitionTime"] if kept and known else timestamp(now)
        result.append(written(condition, generation, since))
    return result


def written(condition: Condition, generation: int, since: str) -> Json:
    """A condition as a status holds it; `since` is when its status last changed."""
    return {
        "type": condition.type,
        "status": _STATUS[condition.status],
        "reason": condition.reason,
        "message": condition.message[:LONGEST_MESSAGE],
        "observedGeneration": generation,
        "lastTransitionTime": since,
    }
