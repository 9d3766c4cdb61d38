"""What a case's own bag says of its window, for criteria that compare with it."""

from functools import partial

from bagpipe.plan.bag_tail import message_times, read_tail
from bagpipe.plan.case import Case
from bagpipe.plan.fragments import near
from bagpipe.plan.framing import framed
from bagpipe.plan.left_out import check_left_out
from bagpipe.plan.stated_times import stated_by
from bagpipe.storage import Storage
from bagpipe.wire.frames import MAX_PAYLOAD_BYTES


def chunks_with(topics: set[str], case: Case, storage: Storage) -> bytes:
    """The chunks with one of the topics in the case's window, as a recording without an index."""
    file = storage.open(case.bag)
    tail = read_tail(file.read, file.size)
    check_left_out(tail, topics, partial(message_times, file.read), case.window)
    wanted = {c.id for c in tail.connections if c.topic in topics}
    chunks = near(tail, wanted, case.window.start, case.window.end)
    ranges = tail.declarations + [(chunk.offset, chunk.end - chunk.offset) for chunk in chunks]
    pieces = storage.pieces(case.bag, ranges, MAX_PAYLOAD_BYTES, case.bag_version)
    return b"".join(framed(ranges, pieces, stated_by(chunks)))
