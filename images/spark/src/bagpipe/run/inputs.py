"""When a case's inputs were recorded, as its recording's indexes tell without reading them."""

from bagpipe.plan.bag_tail import BagError, BagTail, Chunk, Read, message_times, read_tail
from bagpipe.plan.cases import Case
from bagpipe.plan.fragments import holding
from bagpipe.run.pieces import sequence_bag
from bagpipe.storage import Storage


def input_times(case: Case, topics: list[str], storage: Storage) -> list[int]:
    """Ascending, in ns, in the case's window. Raises StorageError and BagError."""
    if case.parts:
        bag = sequence_bag(case, storage)
        there = [topic for topic in bag.topics if not topics or topic in topics]
        window = bag.messages(topics=there, start=case.window.start, end=case.window.end)
        return [time for _, time, _ in window]
    file = storage.open(case.bag)
    return times_in(
        read_tail(file.read, file.size), topics, case.window.start, case.window.end, file.read
    )


def times_in(tail: BagTail, topics: list[str], start: int, end: int, read: Read) -> list[int]:
    """The times t with start <= t < end of messages on the topics (none: on any)."""
    wanted = {c.id for c in tail.connections if not topics or c.topic in topics}
    near = [
        chunk
        for chunk in tail.chunks
        if wanted & holding(chunk) and chunk.start_time < end and chunk.end_time >= start
    ]
    found = [time for chunk in near for time in _of_chunk(chunk, wanted, read)]
    return sorted(time for time in found if start <= time < end)


def _of_chunk(chunk: Chunk, wanted: set[int], read: Read) -> list[int]:
    try:
        times = message_times(read, chunk)
    except BagError:  # players don't need a chunk's own index; it has a message at either end
        return [chunk.start_time, chunk.end_time]
    return [time for each in wanted for time in times.get(each, [])]
