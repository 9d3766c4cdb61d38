"""Recordings by their first bytes."""

from typing import Any

import bagpipe

MCAP_MAGIC = b"\x89MCAP0\r\n"


def in_memory(data: bytes, decompressed_bytes: int | None = None) -> Any:
    """A bagpipe.MemoryMcap, or of all else a bagpipe.MemoryBag; the bytes of uncompressed chunks
    together are bounded. Raises bagpipe.BagError.
    """
    # By their package: the program for people is installed without the native module, too.
    opened = bagpipe.MemoryMcap if data.startswith(MCAP_MAGIC) else bagpipe.MemoryBag
    return opened(data, decompressed_bytes=decompressed_bytes)
