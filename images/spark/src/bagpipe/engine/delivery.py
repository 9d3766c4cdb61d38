"""The verdict on one played case, from the agent's RESULT alone."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from bagpipe.engine.losses import Loss, by_the_machine, losses, others, why
from bagpipe.faults import FaultPolicy
from bagpipe.judgement import Judgement, ends, first_that_counts

_NO_POLICY = FaultPolicy([])


@dataclass(frozen=True)
class Proof:
    """What a ledger has to say of each subscriber: one of these strengths.

    `lacking` gives a judgement on a RESULT in which one has another; the figures of such are none.
    """

    strengths: frozenset[str]
    lacking: Callable[[Mapping[str, Any]], Iterator[Judgement]]

    def mark(self, result: Mapping[str, Any]) -> None:
        """Puts `proved: false` to each line of the RESULT's ledger whose figures are none: its
        readers don't know the engine, and the same word proves a delivery in another one.
        """
        for topic in result["ledger"]["topics"]:
            for line in topic["subscribers"]:
                if line["strength"] not in self.strengths:
                    line["proved"] = False


def judge(
    result: dict[str, Any],
    policy: FaultPolicy = _NO_POLICY,
    mode: str = "realtime",
    proof: Proof | None = None,
) -> Judgement:
    """Judge a RESULT map: how the stack ended, what it lost, what of its delivery nobody can
    prove (None: each strength is a proof), and whether it published anything.

    Ends come first, since a node that has crashed receives nothing more. A loss that is known goes
    before one that is only possible.
    """
    found = list(losses(result, proof.strengths if proof else None))
    faults = [*ends(result), *_impossible(found)]
    if not policy.allows("MessagesLost"):
        faults += _left_early(result, found)
    faults += _losses(result, found, mode)
    if proof is not None:
        faults += proof.lacking(result)
    return first_that_counts(faults, policy, _evidence(result))


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


def _impossible(found: list[Loss]) -> Iterator[Judgement]:
    """The first figure that can't be."""
    for loss in found:
        if loss.received > loss.sent:
            yield Judgement(
                "errored",
                "ProtocolError",
                f"{loss.node} says that it received {loss.received} messages on {loss.topic}, and"
                f" {loss.sent} were sent: the ledger proves nothing",
            )
            return


def _left_early(result: dict[str, Any], found: list[Loss]) -> Iterator[Judgement]:
    """The first node that left the graph without all of its messages.

    The graph may have had it until all input was out, since a node that is busy leaves slowly. A
    job that allows losses allows a node to leave after the last input as any other may.
    """
    left = result["stack"].get("left") or []
    for loss in found:
        if loss.node in left:
            yield Judgement(
                "failed",
                "NodeGone",
                f"the node {loss.node} left the graph, while its process lived on, without all of"
                f" its messages: {loss.sentence}{others(found, loss)}",
            )
            return


def _losses(result: dict[str, Any], found: list[Loss], mode: str) -> Iterator[Judgement]:
    """The first loss of the stack's, else of the machine's."""
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
