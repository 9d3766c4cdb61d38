"""The types that a recorded definition has, as rosbags describes them."""

from collections.abc import Iterator
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg

from bagpipe.idl import types_in_idl

HEADER = "std_msgs/msg/Header"
# Before ROS Diamondback the header lived in roslib; definitions say "Header" of both.
OLD_HEADER = "roslib/msg/Header"
# rosbags writes a line of Python for each element of a fixed array of messages or texts.
MOST_ELEMENTS = 4096
_TEXTS = ("string", "wstring")
_OF_ROS_2 = ("ros2msg", "ros2idl")


def full_name(kind: str) -> str:
    """As rosbags calls the type `sensor_msgs/Imu`; one of a service has its folder, too."""
    folder, _, name = kind.rpartition("/")
    return kind if folder.endswith(("/msg", "/action")) else f"{folder}/msg/{name}"


def types_in(kind: str, definition: str, schema_encoding: str) -> dict[str, Any]:
    """All types of a definition by their names. It may raise anything at a text of any kind.

    A byte of ROS 2 is an octet, from 0 to 255; in ROS 1 it is another name of int8.
    """
    if schema_encoding == "ros2idl":
        found = types_in_idl(definition)
    else:
        found = dict(get_types_from_msg(definition, full_name(kind)))
    _refuse_costly(found)
    if schema_encoding in _OF_ROS_2:
        found = {name: (consts, _octets(fields)) for name, (consts, fields) in found.items()}
    if OLD_HEADER in found:
        found.setdefault(HEADER, found[OLD_HEADER])
    return found


def _refuse_costly(types: dict[str, Any]) -> None:
    """Raises ValueError for types of which a small message takes much time and memory to decode."""
    elements = 0
    for name, field, kind, element, size in _arrays(types):
        if _takes_no_byte(element, types):
            raise ValueError(f"{name}.{field} is an array of {element[1]}, which has no bytes")
        if kind == Nodetype.ARRAY and (element[0] == Nodetype.NAME or element[1][0] in _TEXTS):
            elements += size
    if elements > MOST_ELEMENTS:
        raise ValueError(
            f"it has fixed arrays of {elements} messages and texts, more than {MOST_ELEMENTS}"
        )


def _arrays(types: dict[str, Any]) -> Iterator[tuple[str, str, Nodetype, Any, int]]:
    """Type, field, kind, element's type and size of all arrays, as rosbags describes them."""
    for name, (_, fields) in types.items():
        for field, (kind, detail) in fields:
            if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
                yield name, field, kind, detail[0], int(detail[1])


def _takes_no_byte(kind: Any, types: dict[str, Any], outer: frozenset[str] = frozenset()) -> bool:
    """Whether four bytes could be the count of four thousand million of them."""
    node, detail = kind
    if node == Nodetype.ARRAY:
        return detail[1] == 0 or _takes_no_byte(detail[0], types, outer)
    if node != Nodetype.NAME or detail in outer or detail not in types:
        return False
    return all(_takes_no_byte(each, types, outer | {detail}) for _, each in types[detail][1])


def _octets(fields: Any) -> list[Any]:
    return [(name, _octet(kind)) for name, kind in fields]


def _octet(kind: Any) -> Any:
    """A field's type, with uint8 for a byte."""
    node, detail = kind
    if node == Nodetype.BASE:
        return (node, ("uint8", 0)) if detail[0] == "byte" else kind
    if node == Nodetype.NAME:
        return kind
    return (node, (_octet(detail[0]), detail[1]))
