"""PNG of a small picture, by the standard library: no library that writes images is installed where
cases run, and one for pictures of a few kilobytes would be the largest part of it. Pure.
"""

import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = b"\x89PNG\r\n\x1a\n"
_GREY, _COLOUR, _INDEXED = 0, 2, 3
# Each byte less the one of the pixel to its left: slopes become small numbers, which pack well.
_NONE, _SUB = b"\x00", b"\x01"

Pixels = NDArray[np.uint8]


def grey_or_colour(pixels: Pixels) -> bytes:
    """Rows of pixels of one byte (grey) or three (red, green, blue)."""
    depth = pixels.shape[2]
    less = pixels.copy()
    less[:, 1:] -= pixels[:, :-1]
    return _file(_COLOUR if depth == 3 else _GREY, pixels, _SUB, less)


def indexed(pixels: Pixels, palette: bytes) -> bytes:
    """Rows of pixels of one byte, the number of a colour of the palette."""
    return _file(_INDEXED, pixels, _NONE, pixels, _chunk(b"PLTE", palette))


def _file(kind: int, pixels: Pixels, how: bytes, rows: Any, before: bytes = b"") -> bytes:
    height, width = pixels.shape[:2]
    head = struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    packed = zlib.compress(b"".join(how + row.tobytes() for row in rows), 9)
    end = _chunk(b"IDAT", packed) + _chunk(b"IEND", b"")
    return MAGIC + _chunk(b"IHDR", head) + before + end


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
