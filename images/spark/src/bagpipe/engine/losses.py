"""Whose fault a loss is: the stack's, or that of a machine that kept it from its messages. Pure.

A machine that is busy excuses no loss by itself, since some machine always is. It must have kept
the very node that lost from running, and for about as long as the lost messages took to come: a
node whose queue holds one message misses the next one only if it does not run for a period.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

# A thread waits in slices, and messages come unevenly: half of the time must be explained.
_EXPLAINED = 0.5
# After the last input a node that was only kept from its messages takes the rest of them soon.
_SOON_SECONDS = 2.0
# A sentence names a few nodes; the ledger has all.
_MOST_NAMED = 5


@dataclass(frozen=True)
class Loss:
    """What one node did not process of one topic."""

    node: str
    topic: str
    sent: int
    received: int
    dropped: int
    queue: int | None
    waited: float | None

    @property
    def missing(self) -> int:
        """How many did not arrive, also where they were not counted as dropped."""
        return max(self.dropped, self.sent - self.received)

    @property
    def sentence(self) -> str:
        """What was lost, where."""
        text = (
            f"{self.node} processed {self.received} of {self.sent} messages on {self.topic},"
            f" {self.dropped} dropped"
        )
        return text if self.queue is None else f"{text}, {self.queue} in its queue"


def losses(result: Mapping[str, Any]) -> Iterator[Loss]:
    """Each subscriber's loss of a RESULT's ledger, in its order."""
    for topic in result["ledger"]["topics"]:
        for line in topic["subscribers"]:
            if line["received"] != topic["sent"] or line["dropped"]:
                yield Loss(
                    line["node"], topic["topic"], topic["sent"], line["received"],
                    line["dropped"], line.get("queue"), line.get("waited_seconds"),
                )  # fmt: skip


def by_the_machine(loss: Loss, result: Mapping[str, Any], mode: str) -> bool:
    """Whether the machine was busy and can have caused as large a loss.

    Only in `realtime` does a message come at its own time, whatever the node is doing: elsewhere a
    slow machine slows the player too. Where nobody measured the machine, or how long the node
    waited (it came late, or is gone), nothing speaks for the machine's fault. A node that let the
    drain go by without taking what was left, and without waiting for a processor, is not kept from
    it by a machine. The machine's `stall_max_seconds` and `late_max_seconds` count as well: while
    all stands still, no thread is seen to wait.
    """
    machine = result.get("machine") or {}
    if mode != "realtime" or not machine.get("busy") or loss.waited is None:
        return False
    kept = loss.waited + machine["stall_max_seconds"] + machine["late_max_seconds"]
    period = result["playback"]["played_seconds"] / max(1, loss.sent)
    came = loss.missing * period
    drain = (result.get("timings") or {}).get("drain")
    if drain and _nodes(result) == {loss.node}:  # else it may have been another node's
        came = max(came, drain - _SOON_SECONDS)
    return bool(kept >= _EXPLAINED * came)


def _nodes(result: Mapping[str, Any]) -> set[str]:
    lines = (line for topic in result["ledger"]["topics"] for line in topic["subscribers"])
    return {line["node"] for line in lines}


def why(loss: Loss, result: Mapping[str, Any]) -> str:
    """What was measured of the machine, in parentheses; empty where nothing was."""
    machine = result.get("machine") or {}
    parts = [machine["message"]] if machine.get("message") else []
    if machine.get("busy") and loss.waited is not None:
        parts.append(f"{loss.node} itself waited {loss.waited:.2f} s for a processor")
    return f" ({'; '.join(parts)})" if parts else ""


def others(found: Sequence[Loss], named: Loss) -> str:
    """The other losses, in short; empty where there is none."""
    rest = [f"{loss.node} {loss.dropped} on {loss.topic}" for loss in found if loss is not named]
    more = f" and {len(rest) - _MOST_NAMED} more" if len(rest) > _MOST_NAMED else ""
    return f"; also lost: {', '.join(rest[:_MOST_NAMED])}{more}" if rest else ""
