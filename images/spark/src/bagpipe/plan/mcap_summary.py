"""What an MCAP file's summary says: which chunks hold which times, without reading a payload.

Format: https://mcap.dev/spec. The footer, with which a file ends, names where the summary begins;
that has the channels, their schemas and an index of the chunks.
"""

from collections.abc import Callable
from typing import Any

# A footer record and the magic.
_FOOTER_BYTES = 37


def read_index(
    read: Callable[[int, int], bytes], size: int, head: bytes, parsed: Callable[..., Any]
) -> Any:
    """The index of a file of `size` bytes that begins with `head`.

    `parsed` calls a parser of the native module by its name. Raises BagError with the reason
    BagEmpty, BagUnreadable, BagCut or BagNotIndexed.
    """
    head_end = parsed("mcap_head", head)
    length = min(_FOOTER_BYTES, size)
    footer = read(size - length, length)
    begin, end = parsed("mcap_footer", footer, size)
    return parsed("mcap_index", read(begin, end - begin), begin, head_end, footer)
