"""When a case's inputs were recorded, read from its recording's indexes alone."""

from bagpipe.plan.bag_tail import BagError, BagTail, Chunk
from bagpipe.plan.fragments import Times, near


def times_in(tail: BagTail, topics: list[str], start: int, end: int, times: Times) -> list[int]:
    """The times t with start <= t < end of messages on the topics (none: on any)."""
    wanted = {c.id for c in tail.connections if not topics or c.topic in topics}
    found = [
        time for chunk in near(tail, wanted, start, end) for time in _of_chunk(chunk, wanted, times)
    ]
    return sorted(time for time in found if start <= time < end)


def _of_chunk(chunk: Chunk, wanted: set[int], times: Times) -> list[int]:
    try:
        found = times(chunk)
    except BagError:  # players don't need a chunk's own index; it has a message at either end
        return [chunk.start_time, chunk.end_time]
    return [time for each in wanted for time in found.get(each, [])]
