"""A fragment as the bytes that the agent plays: a recording made of the user's own records."""

from bagpipe.plan.case import Case
from bagpipe.plan.framing import framed, framing
from bagpipe.storage import Storage
from bagpipe.wire.frames import MAX_PAYLOAD_BYTES
from bagpipe.wire.session import InputFile


def fragment_file(case: Case, storage: Storage) -> InputFile:
    """The case's input (docs/reference/binpipe.md, "The bytes of a fragment")."""
    sources = case.connections + case.ranges
    head, end = framing(sources)
    ranges = []
    at = len(head)
    for offset, length in sources:
        ranges.append((at, offset, length))
        at += length

    return InputFile(
        case.bag,
        at + len(end),
        ranges,
        lambda: framed(
            sources, storage.pieces(case.bag, sources, MAX_PAYLOAD_BYTES, case.bag_version)
        ),
    )
