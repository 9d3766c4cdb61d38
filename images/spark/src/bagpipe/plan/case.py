"""A case: the unit of scheduling, retry and verdict."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from bagpipe.plan.conditions import Conditions, Crossing
from bagpipe.plan.fragments import Window
from bagpipe.plan.part import Part


@dataclass(frozen=True)
class Case:
    """One fragment through the stack: all that an executor needs, small enough for the JVM.

    `bag_version` is the mark that the file `bag` had when it was planned. `connections` are
    (offset, length) ranges of what declares its connections, `ranges` those of its chunks, in
    bytes. Cases of one `fragment` differ in their conditions alone. A case that is put together of
    `parts` reads these and no `bag`; its `bag_version` is the mark of them all. `bag` is a URI, or
    a word without `://` where the source has no single recording. `stated` is a digest of the times
    that the recording's index states of these chunks, where they state some themselves.
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
    stated: str = ""

    @property
    def bytes(self) -> int:
        """Bytes that the case reads from storage."""
        own = sum(length for _, length in self.connections + self.ranges)
        return own + sum(part.bytes for part in self.parts)

    @property
    def pieces(self) -> dict[str, Any]:
        """What a row says of a case that is put together; nothing of another."""
        return {"parts": [part.as_row() for part in self.parts]} if self.parts else {}


def crossed(fragments: Iterable[Case], conditions: Crossing) -> list[Case]:
    """Each fragment under every condition, under a name of its own."""
    return [
        replace(case, id=case.id + suffix, fragment=case.id, conditions=condition)
        for case in fragments
        for suffix, condition in conditions.named
    ]
