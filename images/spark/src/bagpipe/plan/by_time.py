"""Chunks in the order of their times, so that each of many windows finds its own without all."""

import bisect
import itertools
from collections.abc import Iterable

from bagpipe.plan.bag_tail import Chunk


class ChunksByTime:
    """Chunks that may overlap; times in ns."""

    def __init__(self, chunks: Iterable[Chunk]) -> None:
        self._chunks = sorted(chunks, key=lambda chunk: chunk.start_time)
        self._starts = [chunk.start_time for chunk in self._chunks]
        ends = [chunk.end_time for chunk in self._chunks]
        # The latest end of a chunk and of all that begin before it.
        self._ends = list(itertools.accumulate(ends, max))
        self._latest = _of_twice_as_many(ends)

    def near(self, start: int, end: int) -> list[Chunk]:
        """Those that may have a message at a time t, start <= t < end, by their first times.

        It takes time for those that are found, and not for all between them: one that spans the
        recording would have each window look at all chunks before it.
        """
        at, until = bisect.bisect_left(self._ends, start), bisect.bisect_left(self._starts, end)
        found = []
        while at < until:
            if self._latest[0][at] >= start:
                found.append(self._chunks[at])
                at += 1
            else:
                at += self._ended_before(start, at)
        return found

    def _ended_before(self, start: int, at: int) -> int:
        """How many chunks from this one on, which has ended by then, have surely ended by then."""
        level = 0
        for latest in self._latest[1:]:
            if at % (2 << level) or latest[at >> (level + 1)] >= start:
                break
            level += 1
        return 1 << level

    def holding_last(self, connection: int, messages: int, before: int) -> list[Chunk]:
        """Those that may hold a connection's last messages before a time; all must have some of it.

        As they may overlap, all are taken that could hold a later message than is certain.
        """
        certain, missing = 0, messages
        for at in range(bisect.bisect_left(self._starts, before) - 1, -1, -1):
            chunk = self._chunks[at]
            if chunk.end_time >= before:
                continue
            missing -= chunk.counts[connection]
            if missing <= 0:
                certain = chunk.start_time
                break
        return self.near(certain, before)


def _of_twice_as_many(ends: list[int]) -> list[list[int]]:
    """The latest of each 1, 2, 4, ... ends, from the first one on, up to that of all."""
    levels = [ends]
    while len(levels[-1]) > 1:
        pairs = itertools.zip_longest(levels[-1][::2], levels[-1][1::2])
        levels.append([first if second is None else max(first, second) for first, second in pairs])
    return levels
