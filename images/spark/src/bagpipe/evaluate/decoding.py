"""Messages as values, by the definitions that their recording has: those of ROS 1 and of ROS 2."""

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from bagpipe.definitions import BETWEEN, HEADER, OLD_HEADER, full_name, types_in
from bagpipe.encodings import CDR, ROS1
from bagpipe.evaluate.finding import NoEvidenceError
from bagpipe.first_field import begins_with_header

_TIME = "builtin_interfaces/msg/Time"
# Of a message that begins with a header: behind a sequence number in ROS 1, in ROS 2 behind the
# head of CDR, whose second byte is the order of bytes.
_STAMP_AT, _STAMPS = 4, {0: struct.Struct(">iI"), 1: struct.Struct("<iI")}
_UNSIGNED_STAMP = struct.Struct("<II")
_HEADERS = ((Nodetype.NAME, HEADER), (Nodetype.NAME, OLD_HEADER))
_SECOND = 1_000_000_000
# Types that are kept from recording to recording. rosbags compiles seventeen functions for each
# type within one, which takes longer than reading the messages of a short window; a process
# judges the recordings of many cases, which mostly have the same types.
_MOST_KEPT = 32
# In bytes, of the types that are always as long.
_LENGTHS = {
    "bool": 1, "byte": 1, "char": 1, "octet": 1, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2,
    "int32": 4, "uint32": 4, "float32": 4, "int64": 8, "uint64": 8, "float64": 8,
}  # fmt: skip


@dataclass
class Ros2Time:
    """A time of ROS 2, whose seconds have a sign; that of ROS 1 has none."""

    sec: int
    nanosec: int
    __msgtype__: ClassVar[str] = _TIME


def nanoseconds(time: Any) -> int:
    """A time or a duration of a message in ns.

    ROS 1 counts a time's seconds without a sign, up to the year 2106; rosbags reads them with one.
    """
    seconds = int(time.sec)
    if not isinstance(time, Ros2Time) and getattr(time, "__msgtype__", _TIME) == _TIME:
        seconds &= 0xFFFFFFFF
    return seconds * _SECOND + int(time.nanosec)


def stamp_reader(connection: Any) -> Callable[[memoryview], int | None] | None:
    """Reads the stamp in ns off a message of a type with a header.

    It gives None where the message is too short to have one, or in no order of bytes. None for
    other types, and for those whose definition can't be read: who decodes a message says so.
    """
    try:
        fields = _types_of(*_definition(connection))[full_name(connection.type)][1]
    except Exception:  # noqa: BLE001  a definition of any text
        return None
    if fields and fields[0][1] in _HEADERS:
        return _FIRST_STAMPS.get(connection.encoding)
    if any(name == "header" and kind in _HEADERS for name, kind in fields):
        return _decoded_stamp(connection)
    return None


def first_stamp_reader(connection: Any) -> Callable[[memoryview], int | None] | None:
    """The same, of types that begin with a header and are not in IDL: it costs little, whatever
    text the definition is.
    """
    if not begins_with_header(connection.definition, connection.schema_encoding):
        return None
    return _FIRST_STAMPS.get(connection.encoding)


def sequence_at(connection: Any) -> int | None:
    """Where the header's sequence number stands in the messages of a type of ROS 1, if it is in
    the same place in all of them and is easily found; in those of ROS 2, which have none, the head
    of CDR.
    """
    if connection.encoding == CDR:
        return 0
    return _sequence_at(*_definition(connection))


@lru_cache(maxsize=256)
def _sequence_at(kind: str, definition: str, schema_encoding: str) -> int | None:
    try:
        fields = _types_of(kind, definition, schema_encoding)[full_name(kind)][1]
    except Exception:  # noqa: BLE001  a definition of any text
        return None
    before = 0
    for number, (name, kind_of) in enumerate(fields):
        if kind_of in _HEADERS and (number == 0 or name == "header"):
            return before
        length = _LENGTHS.get(kind_of[1][0]) if kind_of[0] == Nodetype.BASE else None
        if length is None:
            return None
        before += length
    return None


def _decoded_stamp(connection: Any) -> Callable[[memoryview], int | None] | None:
    """Of a type whose header has something before it: only a decoder knows where."""
    try:
        decode = decoder(connection)
    except NoEvidenceError:
        return None

    def stamp(raw: memoryview) -> int | None:
        try:
            return nanoseconds(decode(raw).header.stamp)
        except Exception:  # noqa: BLE001  hostile bytes
            return None

    return stamp


def decoder(connection: Any) -> Callable[[memoryview], Any]:
    """Makes values of a connection's messages; it may raise anything at hostile bytes.

    Raises NoEvidenceError for an encoding or a definition that can't be read.
    """
    name = full_name(connection.type)
    if connection.encoding not in (ROS1, CDR):
        raise NoEvidenceError(
            f"messages on {connection.topic} are in {connection.encoding or 'no known encoding'},"
            f" and criteria read {ROS1} and {CDR}"
        )
    if BETWEEN in connection.definition.splitlines():
        raise NoEvidenceError(
            f"{connection.type} on {connection.topic} is recorded with its service's definition,"
            " which does not say what its messages are: criteria can only count them"
        )
    try:
        store = _store_of(*_definition(connection), connection.encoding)
    except Exception as error:  # a library's many faults at a definition of any text
        why = str(error).partition("\n")[0]
        raise NoEvidenceError(
            f"the definition of {connection.type} on {connection.topic} can't be read: {why}"
        ) from error
    if connection.encoding == ROS1:
        return lambda raw: store.deserialize_ros1(bytes(raw), name)
    return lambda raw: store.deserialize_cdr(bytes(raw), name)


@lru_cache(_MOST_KEPT)
def _store_of(kind: str, definition: str, schema_encoding: str, encoding: str) -> Any:
    store = get_typestore(Stores.EMPTY)
    store.register(_types_of(kind, definition, schema_encoding))
    if encoding == CDR:
        store.types[_TIME] = Ros2Time
    store.get_msgdef(full_name(kind))  # which needs all that the definition uses
    return store


@lru_cache(_MOST_KEPT)
def _types_of(kind: str, definition: str, schema_encoding: str) -> dict[str, Any]:
    return types_in(kind, definition, schema_encoding)


def _definition(connection: Any) -> tuple[str, str, str]:
    return connection.type, connection.definition, connection.schema_encoding


def base_type(connection: Any, names: Iterable[str]) -> str:
    """The type of a field in a connection's messages, such as float32, or of an array's elements;
    empty where it is none of ROS's own.
    """
    types = _types_of(*_definition(connection))
    kind: tuple[Any, Any] = (Nodetype.NAME, full_name(connection.type))
    for name in names:
        fields = dict(types[kind[1]][1]) if kind[0] == Nodetype.NAME and kind[1] in types else {}
        if name not in fields:
            return ""
        kind = fields[name]
        if kind[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            kind = kind[1][0]
    return str(kind[1][0]) if kind[0] == Nodetype.BASE else ""


def _stamp_of_ros1(raw: memoryview) -> int | None:
    if len(raw) < _STAMP_AT + _UNSIGNED_STAMP.size:
        return None
    seconds, rest = _UNSIGNED_STAMP.unpack_from(raw, _STAMP_AT)
    return int(seconds) * _SECOND + int(rest)


def _stamp_of_cdr(raw: memoryview) -> int | None:
    if len(raw) < _STAMP_AT + _UNSIGNED_STAMP.size or raw[0] != 0 or raw[1] not in _STAMPS:
        return None
    seconds, rest = _STAMPS[raw[1]].unpack_from(raw, _STAMP_AT)
    return int(seconds) * _SECOND + int(rest)


_FIRST_STAMPS = {ROS1: _stamp_of_ros1, CDR: _stamp_of_cdr}
