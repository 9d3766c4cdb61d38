"""The verdict on one case: what it is, and how faults of the stack come to it. Pure."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

from bagpipe.faults import FaultPolicy

Outcome = Literal["passed", "failed", "invalid", "errored"]

# A job that allows a loss allows it whoever caused it.
_CAUSES = {"MachineBusy": "MessagesLost"}


@dataclass(frozen=True)
class Allowed:
    """An end or a loss of the stack that the job's faultPolicy allows; it is still reported."""

    cause: str
    message: str

    def as_row(self) -> dict[str, str]:
        """As the results have it."""
        return {"cause": self.cause, "message": self.message}


@dataclass(frozen=True)
class Judgement:
    """A case's outcome and the sentence behind it."""

    outcome: Outcome
    reason: str = ""
    message: str = ""
    allowed: tuple[Allowed, ...] = ()


def first_that_counts(
    faults: Iterable[Judgement], policy: FaultPolicy, otherwise: Judgement
) -> Judgement:
    """The first fault that the job does not allow, with those before it that it does."""
    allowed: list[Allowed] = []
    for found in faults:
        cause = _CAUSES.get(found.reason, found.reason)
        if not policy.allows(cause):
            return replace(found, allowed=tuple(allowed))
        allowed.append(Allowed(cause, found.message))
    return replace(otherwise, allowed=tuple(allowed))


def ends(result: dict[str, Any]) -> Iterator[Judgement]:
    """The ends of the stack's processes and nodes that count, in order of time."""
    for end in result["stack"].get("ended") or []:
        yield Judgement("failed", str(end["cause"]), str(end["message"]))
