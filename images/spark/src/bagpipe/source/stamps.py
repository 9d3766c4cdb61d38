"""The stamps of the headers in a serialised message, wherever they stand, moved in time.

A message of ROS 1 or ROS 2 (CDR) is walked by its own definition, only as far as its last header;
nothing is decoded and nothing else of it changes. Stamps of zero mean "no time", and stay.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from rosbags.interfaces import Nodetype

from bagpipe.definitions import HEADER, OLD_HEADER, full_name, types_in
from bagpipe.encodings import CDR, ROS1

_SIZES = {
    "bool": 1, "byte": 1, "char": 1, "int8": 1, "uint8": 1, "octet": 1, "int16": 2, "uint16": 2,
    "int32": 4, "uint32": 4, "int64": 8, "uint64": 8, "float32": 4, "float64": 8,
}  # fmt: skip
_TIMES = frozenset({"builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"})
_SECOND = 1_000_000_000
_CDR_HEAD = 4
_CDR_ORDERS = {0: ">", 1: "<"}


class StampError(ValueError):
    """A message or its definition can't be read; the message is a sentence."""


@dataclass
class _Message:
    """What is walked: its bytes in an order (`<` or `>`), and where its stamps were found."""

    data: bytes
    order: str
    places: list[int] = field(default_factory=list)

    def count(self, at: int) -> int:
        """The number of uint32 there. Raises struct.error behind the end."""
        return int(struct.unpack_from(f"{self.order}I", self.data, at)[0])


# Goes over a value at an offset, notes where its stamps lie, and gives the offset behind it.
Walk = Callable[[_Message, int], int]


@dataclass(frozen=True)
class _Shape:
    """How a type is walked. One of `size` bytes is always as long, and begins at a multiple of
    `unit`, which the size is a multiple of; others have no size.
    """

    walk: Walk
    size: int | None
    unit: int
    stamped: bool


def moved(connection: Any, raw: bytes, shift: int) -> bytes:
    """The message with `shift` ns added to its headers' stamps, bounded by what a stamp can say.

    Raises StampError.
    """
    if not shift:
        return raw
    kind, encoding = connection.type, connection.encoding
    shape = _shape_of(kind, connection.definition, encoding, connection.schema_encoding)
    if not shape.stamped:
        return raw
    begin, order = (0, "<") if encoding == ROS1 else _head(raw)
    message = _Message(raw, order)
    try:
        end = shape.walk(message, begin)
    except struct.error:
        end = len(raw) + 1
    if end > len(raw):
        raise StampError(f"a message of {len(raw)} bytes is no {kind} as its definition has it")
    # ROS 2's seconds have a sign.
    return _with_stamps(message, shift, (1 << 32 if encoding == ROS1 else 1 << 31) - 1)


def _with_stamps(message: _Message, shift: int, last_second: int) -> bytes:
    data, stamp = bytearray(message.data), struct.Struct(f"{message.order}II")
    for place in message.places:
        seconds, nanoseconds = stamp.unpack_from(data, place)
        if seconds or nanoseconds:
            time = min(max(seconds * _SECOND + nanoseconds + shift, 0), last_second * _SECOND)
            stamp.pack_into(data, place, *divmod(time, _SECOND))
    return bytes(data)


def _head(raw: bytes) -> tuple[int, str]:
    """Where a message of CDR begins, behind its head, and its order of bytes."""
    if len(raw) < _CDR_HEAD or raw[0] != 0 or raw[1] not in _CDR_ORDERS:
        raise StampError(f"a message of {len(raw)} bytes does not begin as CDR does")
    return _CDR_HEAD, _CDR_ORDERS[raw[1]]


@lru_cache(maxsize=1024)
def _shape_of(kind: str, definition: str, encoding: str, schema_encoding: str) -> _Shape:
    if encoding not in (ROS1, CDR):
        raise StampError(f"messages in {encoding or 'no known encoding'} have no known stamps")
    shapes = _Shapes(aligned=encoding == CDR)
    name = full_name(kind)
    try:
        if name in (HEADER, OLD_HEADER):
            return shapes.header
        types = types_in(kind, definition, schema_encoding)
        fields = [shapes.of(each, types, (name,)) for _, each in types[name][1]]
    except Exception as error:  # a library's many faults at a definition of any text
        raise StampError(f"the definition of {kind} can't be read: {error}") from error
    last = max((at for at, shape in enumerate(fields) if shape.stamped), default=-1)
    return shapes.in_a_row(fields[: last + 1])


class _Shapes:
    """The shapes of one encoding: with numbers at multiples of their sizes, or without gaps."""

    def __init__(self, *, aligned: bool) -> None:
        self._aligned = aligned
        self._known: dict[str, _Shape] = {}
        self.header = _Shape(self._header, None, 1, stamped=True)

    def of(self, kind_and_detail: Any, types: Any, within: tuple[str, ...]) -> _Shape:
        """The shape of a field as rosbags describes it. Raises StampError, KeyError."""
        kind, detail = kind_and_detail
        if kind == Nodetype.BASE:
            return self._base(detail[0])
        if kind == Nodetype.NAME:
            return self._named(detail, types, within)
        inner = self.of(detail[0], types, within)
        return self._array(inner, None if kind == Nodetype.SEQUENCE else detail[1])

    def _base(self, name: str) -> _Shape:
        return _Shape(self._string, None, 1, stamped=False) if name == "string" else (
            self._fixed(_SIZES[name], _SIZES[name])
        )  # fmt: skip

    def _named(self, name: str, types: Any, within: tuple[str, ...]) -> _Shape:
        if name in (HEADER, OLD_HEADER):
            return self.header
        if name in _TIMES:
            return self._fixed(8, 4)
        if name in within:
            raise StampError(f"{name} holds itself")
        if name not in self._known:
            fields = types[name][1]
            self._known[name] = (
                self.in_a_row([self.of(each, types, (*within, name)) for _, each in fields])
                if fields or not self._aligned
                else self._fixed(1, 1)  # ROS 2 has no empty types: one byte stands for nothing
            )
        return self._known[name]

    def in_a_row(self, shapes: list[_Shape]) -> _Shape:
        """One behind the other. One without a size takes a byte at least, so that a walk has no
        more steps than its message has bytes.
        """
        sizes = [shape.size for shape in shapes if shape.size is not None]
        units = {shape.unit for shape in shapes if shape.size != 0}
        if len(sizes) == len(shapes) and len(units) < 2:
            return self._fixed(sum(sizes), next(iter(units), 1))

        def walk(message: _Message, at: int) -> int:
            for shape in shapes:
                at = shape.walk(message, at)
                if at > len(message.data):
                    raise struct.error("behind the end")
            return at

        return _Shape(walk, None, 1, any(shape.stamped for shape in shapes))

    def _fixed(self, size: int, unit: int) -> _Shape:
        unit = unit if self._aligned else 1
        if not size:
            return _Shape(lambda _message, at: at, 0, unit, stamped=False)
        return _Shape(
            lambda _message, at: self._start(at, unit) + size, size, unit, stamped=False
        )  # fmt: skip

    def _array(self, inner: _Shape, count: int | None) -> _Shape:
        """Of `count` elements, or of as many as stand before them."""
        if count == 0:
            return self._fixed(0, 1)
        if count is not None and inner.size is not None:
            return self._fixed(count * inner.size, inner.unit)

        def walk(message: _Message, at: int) -> int:
            number = count
            if number is None:
                at = self._start(at, 4)
                number = message.count(at)
                at += 4
            if inner.size is not None:
                return self._start(at, inner.unit) + number * inner.size if number else at
            for _ in range(number):
                at = inner.walk(message, at)
                if at > len(message.data):
                    raise struct.error("behind the end")
            return at

        return _Shape(walk, None, 1, inner.stamped)

    def _string(self, message: _Message, at: int) -> int:
        at = self._start(at, 4)
        return at + 4 + message.count(at)

    def _header(self, message: _Message, at: int) -> int:
        # A sequence number, which only ROS 1 has, the stamp, the frame's name.
        place = self._start(at, 4) if self._aligned else at + 4
        message.places.append(place)
        return self._string(message, place + 8)

    def _start(self, at: int, unit: int) -> int:
        """Where a number of `unit` bytes begins that is due at `at`."""
        return at + (_CDR_HEAD - at) % unit if self._aligned else at
