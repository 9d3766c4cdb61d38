"""Numbers out of messages: `pose.pose.position.x`, `ranges[3]`, a stamp as seconds."""

import math
import re
import struct
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from bagpipe.evaluate.decoding import nanoseconds
from bagpipe.evaluate.finding import Finding, NoEvidenceError

_PART = re.compile(r"([A-Za-z]\w*)(?:\[(\d+)\])?")
# A map for an expression holds no images and clouds: nobody compares them pixel by pixel in CEL.
_LONGEST_ARRAY = 1024
# From there on not every integer is a float.
_EXACT = 2**53
_SINGLE = struct.Struct("f")


def number_at(message: Any, path: str) -> float:
    """The number at a path, an integer where a float is less exact; a time is seconds.

    Raises NoEvidenceError naming what is there.
    """
    value = message
    for name, index in _parts(path):
        fields = getattr(value, "__dataclass_fields__", {})
        if name not in fields:
            there = ", ".join(n for n in fields if not n.startswith("__")) or "no fields"
            raise NoEvidenceError(f"{path}: there is no {name}; there is {there}")
        value = getattr(value, name)
        if index is not None:
            try:
                value = value[int(index)]
            except (IndexError, TypeError) as error:
                raise NoEvidenceError(f"{path}: {name} has no element {index}") from error
    if type(value) is float:
        return value
    if hasattr(value, "sec") and hasattr(value, "nanosec"):
        return nanoseconds(value) / 1e9
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise NoEvidenceError(f"{path} is no number but {type(value).__name__}") from error
    if isinstance(value, str | bytes):  # Python reads a number in it, and ROS has none there
        raise NoEvidenceError(f"{path} is no number but {type(value).__name__}")
    return int(value) if abs(number) >= _EXACT and hasattr(value, "__index__") else number


# A criterion asks each message for the same one.
@lru_cache(1024)
def _parts(path: str) -> tuple[tuple[str, str | None], ...]:
    """Names of fields with the index of an element, as far as each has one."""
    found = [(part, _PART.fullmatch(part)) for part in path.split(".")]
    return tuple((match[1], match[2]) if match else (part, None) for part, match in found)


def names_in(path: str) -> list[str]:
    """The fields that a path goes through."""
    return [name for name, _ in _parts(path)]


def single(number: float) -> float:
    """What a field of 32 bits has for a number; that itself where it has none but 0."""
    try:
        return float(_SINGLE.unpack(_SINGLE.pack(number))[0]) or number
    except OverflowError:
        return number


def as_map(value: Any) -> Any:
    """A message as plain maps and lists, for expressions; long arrays are left out."""
    fields = getattr(value, "__dataclass_fields__", None)
    if fields is not None:
        if "sec" in fields and "nanosec" in fields:
            return nanoseconds(value) / 1e9
        named = {n: as_map(getattr(value, n)) for n in fields if not n.startswith("__")}
        return {name: part for name, part in named.items() if part is not None}
    if isinstance(value, str | bytes | bool | int | float):
        return value
    if hasattr(value, "__len__"):
        if len(value) > _LONGEST_ARRAY:
            return None
        # What numpy makes of an array of numbers is plain.
        return value.tolist() if hasattr(value, "tolist") else [as_map(item) for item in value]
    return value.item() if hasattr(value, "item") else None


def no_number(
    name: str, kind: str, what: str, values: Iterable[tuple[int, float]], start: int
) -> Finding | None:
    """A failed finding if one of the values is not finite, with the time of the first.

    `values` are pairs of a time in ns and a number.
    """
    every = list(values)
    odd = [(time, value) for time, value in every if not math.isfinite(value)]
    if not odd:
        return None
    time, value = odd[0]
    message = (
        f"{what} is no finite number but {value} at {(time - start) / 1e9:.3f} s, the first of"
        f" {len(odd)} of {len(every)} values"
    )
    return Finding(name, kind, "failed", limit="a number", message=message, instead="failed")


def yaw_of(orientation: Any) -> float:
    """The heading of a quaternion of any length, in radians from -pi to pi (REP 103: about z, from
    x to y).
    """
    x, y, z, w = (float(getattr(orientation, n)) for n in "xyzw")
    return math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)


def turned(radians: float) -> float:
    """The same direction from -pi to pi; infinity for what is beyond all numbers."""
    return math.remainder(radians, math.tau) if math.isfinite(radians) else math.inf
