"""The types that a recorded definition has, as rosbags describes them."""

from collections.abc import Iterator
from typing import Any, NamedTuple

from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg

from bagpipe.idl import MOST_CHARACTERS, types_in_idl

HEADER = "std_msgs/msg/Header"
# Before ROS Diamondback the header lived in roslib; definitions say "Header" of both.
OLD_HEADER = "roslib/msg/Header"
# rosbags writes a line of Python for each element of a fixed array of messages or texts.
MOST_ELEMENTS = 4096
# Fields of a type with those of its fields' types, which a table's columns are made of.
MOST_FIELDS = 100_000
# Values that a message of few bytes may have, and how many more for each byte that it has at least.
MOST_VALUES, VALUES_A_BYTE = 100, 16
# Between the request and the response of a service, which a definition may have together.
BETWEEN = "---"
_TEXTS = ("string", "wstring")
# The field of a type without fields: rosbags reads no byte for one of this name in ROS 1.
_PLACEHOLDER = "structure_needs_at_least_one_member"
_OF_ROS_2 = ("ros2msg", "ros2idl")


def full_name(kind: str) -> str:
    """As rosbags calls the type `sensor_msgs/Imu`; one of a service has its folder, too."""
    folder, _, name = kind.rpartition("/")
    return kind if folder.endswith(("/msg", "/action")) else f"{folder}/msg/{name}"


def types_in(kind: str, definition: str, schema_encoding: str) -> dict[str, Any]:
    """All types of a definition by their names. It may raise anything at a text of any kind.

    A byte of ROS 2 is an octet, from 0 to 255; in ROS 1 it is another name of int8.
    """
    found = types_as_written(kind, definition, schema_encoding)
    return with_octets(found) if schema_encoding in _OF_ROS_2 else found


def types_as_written(kind: str, definition: str, schema_encoding: str) -> dict[str, Any]:
    """The same, where a byte is one by that name."""
    if schema_encoding == "ros2idl":
        found = types_in_idl(definition)
    elif len(definition) > MOST_CHARACTERS:
        raise ValueError(f"it has {len(definition)} characters, more than {MOST_CHARACTERS}")
    else:
        found = dict(get_types_from_msg(definition, full_name(kind)))
    _refuse_costly(found)
    if OLD_HEADER in found:
        found.setdefault(HEADER, found[OLD_HEADER])
    return found


def least_bytes(name: str, types: dict[str, Any]) -> int:
    """No message of ROS 2 of this type is shorter, behind its head of four bytes."""
    return _Contents(types).of(name).least_bytes


def with_octets(types: dict[str, Any]) -> dict[str, Any]:
    """Types with uint8 for each byte."""
    return {
        name: (constants, [(field, _octet(kind)) for field, kind in fields])
        for name, (constants, fields) in types.items()
    }


def _refuse_costly(types: dict[str, Any]) -> None:
    """Raises ValueError for types of which a small message takes much time and memory to decode."""
    contents = _Contents(types)
    elements = 0
    for name, field, kind, element, size in _arrays(types):
        if not contents.of_kind(element).least_bytes:
            raise ValueError(f"{name}.{field} is an array of {element[1]}, which has no bytes")
        if kind == Nodetype.ARRAY and (element[0] == Nodetype.NAME or element[1][0] in _TEXTS):
            elements += size
    if elements > MOST_ELEMENTS:
        raise ValueError(
            f"it has fixed arrays of {elements} messages and texts, more than {MOST_ELEMENTS}"
        )
    for name in types:
        found = contents.of(name)
        if found.fields > MOST_FIELDS:
            raise ValueError(
                f"{name} has, with those of its fields' types, more than {MOST_FIELDS} fields"
            )
        if found.values > MOST_VALUES + VALUES_A_BYTE * found.least_bytes:
            raise ValueError(
                f"a message of {name} can take {found.least_bytes} B and have {found.values}"
                f" values, more than {VALUES_A_BYTE} for a byte"
            )


class _Content(NamedTuple):
    """What a value has in it, with all that is in its fields; no number is above _ENOUGH.

    An array is one field. A sequence and a text may be empty.
    """

    least_bytes: int
    values: int
    fields: int

    def times(self, count: int) -> "_Content":
        return _Content(
            min(self.least_bytes * count, _ENOUGH), min(self.values * count, _ENOUGH), self.fields
        )

    def and_all_of(self, others: "list[_Content]") -> "_Content":
        return _Content(*(min(sum(each), _ENOUGH) for each in zip(self, *others, strict=True)))


_ENOUGH = 1 << 62
_ITSELF, _NUMBER, _COUNTED = _Content(0, 1, 0), _Content(1, 1, 0), _Content(4, 1, 0)


class _Contents:
    """What each type has in it: looked at once, however many fields have the type."""

    def __init__(self, types: dict[str, Any]) -> None:
        self._types = types
        self._known: dict[str, _Content] = {}

    def of(self, name: str) -> _Content:
        """Of the type of this name; of one that is not defined here, as of a number."""
        if name not in self._known:
            self._known[name] = _NUMBER  # for what holds itself, which decoders refuse
            if name in self._types:
                fields = self._types[name][1]
                inner = [self._field(field, kind) for field, kind in fields]
                self._known[name] = _ITSELF._replace(fields=len(fields)).and_all_of(inner)
        return self._known[name]

    def _field(self, name: str, kind: Any) -> _Content:
        return _ITSELF if name == _PLACEHOLDER else self.of_kind(kind)

    def of_kind(self, kind: Any) -> _Content:
        """Of a field's type, as rosbags describes it."""
        node, detail = kind
        if node == Nodetype.BASE:
            return _COUNTED if detail[0] in _TEXTS else _NUMBER
        if node == Nodetype.NAME:
            return self.of(detail)
        element = self.of_kind(detail[0])
        if node == Nodetype.SEQUENCE:
            return _COUNTED._replace(fields=element.fields)
        return _ITSELF.and_all_of([element.times(int(detail[1]))])


def _arrays(types: dict[str, Any]) -> Iterator[tuple[str, str, Nodetype, Any, int]]:
    """Type, field, kind, element's type and size of all arrays, as rosbags describes them."""
    for name, (_, fields) in types.items():
        for field, (kind, detail) in fields:
            if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
                yield name, field, kind, detail[0], int(detail[1])


def _octet(kind: Any) -> Any:
    """A field's type, with uint8 for a byte."""
    node, detail = kind
    if node == Nodetype.BASE:
        return (node, ("uint8", 0)) if detail[0] == "byte" else kind
    if node == Nodetype.NAME:
        return kind
    return (node, (_octet(detail[0]), detail[1]))
