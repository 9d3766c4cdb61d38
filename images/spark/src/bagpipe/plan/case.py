"""A case: the unit of scheduling, retry and verdict."""

from dataclasses import dataclass, field

from bagpipe.plan.conditions import Conditions
from bagpipe.plan.fragments import Window
from bagpipe.plan.parts import Part


@dataclass(frozen=True)
class Case:
    """One fragment through the stack: all that an executor needs, small enough for the JVM.

    `bag_version` is the mark that the file `bag` had when it was planned. `connections` are
    (offset, length) ranges of its CONNECTION records, `ranges` those of its chunks, in bytes.
    Cases of one `fragment` differ in their conditions alone. A case that is put together of
    `parts` reads these and no `bag`; its `bag_version` is the mark of them all.
    """

    id: str
    bag: str
    bag_version: str
    window: Window
    connections: list[tuple[int, int]]
    ranges: list[tuple[int, int]]
    messages: int
    fragment: str = ""
    conditions: Conditions = field(default_factory=Conditions)
    parts: list[Part] = field(default_factory=list)

    @property
    def bytes(self) -> int:
        """Bytes that the case reads from storage."""
        own = sum(length for _, length in self.connections + self.ranges)
        return own + sum(part.bytes for part in self.parts)
