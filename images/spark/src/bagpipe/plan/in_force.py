"""Which chunks hold the latched messages that are in force at a time.

How many of a channel are is the native module's to say, as the agent's crates have it
(`images/agent/crates/log`), unless a job says it of the topic.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from bagpipe.plan.bag_tail import BagTail, Chunk, Connection
from bagpipe.plan.by_time import ChunksByTime
from bagpipe.topic_names import resolve


@dataclass(frozen=True)
class Late:
    """What late subscribers get of a topic: whether it latches, how many messages; None: as
    recorded.
    """

    latching: bool | None = None
    depth: int | None = None

    def in_force(self, as_recorded: int) -> int:
        """How many messages are in force of a channel that has so many as it was recorded."""
        if self.latching is False or (self.latching is None and not as_recorded):
            return 0
        return max(as_recorded, 1) if self.depth is None else self.depth


def as_wanted(tail: BagTail, late: Mapping[str, Late]) -> BagTail:
    """The tail with as many messages in force as a job wants; the topics are recorded names."""
    by_topic = {resolve(topic): wanted for topic, wanted in late.items()}

    def wanted(each: Connection) -> Connection:
        found = by_topic.get(each.topic, Late())
        return replace(each, in_force=found.in_force(each.in_force))

    return replace(tail, connections=[wanted(each) for each in tail.connections])


class Latched:
    """Where the messages of some connections lie that are in force at a time."""

    def __init__(self, chunks: list[Chunk], connections: Iterable[Connection]) -> None:
        self._held = [
            (each, ChunksByTime(chunk for chunk in chunks if chunk.counts.get(each.id)))
            for each in connections
        ]

    def chunks_at(self, time: int) -> list[Chunk]:
        """The chunks that may hold what is in force of each connection at a time (ns)."""
        return [
            chunk
            for each, held in self._held
            for chunk in held.holding_last(each.id, each.in_force, time)
        ]
