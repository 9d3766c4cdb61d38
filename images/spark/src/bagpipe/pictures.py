"""Pictures that a page may show: PNG and JPEG by what they are, never by what they say. Pure."""

import struct
from dataclasses import dataclass

# Of one picture, of all of a case, and of all in a page.
MOST_BYTES = 16_384
MOST_OF_A_CASE = 2
MOST_OF_A_PAGE = 60
# A browser unpacks what it shows: a few bytes may claim to be a wall of pixels.
_MOST_PIXELS = 4_000_000
_PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"
_PNG_SIZE = struct.Struct(">II")
_JPEG, _JPEG_SIZE = b"\xff\xd8\xff", struct.Struct(">HH")
_SCAN = 0xDA
# The markers of a frame's head, apart from those of tables in the same range.
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
# What else comes before a scan, each with its length. Of others a decoder may take another length
# than is taken here, and find another frame behind them.
_LENGTHS = frozenset({0xC4, 0xDB, 0xDD, 0xFE, *range(0xE0, 0xF0), *_FRAMES})


@dataclass(frozen=True)
class Kind:
    """The type that a browser is given, and the picture's size in pixels."""

    kind: str
    width: int
    height: int


class PictureError(Exception):
    """A message shows no picture; the sentence says why."""


@dataclass(frozen=True)
class Thumbnail:
    """A file of a picture; `width` and `height` are those of the message."""

    kind: str
    data: bytes
    width: int
    height: int


def kind_of(data: bytes) -> Kind | None:
    """What the bytes are; None for all that is not shown."""
    if data.startswith(_PNG) and len(data) >= len(_PNG) + _PNG_SIZE.size:
        return _sized("image/png", *_PNG_SIZE.unpack_from(data, len(_PNG)))
    if data.startswith(_JPEG):
        size = _size_of_jpeg(data)
        return _sized("image/jpeg", *size) if size else None
    return None


def _sized(kind: str, width: int, height: int) -> Kind | None:
    if not 0 < width * height <= _MOST_PIXELS:
        return None
    return Kind(kind, width, height)


def _size_of_jpeg(data: bytes) -> tuple[int, int] | None:
    """Width and height by the one frame before the first scan."""
    at, found = 2, None
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != _SCAN:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if marker not in _LENGTHS or length < 2:
            return None
        if marker in _FRAMES:
            if found or at + 9 > len(data):
                return None
            height, width = _JPEG_SIZE.unpack_from(data, at + 5)
            found = (width, height)
        at += 2 + length
    # Of other bytes a decoder may look for the next marker.
    return found if data[at : at + 2] == bytes([0xFF, _SCAN]) else None
