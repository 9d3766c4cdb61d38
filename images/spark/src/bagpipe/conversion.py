"""Messages of ROS 1 as ROS 2 serialises them (CDR), by the definitions that their recording has.

A type that Jazzy has gets Jazzy's definition, since its nodes take no other; any other keeps its
own. In ROS 2 a header has no `seq`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from rosbags.convert.converter import migrate_bytes
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from bagpipe.definitions import HEADER, full_name, types_in

# What has another name in ROS 2, and the same fields.
_RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
# A char of ROS 1 is an uint8, and one of ROS 2, too.
_ALIASES = {"char": "uint8"}
_BUILT_IN = "builtin_interfaces/msg/"


class ConversionError(ValueError):
    """A type or a message can't be one of ROS 2; the sentence says why."""


@dataclass(frozen=True)
class Conversion:
    """How messages of a type of ROS 1 become messages of ROS 2."""

    kind: str
    definition: str
    # Fields that ROS 2 alone has, which are 0 or empty, as Type.field.
    added: tuple[str, ...]
    _bytes: Callable[[bytes | memoryview], memoryview] = field(repr=False)

    def convert(self, message: bytes | memoryview) -> bytes:
        """The message in CDR. Raises ConversionError for bytes that are no such message."""
        try:
            return bytes(self._bytes(message))
        except Exception as error:  # rosbags raises whatever its generated code does
            raise ConversionError(f"it is no {self.kind}: {error}") from error


def to_ros2(kind: str, definition: str) -> Conversion:
    """For messages of a type of ROS 1, such as sensor_msgs/Imu, by its whole definition.

    Raises ConversionError where ROS 2's type of the name has no place for what a message holds.
    """
    name = full_name(kind)
    target = _RENAMED.get(name, name)
    try:
        types = types_in(kind, definition, "ros1msg")
        old, new = get_typestore(Stores.EMPTY), get_typestore(Stores.EMPTY)
        old.register(types)
        new.register(_of_ros2(types, name, target))
    except Exception as error:  # as at decoding: a definition is anybody's text
        raise ConversionError(f"{kind}: its definition can't be read: {error}") from error
    found = _Comparison(old, new)
    found.compare(name, target, ())
    text = str(new.generate_msgdef(target, ros_version=2)[0])
    return Conversion(
        target, text, tuple(dict.fromkeys(found.added)), _converter(found, name, target)
    )


def _converter(
    found: "_Comparison", name: str, target: str
) -> Callable[[bytes | memoryview], memoryview]:
    if not found.differs:
        return lambda message: found.new.ros1_to_cdr(message, target)
    kept: dict[str, object] = {}
    return lambda message: migrate_bytes(
        found.old, found.new, name, target, kept, message, src_is2=False, dst_is2=True
    )


@cache
def _jazzy() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


def _of_ros2(types: dict[str, Any], name: str, target: str) -> dict[str, Any]:
    """The types that a type of ROS 2 is made of, by their names."""
    found: dict[str, Any] = {}
    left = [target]
    while left:
        one = left.pop()
        if one in found or one.startswith(_BUILT_IN):
            continue
        of_ros2 = _jazzy().fielddefs.get(one)
        found[one] = of_ros2 if of_ros2 is not None else types[name if one == target else one]
        left += [inner for _, each in found[one][1] if (inner := _name_in(each)) is not None]
    return found


def _name_in(kind: Any) -> str | None:
    """The type that a field, or an element of it, is a message of."""
    node, detail = kind
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return _name_in(detail[0])
    return str(detail) if node == Nodetype.NAME else None


@dataclass
class _Comparison:
    """Two sets of types, and how those of one name differ."""

    old: Typestore
    new: Typestore
    added: list[str] = field(default_factory=list)
    # Whether fields have other places.
    differs: bool = False

    def compare(self, name: str, target: str, within: tuple[str, ...]) -> None:
        """Raises ConversionError where something of the old type has no place in the new one."""
        if target == HEADER or target.startswith(_BUILT_IN):
            return
        if name in within:
            raise ConversionError(f"{name} holds itself")
        old, new = self.old.fielddefs[name][1], self.new.fielddefs[target][1]
        names, others = ([each for each, _ in fields] for fields in (old, new))
        # ROS 2 has no capital letters in names: a camera's K is its k.
        if [each.lower() for each in names] == [each.lower() for each in others]:
            pairs = list(zip(old, new, strict=True))
        else:
            self.differs = True
            places = dict(new)
            missing = [each for each in names if each not in places]
            if missing:
                raise ConversionError(
                    f"{target} of ROS 2 has no field {missing[0]}, which ROS 1's has"
                )
            pairs = [((each, kind), (each, places[each])) for each, kind in old]
            self.added += [f"{target}.{each}" for each in others if each not in names]
        for (each, kind), (_, other) in pairs:
            self._field(f"{target}.{each}", kind, other, (*within, name))

    def _field(self, where: str, kind: Any, other: Any, within: tuple[str, ...]) -> None:
        (node, detail), (new_node, new_detail) = kind, other
        if node == new_node == Nodetype.NAME:
            if _RENAMED.get(detail, detail) == new_detail:
                self.compare(detail, new_detail, within)
                return
        elif node == new_node == Nodetype.BASE:
            if _ALIASES.get(detail[0], detail[0]) == _ALIASES.get(new_detail[0], new_detail[0]):
                return
        elif node == new_node and detail[1] == new_detail[1]:
            self._field(where, detail[0], new_detail[0], within)
            return
        raise ConversionError(f"{where} is of another type in ROS 2")
