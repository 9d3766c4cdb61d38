"""Records on their way: what goes into the pipe and what comes out of it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

Field = str | int | bytes
Fields = dict[str, Field]


class Record(NamedTuple):
    """One output record, whole: its name, its typed fields, its bytes."""

    name: str
    fields: Fields
    data: bytes


class InputRecord(NamedTuple):
    """One input record: `size` bytes, which `pieces` yields in pieces of at most 1 MiB."""

    name: str
    size: int
    pieces: Callable[[], Iterator[bytes | memoryview]]
    fields: Mapping[str, Field] = MappingProxyType({})


@dataclass(slots=True)
class OutputHead:
    """What the program says before a record's bytes; `size` None means until they end."""

    name: str
    size: int | None
    fields: Fields


def fields_fault(fields: object) -> str | None:
    """What is wrong with a record's fields, None where they are strings, integers and bytes."""
    if not isinstance(fields, dict):
        return f"its fields are a {type(fields).__name__}, expected a map"
    for key, value in fields.items():
        if not isinstance(key, str):
            return f"the field {key!r} has a name that is no string"
        if isinstance(value, bool) or not isinstance(value, (str, int, bytes)):
            return f"the field {key} is a {type(value).__name__}, expected string, integer or bytes"
        if isinstance(value, int) and not -(1 << 63) <= value < 1 << 63:
            return f"the field {key} is {value}, which needs more than 64 bits"
    return None
