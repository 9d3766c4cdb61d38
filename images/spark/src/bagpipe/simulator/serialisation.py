"""How the simulator's messages become bytes: as ROS 1 serialises them, and as ROS 2 does (CDR).

Both write the same fields one behind the other. ROS 1 leaves no gaps; CDR, after a head of four
bytes, begins each number at a multiple of its size, and ends each text with a zero
(OMG DDSI-RTPS 2.5, 10.5; XCDR1, little-endian).
"""

import struct
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

from rosbags.typesys import Stores, get_typestore

from bagpipe import encodings

_CDR_HEAD = b"\x00\x01\x00\x00"
_ORDERS = {0: ">", 1: "<"}
_SECOND = 1_000_000_000


class MessageWriter(Protocol):
    """One message, field by field."""

    def header(self, number: int, time: int, frame: str) -> None:
        """std_msgs/Header: the moment's number, which only ROS 1 has, its time in ns, the frame."""

    def add(self, alignment: int, data: bytes) -> None:
        """Numbers of `alignment` bytes each, in little-endian order."""

    def text(self, text: str) -> None:
        """A string."""

    def finish(self) -> bytes:
        """The whole message."""


class MessageReader(Protocol):
    """One message, field by field. Raises ValueError where it is too short."""

    def skip_header(self) -> None:
        """Over a std_msgs/Header."""

    def doubles(self, count: int) -> tuple[float, ...]:
        """The next `count` numbers of float64, with which the message ends."""


class _Ros1Writer:
    def __init__(self) -> None:
        self._data = bytearray()

    def header(self, number: int, time: int, frame: str) -> None:
        self._data += struct.pack("<III", number, *divmod(time, _SECOND))
        self.text(frame)

    def add(self, _alignment: int, data: bytes) -> None:
        self._data += data

    def text(self, text: str) -> None:
        data = text.encode()
        self._data += struct.pack("<I", len(data)) + data

    def finish(self) -> bytes:
        return bytes(self._data)


class _CdrWriter:
    def __init__(self) -> None:
        self._data = bytearray(_CDR_HEAD)

    def header(self, _number: int, time: int, frame: str) -> None:
        self.add(4, struct.pack("<iI", *divmod(time, _SECOND)))
        self.text(frame)

    def add(self, alignment: int, data: bytes) -> None:
        if data:
            self._data += bytes(_gap(len(self._data), alignment)) + data

    def text(self, text: str) -> None:
        data = text.encode() + b"\0"
        self.add(4, struct.pack("<I", len(data)))
        self._data += data

    def finish(self) -> bytes:
        return bytes(self._data)


class _Ros1Reader:
    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def skip_header(self) -> None:
        self._at = 16 + _count(self._data, "<", 12)

    def doubles(self, count: int) -> tuple[float, ...]:
        return _last_doubles(self._data, "<", self._at, count)


class _CdrReader:
    def __init__(self, data: bytes) -> None:
        if len(data) < len(_CDR_HEAD) or data[0] != 0 or data[1] not in _ORDERS:
            raise ValueError("it does not begin as CDR does")
        self._data, self._order, self._at = data, _ORDERS[data[1]], len(_CDR_HEAD)

    def skip_header(self) -> None:
        self._at = 16 + _count(self._data, self._order, 12)

    def doubles(self, count: int) -> tuple[float, ...]:
        at = self._at + _gap(self._at, 8)
        return _last_doubles(self._data, self._order, at, count)


def _gap(at: int, alignment: int) -> int:
    """Zeros before a number of `alignment` bytes behind `at` bytes of CDR and its head."""
    return (len(_CDR_HEAD) - at) % alignment


def _count(data: bytes, order: str, at: int) -> int:
    if len(data) < at + 4:
        raise ValueError("it ends within its header")
    return int(struct.unpack_from(f"{order}I", data, at)[0])


def _last_doubles(data: bytes, order: str, at: int, count: int) -> tuple[float, ...]:
    layout = struct.Struct(f"{order}{count}d")
    if len(data) != at + layout.size:
        raise ValueError(f"{at + layout.size} are expected")
    return layout.unpack_from(data, at)


@dataclass(frozen=True)
class Serialisation:
    """One of the two, by what recordings call it."""

    name: str
    writer: type[MessageWriter]
    reader: Any
    ros_version: int

    @property
    def types(self) -> Any:
        """The definitions of the types that ROS ships; ROS 2's are those of Humble."""
        return _types(self.ros_version)

    def type_name(self, kind: str) -> str:
        """`nav_msgs/Odometry` as this ROS calls it."""
        return kind if self.ros_version == 1 else kind.replace("/", "/msg/")

    def serialised(self, message: Any, kind: str) -> bytes:
        """A message of `types` as bytes."""
        name = kind.replace("/", "/msg/")
        types = self.types
        written = types.serialize_ros1 if self.ros_version == 1 else types.serialize_cdr
        return bytes(written(message, name))


@cache
def _types(ros_version: int) -> Any:
    return get_typestore(Stores.ROS1_NOETIC if ros_version == 1 else Stores.ROS2_HUMBLE)


ROS1 = Serialisation(encodings.ROS1, _Ros1Writer, _Ros1Reader, 1)
CDR = Serialisation(encodings.CDR, _CdrWriter, _CdrReader, 2)


def serialisation(name: str | None) -> Serialisation:
    """By its name in recordings. Raises KeyError for another."""
    return {each.name: each for each in (ROS1, CDR)}[name or ""]
