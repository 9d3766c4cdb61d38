"""The MessagePack that frames need: maps of strings, integers, bytes, nil, and what nests in them.

https://github.com/msgpack/msgpack/blob/master/spec.md. Our own, so that this folder needs nothing.
"""

import struct
from typing import Any

from .frames import BinpipeError

_LAYOUTS = {
    0xCA: ">f", 0xCB: ">d", 0xCC: ">B", 0xCD: ">H", 0xCE: ">I", 0xCF: ">Q",
    0xD0: ">b", 0xD1: ">h", 0xD2: ">i", 0xD3: ">q",
}  # fmt: skip
_CONSTANTS = {0xC0: None, 0xC2: False, 0xC3: True}
_LENGTHS = {0: ">B", 1: ">H", 2: ">I"}
# first byte of the family: (what it is, exponent of the first length's width)
_SIZED = {
    0xC4: ("bytes", 0), 0xC5: ("bytes", 1), 0xC6: ("bytes", 2),
    0xD9: ("str", 0), 0xDA: ("str", 1), 0xDB: ("str", 2),
    0xDC: ("array", 1), 0xDD: ("array", 2), 0xDE: ("map", 1), 0xDF: ("map", 2),
}  # fmt: skip


def pack(value: object) -> bytes:
    """A map as MessagePack. Raises BinpipeError for what it can't hold."""
    out = bytearray()
    _pack(value, out)
    return bytes(out)


def _pack(value: object, out: bytearray) -> None:
    if value is None:
        out.append(0xC0)
    elif isinstance(value, bool):
        out.append(0xC3 if value else 0xC2)
    elif isinstance(value, int):
        _pack_integer(value, out)
    elif isinstance(value, str):
        data = value.encode()
        _pack_length(len(data), out, 0xA0, 31, (0xD9, 0xDA, 0xDB))
        out += data
    elif isinstance(value, bytes):
        _pack_length(len(value), out, 0, -1, (0xC4, 0xC5, 0xC6))
        out += value
    elif isinstance(value, dict):
        _pack_length(len(value), out, 0x80, 15, (0, 0xDE, 0xDF))
        for key, item in value.items():
            _pack(key, out)
            _pack(item, out)
    else:
        raise BinpipeError(f"a {type(value).__name__} has no place in a record's fields")


def _pack_integer(value: int, out: bytearray) -> None:
    if -32 <= value <= 127:
        out += struct.pack("b", value)
        return
    codes = (0xCC, 0xCD, 0xCE, 0xCF) if value >= 0 else (0xD0, 0xD1, 0xD2, 0xD3)
    for code in codes:
        try:
            out += bytes((code,)) + struct.pack(_LAYOUTS[code], value)
        except struct.error:
            continue
        return
    raise BinpipeError(f"the integer {value} needs more than 64 bits")


def _pack_length(
    length: int, out: bytearray, short: int, most: int, codes: tuple[int, int, int]
) -> None:
    if length <= most:
        out.append(short | length)
    elif length < 1 << 8 and codes[0]:
        out += bytes((codes[0], length))
    elif length < 1 << 16:
        out += bytes((codes[1],)) + struct.pack(">H", length)
    else:
        out += bytes((codes[2],)) + struct.pack(">I", length)


def unpack(data: bytes) -> dict[str, Any]:
    """The map that `data` holds. Raises BinpipeError where it is none."""
    try:
        value, at = _unpack(data, 0)
    except (IndexError, struct.error, UnicodeDecodeError, TypeError, RecursionError) as error:
        raise BinpipeError(f"a frame's map is no MessagePack: {error}") from error
    if at != len(data) or not isinstance(value, dict):
        raise BinpipeError("a frame that should hold one map holds something else")
    return value


def _unpack(data: bytes, at: int) -> tuple[Any, int]:
    code = data[at]
    at += 1
    if code < 0x80 or code >= 0xE0:
        return (code if code < 0x80 else code - 256), at
    if code in _CONSTANTS:
        return _CONSTANTS[code], at
    if code in _LAYOUTS:
        return _number(data, at, _LAYOUTS[code])
    kind, length = "map", code & 0x0F
    if code >= 0xC0:
        if code not in _SIZED:
            raise BinpipeError(f"a frame's map holds a value of type {code:#x}")
        kind, width = _SIZED[code]
        length, at = _number(data, at, _LENGTHS[width])
    elif code >= 0xA0:
        kind, length = "str", code & 0x1F
    elif code >= 0x90:
        kind = "array"
    return _body(data, at, kind, length)


def _number(data: bytes, at: int, layout: str) -> tuple[Any, int]:
    return struct.unpack_from(layout, data, at)[0], at + struct.calcsize(layout)


def _body(data: bytes, at: int, kind: str, length: int) -> tuple[Any, int]:
    if kind in {"bytes", "str"}:
        raw = data[at : at + length]
        if len(raw) < length:
            raise IndexError(f"{length} bytes are announced, {len(raw)} are left")
        return (raw if kind == "bytes" else raw.decode()), at + length
    items = []
    for _ in range(length * (2 if kind == "map" else 1)):
        item, at = _unpack(data, at)
        items.append(item)
    if kind == "array":
        return items, at
    return dict(zip(items[::2], items[1::2], strict=True)), at
