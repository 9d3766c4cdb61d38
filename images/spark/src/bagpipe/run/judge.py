"""The verdict on one played case, from the agent's RESULT alone."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

from bagpipe.faults import FaultPolicy

Outcome = Literal["passed", "failed", "invalid", "errored"]

_NO_POLICY = FaultPolicy([])


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


def judge(result: dict[str, Any], policy: FaultPolicy = _NO_POLICY) -> Judgement:
    """Judge a RESULT map: how the stack ended, what it lost, and whether anything was said.

    Ends come first, since a node that has crashed receives nothing more.
    """
    faults = (*ends(result), *_losses(result))
    return first_that_counts(faults, policy, _evidence(result))


def first_that_counts(
    faults: Iterable[Judgement], policy: FaultPolicy, otherwise: Judgement
) -> Judgement:
    """The first fault that the job does not allow, with those before it that it does."""
    allowed: list[Allowed] = []
    for found in faults:
        if not policy.allows(found.reason):
            return replace(found, allowed=tuple(allowed))
        allowed.append(Allowed(found.reason, found.message))
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


def _losses(result: dict[str, Any]) -> Iterator[Judgement]:
    """The first loss, or the first figure that can't be.

    A loss is the stack's unless the machine is shown to have been too busy: where nobody measured
    that, nothing speaks for the machine's fault.
    """
    for topic in result["ledger"]["topics"]:
        for subscriber in topic["subscribers"]:
            received, dropped = subscriber["received"], subscriber["dropped"]
            if received > topic["sent"]:
                yield Judgement(
                    "errored",
                    "ProtocolError",
                    f"{subscriber['node']} says that it received {received} messages on"
                    f" {topic['topic']}, and {topic['sent']} were sent: the ledger proves nothing",
                )
                return
            if received != topic["sent"] or dropped:
                yield _loss(topic, subscriber, result.get("machine") or {})
                return


def _loss(topic: dict[str, Any], subscriber: dict[str, Any], machine: dict[str, Any]) -> Judgement:
    message = (
        f"{subscriber['node']} processed {subscriber['received']} of {topic['sent']} messages on"
        f" {topic['topic']}, {subscriber['dropped']} dropped"
    )
    if (queue := subscriber.get("queue")) is not None:
        message += f", {queue} in its queue"
    said = f" ({machine['message']})" if machine.get("message") else ""
    if machine.get("busy"):
        return Judgement(
            "errored",
            "MachineBusy",
            f"{message}, while the machine was too busy{said}: give the stack more CPU, use fewer"
            " spark.slots or play slower",
        )
    return Judgement(
        "failed",
        "MessagesLost",
        f"{message}{said}: its queue is shorter than its delay; play slower or give the node a"
        " longer queue",
    )
