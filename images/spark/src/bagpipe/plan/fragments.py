"""Cutting a bag into fragments, from its indexes alone.

A fragment's window is half-open, so each message counts in exactly one fragment whatever
the chunks' overlaps. Cuts move to a near chunk boundary, so that most chunks travel once.
A window in which nothing was recorded becomes no fragment, as it would prove nothing.
"""

import bisect
import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

from bagpipe.plan.bag_tail import BagError, BagTail, Chunk
from bagpipe.plan.by_time import ChunksByTime
from bagpipe.plan.in_force import Latched
from bagpipe.plan.stated_times import stated_by

# A cut may move this share of the length to meet a chunk boundary, and no remainder shorter
# than it becomes a fragment of its own.
_SNAP = 0.25
# As many windows as the driver can hold: a single wrong time makes more of them.
_MOST_WINDOWS = 1_000_000
# As many chunks in windows as it can hold: where all chunks span a recording, each window has all.
_MOST_PIECES = 10_000_000

# Times in ns of a chunk's messages for each connection; it raises BagError where nothing says them.
Times = Callable[[Chunk], dict[int, list[int]]]


@dataclass(frozen=True)
class Window:
    """Bag times in ns: messages with start <= t < end count; the lead-in before start does not."""

    lead_in_start: int
    start: int
    end: int


@dataclass(frozen=True)
class FragmentPlan:
    """One window and the (offset, length) byte ranges of the bag that it needs.

    `number` counts all windows of the bag, so that those behind an empty one keep their names.
    `stated` is a digest of the times that the index states of its chunks, if they state some too.
    """

    window: Window
    ranges: list[tuple[int, int]]
    messages: int
    number: int = 0
    stated: str = ""


def cut(
    tail: BagTail, topics: list[str], length: int, warm_up: int, times: Times | None = None
) -> list[FragmentPlan]:
    """The fragments of a bag for `topics` (resolved names; empty: all); times in ns.

    Empty where the bag has no message on any of the topics. A chunk that was open during a gap
    reaches over windows that it has no message in: `times` looks at its index records. Raises
    ValueError for a length of less than a nanosecond, and BagError where the times of the messages
    lie too far apart for that length, or too many chunks reach over too many windows.
    """
    if length < 1:
        raise ValueError(f"a fragment lasts at least 1 ns, and not {length}")
    wanted = {c.id for c in tail.connections if not topics or c.topic in topics}
    chunks = [chunk for chunk in tail.chunks if wanted & holding(chunk)]
    if not chunks:
        return []
    begin = min(chunk.start_time for chunk in chunks)
    end = max(chunk.end_time for chunk in chunks) + 1
    _check_room(chunks, begin, end, length)
    edges = _edges(begin, end, length, sorted(chunk.start_time for chunk in chunks))
    cutter = _Cutter(tail, chunks, wanted)
    recorded = _Recorded(cutter.by_time, wanted, times)
    return [
        replace(cutter.fragment(Window(max(begin, start - warm_up), start, stop)), number=number)
        for number, (start, stop) in enumerate(itertools.pairwise(edges))
        if recorded.between(start, stop)
    ]


def _check_room(chunks: list[Chunk], begin: int, end: int, length: int) -> None:
    """Raises BagError where the windows are more than the driver can hold, or their chunks."""
    windows = (end - begin) // length
    if windows > _MOST_WINDOWS:
        raise BagError(
            "BagUnreadable",
            f"its messages are logged from {begin} to {end - 1} ns, which is more than"
            f" {_MOST_WINDOWS:,} fragments of {length / 1e9:g} s: a time among them is wrong, or"
            " the fragments are too short",
        )
    pieces = sum(min(windows, (c.end_time - c.start_time) // length) for c in chunks)
    if pieces > _MOST_PIECES:
        raise BagError(
            "BagUnreadable",
            f"its {len(chunks):,} chunks overlap so much that fragments of {length / 1e9:g} s have"
            f" {pieces:,} of them in all, and at most {_MOST_PIECES:,} are planned: write it again"
            " in the order of its times (MCAP: `mcap sort`), or make the fragments longer",
        )


def cut_one(tail: BagTail, topics: list[str], window: Window) -> FragmentPlan:
    """The fragment of a window of one's own choice; it may have no message."""
    wanted = {c.id for c in tail.connections if not topics or c.topic in topics}
    chunks = [chunk for chunk in tail.chunks if wanted & holding(chunk)]
    return _Cutter(tail, chunks, wanted).fragment(window)


def has_messages(tail: BagTail, topics: list[str], window: Window, times: Times) -> bool:
    """Whether a window has a message of the topics, its lead-in left out; True where that is not
    known. A chunk that reaches over it says nothing of it, so that `times` may be asked.
    """
    wanted = {c.id for c in tail.connections if not topics or c.topic in topics}
    chunks = ChunksByTime(near(tail, wanted, window.start, window.end))
    return _Recorded(chunks, wanted, times).between(window.start, window.end)


def holding(chunk: Chunk) -> set[int]:
    """The connections that a chunk has messages of."""
    return {connection for connection, count in chunk.counts.items() if count}


def check_encoding(tail: BagTail, topics: list[str], encoding: str) -> None:
    """Raises BagError where a publisher of the topics (none: of any) has messages of another one,
    or of no type.

    One that published nothing does not count.
    """
    present = {number for chunk in tail.chunks for number in holding(chunk)}
    for each in tail.connections:
        wanted = each.id in present and (not topics or each.topic in topics)
        if wanted and each.encoding != encoding:
            raise BagError(
                "BagUnreadable",
                f"{each.topic} holds messages in {each.encoding or 'no known encoding'}, and the"
                f" stack would read them as {encoding}: leave it out of the topics",
            )
        if wanted and not each.datatype:
            raise BagError(
                "BagUnreadable",
                f"{each.topic} has messages of no type (in MCAP: of a channel without a schema):"
                " leave it out of the topics",
            )


def near(tail: BagTail, wanted: set[int], start: int, end: int) -> list[Chunk]:
    """The chunks that may have a message of these connections at a time t, start <= t < end."""
    return [
        chunk
        for chunk in tail.chunks
        if wanted & holding(chunk) and chunk.start_time < end and chunk.end_time >= start
    ]


class _Recorded:
    """When messages of some connections were recorded, as far as a bag's indexes show."""

    def __init__(self, chunks: ChunksByTime, wanted: set[int], times: Times | None) -> None:
        self._chunks, self._wanted, self._asked = chunks, wanted, times
        self._times: dict[int, list[int] | None] = {}

    def between(self, start: int, end: int) -> bool:
        """Whether a time t with start <= t < end has a message; True where that is unknown."""
        near = self._chunks.near(start, end)
        return any(self._surely(chunk, start, end) for chunk in near) or any(
            self._maybe(chunk, start, end) for chunk in near
        )

    def _surely(self, chunk: Chunk, start: int, end: int) -> bool:
        """By the tail: a chunk has a message at its first and one at its last time."""
        first, last = chunk.start_time >= start, chunk.end_time < end
        return (first and last) or ((first or last) and holding(chunk) <= self._wanted)

    def _maybe(self, chunk: Chunk, start: int, end: int) -> bool:
        if self._asked is None:
            return True
        if chunk.offset not in self._times:
            self._times[chunk.offset] = self._times_of(chunk, self._asked)
        times = self._times[chunk.offset]
        return times is None or bisect.bisect_left(times, start) < bisect.bisect_left(times, end)

    def _times_of(self, chunk: Chunk, times: Times) -> list[int] | None:
        """None where the chunk's own index is damaged: players don't need it, so it is no fault."""
        try:
            found = times(chunk)
        except BagError:
            return None
        return sorted(time for each in self._wanted for time in found.get(each, []))


def _edges(begin: int, end: int, length: int, boundaries: list[int]) -> list[int]:
    edges = [begin]
    for nominal in itertools.count(begin + length, length):
        if end - nominal < length * _SNAP:
            break
        edges.append(_snap(nominal, boundaries, int(length * _SNAP)))
    return [*edges, end]


def _snap(nominal: int, boundaries: list[int], tolerance: int) -> int:
    at = bisect.bisect_left(boundaries, nominal)  # the first one is where the bag begins: before
    best = min(boundaries[at - 1 : at + 1], key=lambda boundary: abs(boundary - nominal))
    return best if abs(best - nominal) <= tolerance else nominal


class _Cutter:
    """What a window needs of a bag; `chunks` are those that have a message of what is wanted."""

    def __init__(self, tail: BagTail, chunks: list[Chunk], wanted: set[int]) -> None:
        latching = [c for c in tail.connections if c.in_force and c.id in wanted]
        self.by_time = ChunksByTime(chunks)
        self._messages = {
            chunk.offset: sum(n for each, n in chunk.counts.items() if each in wanted)
            for chunk in chunks
        }
        self._in_force = Latched(chunks, latching)

    def fragment(self, window: Window) -> FragmentPlan:
        """The window with its lead-in, and with what is in force before that."""
        near = self.by_time.near(window.lead_in_start, window.end)
        needed = {chunk.offset: chunk for chunk in near}
        messages = sum(self._messages[offset] for offset in needed)
        for chunk in self._in_force.chunks_at(window.lead_in_start):
            needed[chunk.offset] = chunk
        chunks = list(needed.values())
        return FragmentPlan(window, ranges_of(chunks), messages, stated=stated_by(chunks))


def ranges_of(chunks: list[Chunk]) -> list[tuple[int, int]]:
    """Adjacent chunks join, so that storage sees few large reads."""
    ranges: list[tuple[int, int]] = []
    for chunk in sorted(chunks, key=lambda chunk: chunk.offset):
        if ranges and sum(ranges[-1]) == chunk.offset:
            offset, length = ranges[-1]
            ranges[-1] = (offset, length + chunk.end - chunk.offset)
        else:
            ranges.append((chunk.offset, chunk.end - chunk.offset))
    return ranges
