"""Bags by URI or path, for `bagpipe bag`: what they hold, whole or a part of them in memory."""

import contextlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, Any

import bagpipe
from bagpipe.plan.bag_tail import BagError, BagTail, compression_of, read_tail
from bagpipe.plan.fragments import Window, cut_one
from bagpipe.plan.framing import framed
from bagpipe.storage import Storage
from bagpipe.topic_names import resolve

if TYPE_CHECKING:
    from bagpipe import MemoryBag

_PIECE_BYTES = 1 << 20
# Each chunk's compression stands at its own beginning: a read for each, which costs nothing here
# and a request elsewhere.
_MOST_REMOTE_CHUNKS = 64
_STATES = {"BagNotIndexed": "missing", "BagCut": "cut", "BagUnreadable": "damaged"}
# Bags of before 2010, which have no index of this kind.
_OLD = b"#ROSBAG V1.2\n"
_ADVICE = {
    "none": "format 1.2, which a job refuses: `bagpipe bag reindex BAG --to NEW` writes 2.0",
    "missing": "a job refuses it: `bagpipe bag reindex BAG --to NEW` writes its index",
    "cut": "copy it again, or `bagpipe bag reindex BAG --to NEW` saves what is whole",
    "damaged": "`bagpipe bag reindex BAG --to NEW` saves what is whole",
}


class BagRefusedError(Exception):
    """A bag can't be read or made; the sentence names it and says what to do."""


@dataclass(frozen=True)
class BagFile:
    """One bag, wherever it lies. Every method raises StorageError and BagRefusedError."""

    uri: str
    storage: Storage
    # The most bytes that it may take in memory, as read and again as uncompressed.
    budget: int

    def described(self) -> dict[str, Any]:
        """What is in it: of an indexed bag from its tail, of another by reading all of it."""
        file = self.storage.open(self.uri)
        try:
            tail = read_tail(file.read, file.size)
        except BagError as error:
            bag = self.whole()
            old = file.read(0, len(_OLD)) == _OLD
            state = "none" if old else _STATES.get(error.reason, "whole")
            return self._head(file.size, state) | _of_memory(bag)
        few = self.uri.startswith("file://") or len(tail.chunks) <= _MOST_REMOTE_CHUNKS
        known = sorted({compression_of(file.read, chunk) for chunk in tail.chunks}) if few else None
        return self._head(file.size, "whole") | _of_tail(tail, known)

    def times(self) -> tuple[int, int]:
        """Those of its first and last message in ns; 0 without one."""
        file = self.storage.open(self.uri)
        try:
            return times_of(read_tail(file.read, file.size))
        except BagError:
            bag = self.whole()
            return bag.start or 0, bag.end or 0

    def whole(self) -> "MemoryBag":
        """All of it, in whatever state it is."""
        file = self.storage.open(self.uri)
        self._bounded(file.size, "use bagpipe-agent's verbs, which read a file chunk by chunk")
        return self._opened(file.read(0, file.size))

    def part(
        self, start: int, end: int | None, topics: tuple[str, ...], compression: Any
    ) -> "MemoryBag":
        """Messages with start <= t < end, in ns after its first one, and what is latched then.

        Of an indexed bag only those chunks are read that are needed.
        """
        file = self.storage.open(self.uri)
        try:
            tail = read_tail(file.read, file.size)
        except BagError:
            bag = self.whole()
            first, last = bag.start or 0, bag.end or 0
        else:
            first, last = times_of(tail)
            self._reaches(start, last - first)
            self._known(topics, {connection.topic for connection in tail.connections})
            until = last + 1 if end is None else min(first + end, last + 1)
            planned = cut_one(tail, list(topics), Window(first + start, first + start, until))
            ranges = tail.declarations + planned.ranges
            self._bounded(sum(length for _, length in ranges), "cut a shorter part")
            data = b"".join(framed(ranges, file.pieces(ranges, _PIECE_BYTES)))
            bag = self._opened(data, topics)
        self._reaches(start, last - first)
        until = last + 1 if end is None else first + end
        self._known(topics, {resolve(topic) for topic in bag.topics})
        names = [topic for topic in bag.topics if not topics or resolve(topic) in topics]
        with naming(self.uri):
            return bag.slice(first + start, until, names, compression=compression)

    def _opened(self, data: bytes, topics: tuple[str, ...] = ()) -> "MemoryBag":
        with naming(self.uri):
            return native()(data, decompressed_bytes=self.budget, mcap_topics=topics or None)

    def _bounded(self, size: int, instead: str) -> None:
        if size > self.budget:
            raise BagRefusedError(
                f"{self.uri}: {size:,} bytes are more than --memory-budget allows: raise it, or"
                f" {instead}"
            )

    def _reaches(self, start: int, length: int) -> None:
        if start > length:
            raise BagRefusedError(
                f"{self.uri} lasts {_seconds(length)} s: --start {_seconds(start)} lies behind its"
                " last message"
            )

    def _known(self, topics: tuple[str, ...], present: set[str]) -> None:
        for topic in topics:
            if topic not in present:
                have = ", ".join(sorted(present)[:10]) or "none"
                raise BagRefusedError(f"{self.uri} has no topic {topic}; it has {have}")

    def _head(self, size: int, state: str) -> dict[str, Any]:
        return {"bag": self.uri, "bytes": size, "index": state, "advice": _ADVICE.get(state)}


def native() -> "type[MemoryBag]":
    """bagpipe.MemoryBag. Raises BagRefusedError where its module is not installed."""
    try:
        return bagpipe.MemoryBag
    except ImportError as error:
        raise BagRefusedError(str(error)) from error


@contextlib.contextmanager
def naming(uri: str) -> Iterator[None]:
    """What is wrong with a bag, with its name."""
    try:
        yield
    except ValueError as error:
        raise BagRefusedError(f"{uri}: {error}") from error


def damage_of(bag: "MemoryBag") -> dict[str, Any] | None:
    """What a bag has lost, as data."""
    return damage_data(bag.damage)


def damage_data(lost: Any) -> dict[str, Any] | None:
    """The native module's damage as data; None where nothing is lost."""
    if lost is None:
        return None
    return {
        "offset": lost.offset,
        "bytes": lost.bytes,
        "messages": lost.messages,
        "description": lost.description,
    }


def _seconds(nanoseconds: int) -> str:
    return f"{Decimal(nanoseconds).scaleb(-9).normalize():f}"


def times_of(tail: BagTail) -> tuple[int, int]:
    """Of an indexed recording those of the first and the last message, in ns."""
    starts, ends = zip(*((chunk.start_time, chunk.end_time) for chunk in tail.chunks), strict=True)
    return min(starts), max(ends)


def _of_tail(tail: BagTail, compressions: list[str] | None) -> dict[str, Any]:
    counts: Counter[int] = Counter()
    for chunk in tail.chunks:
        counts.update(chunk.counts)
    topics = [(each.topic, each.datatype, counts[each.id]) for each in tail.connections]
    return _described(
        *times_of(tail),
        len(tail.chunks),
        compressions,
        topics,
    )


def _of_memory(bag: "MemoryBag") -> dict[str, Any]:
    counts = Counter(connection.id for connection, _, _ in bag.messages())
    topics = [(resolve(each.topic), each.type, counts[each.id]) for each in bag.connections]
    described = _described(bag.start, bag.end, bag.chunk_count, bag.compressions, topics)
    return described | {"damage": damage_of(bag)}


def _described(
    start: int | None,
    end: int | None,
    chunks: int,
    compressions: list[str] | None,
    topics: list[tuple[str, str, int]],
) -> dict[str, Any]:
    rows: Counter[tuple[str, str]] = Counter()
    for topic, kind, messages in topics:
        rows[topic, kind] += messages
    seconds = None if start is None or end is None else round((end - start) / 1e9, 9)
    return {
        "start": start,
        "end": end,
        "seconds": seconds,
        "messages": sum(rows.values()),
        "chunks": chunks,
        "compressions": compressions,
        "topics": [
            {"topic": topic, "type": kind, "messages": messages}
            for (topic, kind), messages in sorted(rows.items())
        ],
        "damage": None,
    }
