"""The verdict on one played case, from the agent's RESULT alone."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

from bagpipe.faults import FaultPolicy
from bagpipe.run.losses import by_the_machine, losses, others, why

Outcome = Literal["passed", "failed", "invalid", "errored"]

_NO_POLICY = FaultPolicy([])
# A job that allows a loss allows it whoever caused it.
_CAUSES = {"MachineBusy": "MessagesLost"}


@dataclass(frozen=True)
class Allowed:
    """An end or a loss of the stack that the job's faultPolicy allows; it is told all the same."""

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


def judge(
    result: dict[str, Any], policy: FaultPolicy = _NO_POLICY, mode: str = "realtime"
) -> Judgement:
    """Judge a RESULT map: how the stack ended, what it lost, and whether anything was said.

    Ends come first, since a node that has crashed receives nothing more.
    """
    faults = (*ends(result), *_losses(result, mode))
    return first_that_counts(faults, policy, _evidence(result))


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


def _evidence(result: dict[str, Any]) -> Judgement:
    if result["ledger"]["sent"] == 0:
        return Judgement(
            "invalid", "NothingPlayed", "the fragment's window holds no message on the topics"
        )
    if result["recorded"]["messages"] == 0:
        return Judgement(
            "invalid", "NothingRecorded", "the stack published nothing on the recorded topics"
        )
    return Judgement("passed")


def _losses(result: dict[str, Any], mode: str) -> Iterator[Judgement]:
    """The first figure that can't be, else the first loss of the stack's, else of the machine's."""
    found = list(losses(result))
    for loss in found:
        if loss.received > loss.sent:
            yield Judgement(
                "errored",
                "ProtocolError",
                f"{loss.node} says that it received {loss.received} messages on {loss.topic}, and"
                f" {loss.sent} were sent: the ledger proves nothing",
            )
            return
    for loss in found:
        if not by_the_machine(loss, result, mode):
            yield Judgement(
                "failed",
                "MessagesLost",
                f"{loss.sentence}{why(loss, result)}: its queue is shorter than its delay; play"
                f" slower or give the node a longer queue{others(found, loss)}",
            )
            return
    for loss in found[:1]:
        yield Judgement(
            "errored",
            "MachineBusy",
            f"{loss.sentence}, while the machine was too busy{why(loss, result)}: give the stack"
            f" more CPU, use fewer spark.slots or play slower{others(found, loss)}",
        )
