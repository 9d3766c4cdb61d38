"""Which chunks hold the latched messages that are in force at a time.

How many of a channel are is the native module's to say, as the agent's crates have it
(`images/agent/crates/log`), unless a job says it of the topic.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from bagpipe.plan.bag_tail import BagTail, Chunk, Connection, resolve


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


def chunks_in_force(
    chunks: list[Chunk], before: int, connections: Iterable[Connection]
) -> list[Chunk]:
    """The chunks that may hold what is in force of each connection at a time (ns).

    Chunks may overlap, so all those are taken that could hold a later message than is certain.
    """
    found = []
    for each in connections:
        earlier = [c for c in chunks if c.counts.get(each.id) and c.start_time < before]
        whole = sorted((c for c in earlier if c.end_time < before), key=lambda c: -c.start_time)
        certain, missing = 0, each.in_force
        for chunk in whole:
            missing -= chunk.counts[each.id]
            if missing <= 0:
                certain = chunk.start_time
                break
        found += [c for c in earlier if c.end_time >= certain]
    return found
