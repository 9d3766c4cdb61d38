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
        # The latest end of a chunk and of all that begin before it.
        self._ends = list(itertools.accumulate((c.end_time for c in self._chunks), max))

    def near(self, start: int, end: int) -> list[Chunk]:
        """Those that may have a message at a time t, start <= t < end, by their first times."""
        first = bisect.bisect_left(self._ends, start)
        found = self._chunks[first : bisect.bisect_left(self._starts, end)]
        return [chunk for chunk in found if chunk.end_time >= start]

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
