"""The messages of a part of a recording, shifted into the case's time."""

import itertools
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import bagpipe
from bagpipe.encodings import ROS1, is_packed
from bagpipe.native import native
from bagpipe.plan.bag_tail import BagError
from bagpipe.plan.framing import framed
from bagpipe.plan.part import Part
from bagpipe.source.stamps import StampError, moved
from bagpipe.storage import Storage
from bagpipe.topic_names import resolve
from bagpipe.wire.frames import MAX_PAYLOAD_BYTES
from bagpipe.wire.session import SessionError

# Of a part's bytes as they are stored, of its uncompressed chunks, and of a whole sequence.
MOST_BYTES = 1 << 30


@dataclass(frozen=True)
class PartMessage:
    """A message of a part: its connection in the part's bag, its time in the case in ns, its
    bytes with their headers' stamps moved, and as they were recorded.
    """

    connection: Any
    time: int
    data: bytes
    recorded: bytes


class PartReader:
    """One part's piece of its recording, held in memory; its messages have one encoding."""

    def __init__(self, part: Part, storage: Storage, encoding: str) -> None:
        self._part = part
        if part.bytes > MOST_BYTES:
            raise _unreadable(part, f"the piece has {part.bytes} bytes, above 1 GiB: cut it")
        ranges = part.connections + part.ranges
        pieces = storage.pieces(part.bag, ranges, MAX_PAYLOAD_BYTES, part.version)
        try:
            data = b"".join(framed(ranges, pieces, part.stated))
            self._bag = in_memory(data, encoding, part.topics or None)
        except (BagError, ValueError) as error:
            raise _unreadable(part, str(error)) from error
        alike: Counter[str] = Counter()
        self._publishers: dict[int, tuple[str, str | int]] = {}
        for each in self._bag.connections:
            topic = resolve(each.topic)
            self._publishers[each.id] = (topic, each.callerid or alike[topic])
            alike[topic] += not each.callerid

    def publisher(self, connection: Any) -> tuple[str, str | int]:
        """Whose latched messages later ones replace: the topic, and the node's name or, where none
        was recorded, the number of the connection among the topic's.
        """
        return self._publishers[connection.id]

    @property
    def connections(self) -> list[Any]:
        """Those of the topics to be played, in the bag's order."""
        wanted = self._part.topics
        return [c for c in self._bag.connections if not wanted or resolve(c.topic) in wanted]

    def latched(self) -> list[PartMessage]:
        """What of each latching publisher is in force before the part, at the part's start."""
        start = self._part.window.lead_in_start
        last: dict[tuple[str, str | int], deque[tuple[Any, int, memoryview]]] = {}
        topics = sorted({c.topic for c in self.connections if c.in_force})
        if topics:
            for found in self._messages(topics, 0, start):
                if most := found[0].in_force:
                    known = last.setdefault(self.publisher(found[0]), deque(maxlen=most))
                    known.append(found)
        in_order = sorted(itertools.chain(*last.values()), key=lambda found: found[1])
        return [self._message(connection, start, raw) for connection, _, raw in in_order]

    def messages(self) -> Iterator[PartMessage]:
        """The lead-in and the window, in the bag's order. Raises SessionError."""
        window = self._part.window
        topics = sorted({connection.topic for connection in self.connections})
        for connection, time, raw in self._messages(topics, window.lead_in_start, window.end):
            yield self._message(connection, time, raw)

    def _messages(
        self, topics: list[str], start: int, end: int
    ) -> Iterator[tuple[Any, int, memoryview]]:
        try:
            yield from self._bag.messages(topics, start, end)
        except ValueError as error:
            raise _unreadable(self._part, str(error)) from error
        if (damage := self._bag.damage) is not None:
            raise _unreadable(self._part, f"expected {damage.description}")

    def _message(self, connection: Any, time: int, raw: memoryview) -> PartMessage:
        recorded = bytes(raw)
        if is_packed(connection.encoding, recorded):
            raise _unreadable(
                self._part,
                f"the messages of {connection.topic} were compressed one by one"
                " (--compression-mode message): make MCAP of the folder that the file lies in by"
                " `bagpipe bag convert`, and name that",
            )
        try:
            data = moved(connection, recorded, self._part.shift)
        except StampError as error:
            raise _unreadable(
                self._part,
                f"{connection.topic} at {time / 1e9:.3f} s can't be moved in time: {error}. Leave"
                " the topic out",
            ) from error
        return PartMessage(connection, time + self._part.shift, data, recorded)


def in_memory(data: bytes | memoryview, encoding: str, topics: list[str] | None = None) -> Any:
    """A recording, of which these topics are needed (none: all), for its messages of one encoding.

    Raises ValueError.
    """
    if encoding == ROS1:
        return bagpipe.MemoryBag(data, decompressed_bytes=MOST_BYTES, mcap_topics=topics)
    return native("MemoryMcap", "reading MCAP")(data, decompressed_bytes=MOST_BYTES)


def _unreadable(part: Part, why: str) -> SessionError:
    return SessionError("BagUnreadable", f"{part.bag}: {why}")
