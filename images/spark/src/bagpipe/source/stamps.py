"""The stamps of the headers in a serialised ROS 1 message, wherever they stand, moved in time.

A message is walked by its own definition, only as far as its last header; nothing is decoded and
nothing else of it changes. Stamps of zero mean "no time", and stay.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg

_HEADERS = frozenset({"std_msgs/msg/Header", "roslib/msg/Header"})
_SIZES = {
    "bool": 1, "byte": 1, "char": 1, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2, "int32": 4,
    "uint32": 4, "int64": 8, "uint64": 8, "float32": 4, "float64": 8,
}  # fmt: skip
_TIMES = frozenset({"builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"})
_COUNT = struct.Struct("<I")
_STAMP = struct.Struct("<II")
_SECOND = 1_000_000_000
# The last second that a stamp can say.
_MOST = ((1 << 32) - 1) * _SECOND

# Goes over a value at an offset, adds where its stamps lie, and gives the offset behind it.
Walk = Callable[[bytes, int, list[int]], int]


class StampError(ValueError):
    """A message or its definition can't be read; the message is a sentence."""


@dataclass(frozen=True)
class _Shape:
    """How a type is walked; `size` in bytes where it is always the same and has no header."""

    walk: Walk
    size: int | None
    stamped: bool


def moved(kind: str, definition: str, raw: bytes, shift: int) -> bytes:
    """The message with `shift` ns added to its headers' stamps, bounded by what a stamp can say.

    `kind` is such as `sensor_msgs/Imu`. Raises StampError.
    """
    if not shift:
        return raw
    shape = _shape_of(kind, definition)
    if not shape.stamped:
        return raw
    places: list[int] = []
    try:
        end = shape.walk(raw, 0, places)
    except struct.error:
        end = len(raw) + 1
    if end > len(raw):
        raise StampError(f"a message of {len(raw)} bytes is no {kind} as its definition has it")
    data = bytearray(raw)
    for place in places:
        seconds, nanoseconds = _STAMP.unpack_from(data, place)
        if seconds or nanoseconds:
            time = min(max(seconds * _SECOND + nanoseconds + shift, 0), _MOST)
            _STAMP.pack_into(data, place, *divmod(time, _SECOND))
    return bytes(data)


@lru_cache(maxsize=1024)
def _shape_of(kind: str, definition: str) -> _Shape:
    name = kind if "/msg/" in kind else kind.replace("/", "/msg/")
    try:
        types = get_types_from_msg(definition, name)
        if name in _HEADERS:
            return _HEADER
        shapes = [_shape(field, types, (name,)) for _, field in types[name][1]]
    except Exception as error:  # a library's many faults at a definition of any text
        raise StampError(f"the definition of {kind} can't be read: {error}") from error
    last = max((at for at, shape in enumerate(shapes) if shape.stamped), default=-1)
    return _in_a_row(shapes[: last + 1])


def _shape(field: Any, types: Any, within: tuple[str, ...]) -> _Shape:
    kind, detail = field
    if kind == Nodetype.BASE:
        name = detail[0]
        return _STRING if name == "string" else _fixed(_SIZES[name])
    if kind == Nodetype.NAME:
        if detail in _HEADERS:
            return _HEADER
        if detail in _TIMES:
            return _fixed(_STAMP.size)
        if detail in within:
            raise StampError(f"{detail} holds itself")
        inner = [_shape(each, types, (*within, detail)) for _, each in types[detail][1]]
        return _in_a_row(inner)
    inner_shape = _shape(detail[0], types, within)
    return _array(inner_shape, None if kind == Nodetype.SEQUENCE else detail[1])


def _fixed(size: int) -> _Shape:
    return _Shape(lambda _data, at, _found: at + size, size, stamped=False)


def _in_a_row(shapes: list[_Shape]) -> _Shape:
    sizes = [shape.size for shape in shapes]
    if None not in sizes:
        return _fixed(sum(size for size in sizes if size is not None))

    def walk(data: bytes, at: int, found: list[int]) -> int:
        for shape in shapes:
            at = shape.walk(data, at, found)
        return at

    return _Shape(walk, None, any(shape.stamped for shape in shapes))


def _array(inner: _Shape, count: int | None) -> _Shape:
    """Of `count` elements, or of as many as stand before them."""
    if count is not None and inner.size is not None:
        return _fixed(count * inner.size)

    def walk(data: bytes, at: int, found: list[int]) -> int:
        number = count
        if number is None:
            (number,) = _COUNT.unpack_from(data, at)
            at += _COUNT.size
        if inner.size is not None:
            return at + number * inner.size
        for _ in range(number):
            at = inner.walk(data, at, found)
        return at

    return _Shape(walk, None, inner.stamped)


def _string(data: bytes, at: int, _found: list[int]) -> int:
    (length,) = _COUNT.unpack_from(data, at)
    return at + _COUNT.size + int(length)


def _header(data: bytes, at: int, found: list[int]) -> int:
    # A sequence number, the stamp, the frame's name.
    found.append(at + 4)
    return _string(data, at + 12, found)


_STRING = _Shape(_string, None, stamped=False)
_HEADER = _Shape(_header, None, stamped=True)
