"""What makes a recording again of some of its records, without the index that it had.

Formats: bag 2.0, http://wiki.ros.org/Bags/Format/2.0; MCAP, https://mcap.dev/spec.
"""

import struct
from collections.abc import Iterable, Iterator, Sequence
from functools import cache

from bagpipe.plan.bag_tail import MAGIC
from bagpipe.plan.stated_times import compared
from bagpipe.recording_format import MCAP_MAGIC


def framing(ranges: Sequence[tuple[int, int]]) -> tuple[bytes, bytes]:
    """The bytes before and behind these (offset, length) ranges of a recording.

    With them the ranges are a recording of its format without an index. Those of MCAP begin with
    the recording's own head, at byte 0; those of a bag never do.
    """
    if ranges and ranges[0][0] == 0:
        return b"", _mcap_end()
    return _bag_head(), b""


def framed(
    ranges: Sequence[tuple[int, int]], pieces: Iterable[bytes], stated: str = ""
) -> Iterator[bytes]:
    """The bytes of the ranges, which come in `pieces`, as a recording.

    `stated` is what the index states of their chunks' times (`stated_by`); empty: it is compared
    with nothing. Raises BagError where they state others, before the recording is whole.
    """
    head, end = framing(ranges)
    yield from filter(None, [head])
    yield from compared(pieces, stated) if stated else pieces
    yield from filter(None, [end])


@cache
def _bag_head() -> bytes:
    """The magic line and a file header record that has no index."""
    fields = (
        b"op=\x03",
        b"index_pos=" + struct.pack("<Q", 0),
        b"conn_count=" + struct.pack("<I", 0),
        b"chunk_count=" + struct.pack("<I", 0),
    )
    header = b"".join(struct.pack("<I", len(field)) + field for field in fields)
    return MAGIC + struct.pack("<I", len(header)) + header + struct.pack("<I", 0)


@cache
def _mcap_end() -> bytes:
    """The records DataEnd, without a checksum, and Footer, without a summary; and the magic."""
    data_end = struct.pack("<BQI", 0x0F, 4, 0)
    footer = struct.pack("<BQQQI", 0x02, 20, 0, 0, 0)
    return data_end + footer + MCAP_MAGIC
