"""Messages of ROS 1's classes in the bytes of ROS 2: little-endian CDR, by the fields' types.

Both have the same types but for the header's `seq`, which ROS 2 has not, and for the sign of a
stamp's seconds, which four bytes don't show.
"""

import re
import struct

from genpy.message import get_message_class

_HEAD = b"\x00\x01\x00\x00"
_NUMBERS = {"bool": "?", "byte": "b", "char": "B", "float32": "f", "float64": "d"}
_NUMBERS |= {"int8": "b", "int16": "h", "int32": "i", "int64": "q"}
_NUMBERS |= {"uint8": "B", "uint16": "H", "uint32": "I", "uint64": "Q"}
_ARRAY = re.compile(r"(.*)\[(\d*)\]")


class _Into:
    def __init__(self):
        self.bytes = bytearray()

    def number(self, kind, value=0):
        size = struct.calcsize("<" + kind)
        self.bytes += bytes(-len(self.bytes) % size) + struct.pack("<" + kind, value)
        return value

    def text(self, value=""):
        encoded = value.encode() + b"\0"
        self.number("I", len(encoded))
        self.bytes += encoded
        return value


class _From:
    def __init__(self, data):
        self.bytes, self.at = data, 0

    def number(self, kind, _=0):
        size = struct.calcsize("<" + kind)
        self.at += -self.at % size
        (value,) = struct.unpack_from("<" + kind, self.bytes, self.at)
        self.at += size
        return value

    def text(self, _=""):
        length = self.number("I")
        self.at += length
        return bytes(self.bytes[self.at - length : self.at - 1]).decode()


def written(message):
    """A message's bytes, with the encapsulation that they begin with."""
    into = _Into()
    _fields(into, message)
    return _HEAD + bytes(into.bytes)


def read(kind, data):
    """The message of a class in bytes that this module or another ROS 2 wrote."""
    message = kind()
    _fields(_From(data[len(_HEAD) :]), message)
    return message


def _fields(stream, message):
    """Both ways: each value is given, and replaced by what the stream has for it."""
    for name, kind in zip(message.__slots__, message._slot_types, strict=True):
        if not (message._type == "std_msgs/Header" and name == "seq"):
            setattr(message, name, _value(stream, kind, getattr(message, name)))


def _value(stream, kind, value):
    array = _ARRAY.fullmatch(kind)
    if array:
        known = list(value)
        many = int(array[2]) if array[2] else stream.number("I", len(known))
        known += [_new(array[1])] * (many - len(known))
        return [_value(stream, array[1], one) for one in known[:many]]
    if kind in _NUMBERS:
        return stream.number(_NUMBERS[kind], value)
    if kind == "string":
        return stream.text(value)
    if kind in ("time", "duration"):
        value.secs = stream.number("I", value.secs)
        value.nsecs = stream.number("I", value.nsecs)
        return value
    _fields(stream, value)
    return value


def _new(kind):
    return 0 if kind in _NUMBERS else "" if kind == "string" else get_message_class(kind)()
