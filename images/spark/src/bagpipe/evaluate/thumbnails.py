"""A camera's message as a small picture that a page may show. Its bytes are anybody's. Pure."""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from bagpipe_bag import jpeg_pixels

from bagpipe.evaluate.png import Pixels, grey_or_colour, indexed
from bagpipe.pictures import MOST_BYTES, PictureError, Thumbnail, kind_of

# Widths and heights that are tried, until one takes no more bytes than MOST_BYTES: the last does.
_SIDES = (320, 240, 160, 96)
_MOST_SIDE = 1 << 16
_JPEG = b"\xff\xd8\xff"
_WORD_CHARACTERS = 40
# Bytes of a pixel, and where in it red, green and blue are, or the grey.
_LAYOUTS: dict[str, tuple[int, list[int]]] = {
    "rgb8": (3, [0, 1, 2]), "rgba8": (4, [0, 1, 2]), "bgr8": (3, [2, 1, 0]),
    "bgra8": (4, [2, 1, 0]), "8UC3": (3, [2, 1, 0]), "mono8": (1, [0]), "8UC1": (1, [0]),
}  # fmt: skip
_DEEP = ("mono16", "16UC1")
# Row and column of red and of blue in each cell of two by two pixels; the other two are green.
_BAYER = {
    "bayer_rggb8": ((0, 0), (1, 1)), "bayer_bggr8": ((1, 1), (0, 0)),
    "bayer_gbrg8": ((1, 0), (0, 1)), "bayer_grbg8": ((0, 1), (1, 0)),
}  # fmt: skip
# 252 colours, in even steps: a file of them has a third of the bytes before it is packed.
_STEPS = (6, 7, 6)
_PALETTE = bytes(
    round(255 * number / (steps - 1))
    for place in itertools.product(*map(range, _STEPS))
    for number, steps in zip(place, _STEPS, strict=True)
)


def of_compressed(message: Any) -> Thumbnail:
    """A CompressedImage as it is, where it is small; of a larger JPEG fewer pixels.

    What it says of its own format is not believed. Raises PictureError.
    """
    data = bytes(_bytes(message))
    if len(data) > MOST_BYTES:
        return _of_jpeg(data)
    found = kind_of(data)
    if found is None:
        raise PictureError("its compressed image is no PNG and no JPEG of a size that is shown")
    return Thumbnail(found.kind, data, found.width, found.height)


def _of_jpeg(data: bytes) -> Thumbnail:
    if not data.startswith(_JPEG):
        raise PictureError(
            f"its compressed image has {len(data):,} bytes and is no JPEG: of others no more than"
            f" {MOST_BYTES:,} are shown"
        )
    try:
        width, height, rows, columns, channels, pixels = jpeg_pixels(data, _SIDES[0])
    except ValueError as error:
        raise PictureError(str(error)) from None
    image = np.frombuffer(pixels, np.uint8).reshape(rows, columns, channels)

    def at_most(side: int) -> Pixels:
        down, across = _places(columns, rows, side)
        return np.ascontiguousarray(image[down][:, across])

    return _small(at_most, width, height)


def of_image(message: Any) -> Thumbnail:
    """An Image, made smaller by leaving pixels out. Raises PictureError."""
    width, height, step = int(message.width), int(message.height), int(message.step)
    encoding = str(message.encoding)
    size = _pixel_bytes(encoding)
    if not (0 < width <= _MOST_SIDE and 0 < height <= _MOST_SIDE):
        raise PictureError(f"it is {width} x {height} pixels large")
    if step < width * size:
        raise PictureError(f"its rows have {step} bytes, and {width} pixels take {width * size}")
    data = _bytes(message)
    if len(data) < step * height:
        raise PictureError(f"it has {len(data):,} bytes of {step * height:,}")
    rows = data[: step * height].reshape(height, step)
    big = bool(message.is_bigendian)
    return _small(lambda side: _pixels(rows, encoding, width, side, big=big), width, height)


def _small(at_most: Callable[[int], Pixels], width: int, height: int) -> Thumbnail:
    """The first file of few enough bytes, of pixels that are ever fewer and coarser."""
    for side in _SIDES:
        pixels = at_most(side)
        for file in (grey_or_colour(pixels), _coarse(pixels)):
            if len(file) <= MOST_BYTES:
                return Thumbnail("image/png", file, width, height)
    raise PictureError("no small picture can be made of it")


def _bytes(message: Any) -> Pixels:
    data = message.data
    if not isinstance(data, np.ndarray) or data.dtype != np.uint8 or data.ndim != 1:
        raise PictureError("its data are no bytes")
    return data


def _pixel_bytes(encoding: str) -> int:
    if encoding in _LAYOUTS:
        return _LAYOUTS[encoding][0]
    if encoding in _DEEP:
        return 2
    if encoding in _BAYER:
        return 1
    raise PictureError(f"images encoded as {encoding[:_WORD_CHARACTERS]!r} are not shown")


def _pixels(rows: Pixels, encoding: str, width: int, side: int, *, big: bool) -> Pixels:
    """At most `side` rows and columns of grey or of red, green and blue."""
    height = len(rows)
    if encoding in _BAYER:
        return _of_bayer(rows, _BAYER[encoding], width, side)
    size = _pixel_bytes(encoding)
    down, across = _places(width, height, side)
    cells = rows[down][:, : width * size].reshape(len(down), width, size)[:, across]
    if encoding not in _DEEP:
        return np.ascontiguousarray(cells[:, :, _LAYOUTS[encoding][1]])
    wide = np.ascontiguousarray(cells).view(">u2" if big else "<u2").astype(np.int64)
    return _stretched(wide)


def _of_bayer(rows: Pixels, cell: Any, width: int, side: int) -> Pixels:
    """A cell of four sensors is one pixel."""
    if width < 2 or len(rows) < 2:
        raise PictureError("it has no cell of four pixels")
    down, across = _places(width // 2, len(rows) // 2, side)

    def sensor(place: tuple[int, int]) -> Pixels:
        cells: Pixels = rows[2 * down + place[0]][:, 2 * across + place[1]]
        return cells

    red, blue = cell
    first, second = (sensor((row, 1 - red[1] if row == red[0] else 1 - blue[1])) for row in (0, 1))
    green = (first.astype(np.uint16) + second) // 2
    return np.stack([sensor(red), green.astype(np.uint8), sensor(blue)], axis=2)


def _places(width: int, height: int, side: int) -> tuple[Any, Any]:
    """Which rows and columns are kept, evenly, and in the image's own proportions."""
    longest = max(width, height, side)
    counts = (max(1, height * side // longest), max(1, width * side // longest))
    return tuple(  # type: ignore[return-value]
        np.arange(count) * length // count
        for count, length in zip(counts, (height, width), strict=True)
    )


def _stretched(values: Any) -> Pixels:
    """From the least to the greatest: a depth in millimetres would be black all over. 0 is none."""
    there = values[values > 0]
    low, high = (int(there.min()), int(there.max())) if there.size else (0, 1)
    grey = (values - low) * 254 // max(1, high - low) + 1
    pixels: Pixels = np.where(values > 0, grey, 0).astype(np.uint8)
    return pixels


def _coarse(pixels: Pixels) -> bytes:
    """The same in few colours, or sixteen greys."""
    if pixels.shape[2] == 1:
        return grey_or_colour(pixels // 17 * 17)
    red, green, blue = (
        pixels[:, :, n].astype(np.uint16) * steps >> 8 for n, steps in enumerate(_STEPS)
    )
    numbers = (red * _STEPS[1] + green) * _STEPS[2] + blue
    return indexed(numbers.astype(np.uint8), _PALETTE)
