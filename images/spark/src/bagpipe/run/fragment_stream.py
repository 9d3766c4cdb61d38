"""A fragment as the bytes that the agent plays: a bag stream made of the user's own records."""

import struct
from collections.abc import Iterator

from bagpipe.pipe.frames import MAX_PAYLOAD_BYTES
from bagpipe.pipe.session import InputFile
from bagpipe.plan.bag_tail import MAGIC
from bagpipe.plan.cases import Case
from bagpipe.storage import Storage


def fragment_file(case: Case, storage: Storage) -> InputFile:
    """The case's input (docs/reference/binpipe.md, "The bytes of a fragment")."""
    head = MAGIC + _unindexed_file_header()
    sources = case.connections + case.ranges
    ranges = []
    at = len(head)
    for offset, length in sources:
        ranges.append((at, offset, length))
        at += length

    def pieces() -> Iterator[bytes]:
        yield head
        yield from storage.pieces(case.bag, sources, MAX_PAYLOAD_BYTES)

    return InputFile(case.bag, at, ranges, pieces)


def _unindexed_file_header() -> bytes:
    fields = (
        b"op=\x03",
        b"index_pos=" + struct.pack("<Q", 0),
        b"conn_count=" + struct.pack("<I", 0),
        b"chunk_count=" + struct.pack("<I", 0),
    )
    header = b"".join(struct.pack("<I", len(field)) + field for field in fields)
    return struct.pack("<I", len(header)) + header + struct.pack("<I", 0)
