"""How a bag begins that is written as a stream, without an index.

Format: bag 2.0, http://wiki.ros.org/Bags/Format/2.0.
"""

import struct
from collections.abc import Sequence

from bagpipe.plan.bag_tail import MAGIC


def head_before(ranges: Sequence[tuple[int, int]]) -> bytes:
    """What precedes these (offset, length) ranges of a recording, so that they can be read.

    Nothing, where they begin with the recording's own head; else that of a bag.
    """
    return b"" if ranges and ranges[0][0] == 0 else unindexed_head()


def unindexed_head() -> bytes:
    """How a bag begins that has no index: the magic line and the file header record."""
    fields = (
        b"op=\x03",
        b"index_pos=" + struct.pack("<Q", 0),
        b"conn_count=" + struct.pack("<I", 0),
        b"chunk_count=" + struct.pack("<I", 0),
    )
    header = b"".join(struct.pack("<I", len(field)) + field for field in fields)
    return MAGIC + struct.pack("<I", len(header)) + header + struct.pack("<I", 0)
