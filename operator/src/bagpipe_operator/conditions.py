"""Conditions as Kubernetes writes them, and the rule for lastTransitionTime."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime

from bagpipe_operator.view import Json

ACCEPTED = "Accepted"
PLANNED = "Planned"
RUNNING = "Running"
COMPLETE = "Complete"
FAILED = "Failed"
SUSPENDED = "Suspended"

LONGEST_MESSAGE = 1024


@dataclass(frozen=True)
class Condition:
    """One statement about a job: `status` True or False, with the reason and a sentence."""

    type: str
    status: bool
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
        status = "True" if condition.status else "False"
        known = find(before, condition.type)
        kept = known is not None and known.get("status") == status
        result.append(
            {
                "type": condition.type,
                "status": status,
                "reason": condition.reason,
                "message": condition.message[:LONGEST_MESSAGE],
                "observedGeneration": generation,
                "lastTransitionTime": known["lastTransitionTime"]
                if kept and known
                else timestamp(now),
            }
        )
    return result
