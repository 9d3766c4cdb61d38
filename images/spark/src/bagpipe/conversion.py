"""Messages of one ROS as the other has them, by the definitions that their recording has.

A type that the other one has (Jazzy, Noetic) gets its definition, since its nodes take no other;
any other keeps its own fields. A header of ROS 1 has a `seq`, which is 0 in what comes from ROS 2.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import Any

from rosbags.convert.converter import migrate_bytes, migrate_message
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from bagpipe.definition_texts import (
    Texts,
    constants_in,
    constants_of_ros1,
    constants_of_ros2,
    foreign_to_ros1,
    text_of_ros1,
    text_of_ros2,
)
from bagpipe.definitions import (
    HEADER,
    full_name,
    least_bytes,
    types_as_written,
    types_in,
    with_octets,
)
from bagpipe.unconverted import Unconverted, name_in

# What has another name in ROS 2, and the same fields.
_RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
# A char of ROS 1 is an uint8, and one of ROS 2, too. A byte of ROS 2 is one, and of ROS 1 an int8.
_ALIASES = {"char": "uint8"}
_OCTETS = {"char": "uint8", "byte": "uint8"}
_BUILT_IN = "builtin_interfaces/msg/"
_TIME = [("sec", "int32"), ("nanosec", "uint32")]
_STAMPED = [
    ("stamp", (Nodetype.NAME, f"{_BUILT_IN}Time")),
    ("frame_id", (Nodetype.BASE, ("string", 0))),
]
# With which a message in CDR begins.
_LITTLE_ENDIAN = b"\0\1"
_HEAD = 4
# Of which the conversion is kept: many topics of a recording have the same.
_MOST_TYPES = 1024


class ConversionError(ValueError):
    """A type or a message can't be one of the other ROS; the sentence says why."""


@dataclass(frozen=True)
class Conversion:
    """How messages of a type become messages of the other ROS."""

    # As rosbags has its name, such as sensor_msgs/msg/Imu.
    kind: str
    definition: str
    # Of a type of ROS 1.
    md5sum: str
    # Fields that the other ROS alone has, which are 0 or empty, as Type.field.
    added: tuple[str, ...]
    _bytes: Callable[[bytes | memoryview], memoryview] = field(repr=False)

    def convert(self, message: bytes | memoryview) -> bytes:
        """The message as the other one has it. Raises ConversionError for bytes that are none."""
        try:
            return bytes(self._bytes(message))
        except ConversionError:
            raise
        except Exception as error:  # rosbags raises whatever its generated code does
            raise ConversionError(f"it is no {self.kind}: {error}") from error


@lru_cache(_MOST_TYPES)
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
        made_of = _of_ros2(types, name, target, constants_in(name, definition))
        new.register(made_of)
        text = text_of_ros2(target, made_of)
    except Exception as error:  # as at decoding: a definition is anybody's text
        raise _unreadable(kind, error) from error
    found = _Comparison(old, new, "ROS 2", "ROS 1", _ALIASES)
    found.compare(name, target, ())
    added = tuple(dict.fromkeys(found.added))
    return Conversion(target, text, "", added, _into_ros2(found, name, target))


@lru_cache(_MOST_TYPES)
def to_ros1(kind: str, definition: str, schema_encoding: str) -> Conversion:
    """For messages of a type of ROS 2, by its whole definition in `ros2msg` or `ros2idl`.

    Where the recording has none (rosbag2's databases before Iron) the encoding is empty: Jazzy's is
    taken.

    Raises ConversionError where ROS 1 has no place for what a message holds.
    """
    name = full_name(kind)
    if name.split("/")[1:-1] != ["msg"]:
        raise ConversionError(f"{kind}: ROS 1 has no messages of services and actions as a type")
    if name.startswith(_BUILT_IN):
        raise ConversionError(f"{kind}: in ROS 1 it is the type of a field, and of no message")
    try:
        if schema_encoding:
            types = types_as_written(kind, definition, schema_encoding)
        else:
            types = _of_jazzy(name)
        types = _but_built_in(types)
        texts = constants_in(name, definition) if schema_encoding == "ros2msg" else {}
        made_of = _of_ros1(types, name, texts)
        text, md5sum = text_of_ros1(name, made_of)
        old, new = get_typestore(Stores.EMPTY), get_typestore(Stores.EMPTY)
        # An octet is neither of rosbags' bytes.
        old.register(types := with_octets(types))
        new.register(with_octets(made_of))
        without_place = Unconverted(old.fielddefs)
        found = _Comparison(old, new, "ROS 1", "ROS 2", _OCTETS, without_place)
        found.compare(name, name, ())
    except ConversionError:
        raise
    except Exception as error:  # as at decoding: a definition is anybody's text
        raise _unreadable(kind, error) from error
    added = tuple(dict.fromkeys(found.added))
    convert = _into_ros1(found, name, without_place, least_bytes(name, types))
    return Conversion(name, text, md5sum, added, convert)


def _unreadable(kind: str, error: Exception) -> ConversionError:
    return ConversionError(f"{kind}: its definition can't be read: {error}")


def _into_ros2(
    found: "_Comparison", name: str, target: str
) -> Callable[[bytes | memoryview], memoryview]:
    if not found.differs:
        return lambda message: found.new.ros1_to_cdr(message, target)
    kept: dict[str, object] = {}
    return lambda message: migrate_bytes(
        found.old, found.new, name, target, kept, message, src_is2=False, dst_is2=True
    )


def _into_ros1(
    found: "_Comparison", name: str, without_place: Unconverted, least: int
) -> Callable[[bytes | memoryview], memoryview]:
    kept: dict[str, object] = {}

    def converted(message: bytes | memoryview) -> memoryview:
        # Room for all of it is made before it is read.
        if len(message) < _HEAD + least:
            raise ConversionError(
                f"it is no {name}: {len(message)} bytes, of at least {_HEAD + least}"
            )
        # rosbags takes bytes of its own order alone from one serialisation to the other.
        if bytes(message[:2]) == _LITTLE_ENDIAN and not found.differs:
            return found.old.cdr_to_ros1(message, name)
        old = found.old.deserialize_cdr(message, name)
        held = without_place.held(name, old)
        if held is not None:
            raise ConversionError(f"its {held} is not empty, and ROS 1 has no such field")
        new = migrate_message(found.old, found.new, name, name, kept, old)
        return found.new.serialize_ros1(new, name)

    return converted


@cache
def _jazzy() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


def _of_jazzy(name: str) -> dict[str, Any]:
    if name not in _jazzy().fielddefs:
        raise ConversionError(f"the recording has no definition of {name}, nor has Jazzy")
    return _made_of(name, lambda one: _jazzy().fielddefs[one])


@cache
def _noetic() -> Typestore:
    return get_typestore(Stores.ROS1_NOETIC)


def _of_ros2(types: dict[str, Any], name: str, target: str, texts: Texts) -> dict[str, Any]:
    """The types that a type of ROS 2 is made of, by their names."""

    def described(one: str) -> Any:
        if (of_ros2 := _jazzy().fielddefs.get(one)) is not None:
            return of_ros2
        own = name if one == target else one
        constants, fields = types[own]
        return constants_of_ros2(own, constants, texts), fields

    return _made_of(target, described)


def _of_ros1(types: dict[str, Any], name: str, texts: Texts) -> dict[str, Any]:
    """The types that a type of ROS 1 is made of, by their names."""

    def described(one: str) -> Any:
        if (of_ros1 := _noetic().fielddefs.get(one)) is not None:
            return of_ros1
        if one not in types:
            # As wstring, which rosbags takes for a message's type.
            raise ConversionError(f"{name}: neither its definition nor ROS 1 has {one}")
        constants, fields = types[one]
        if (foreign := foreign_to_ros1(fields)) is not None:
            raise ConversionError(f"{name}: ROS 1 has no {foreign}, of which {one} has a field")
        return constants_of_ros1(one, constants, texts), _unbounded(fields)

    return _made_of(name, described)


def _made_of(target: str, described: Callable[[str], Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    left = [target]
    while left:
        one = left.pop()
        if one in found or one.startswith(_BUILT_IN):
            continue
        found[one] = described(one)
        left += [inner for _, each in found[one][1] if (inner := name_in(each)) is not None]
    return found


def _but_built_in(types: dict[str, Any]) -> dict[str, Any]:
    """Without times and durations, which rosbags has: raises ConversionError for others."""
    for name in (f"{_BUILT_IN}Time", f"{_BUILT_IN}Duration"):
        fields = [(each, detail[0]) for each, (_, detail) in types.get(name, ((), ()))[1]]
        if fields not in ([], _TIME):
            raise ConversionError(f"{name} has other fields than an int32 and an uint32")
    return {name: each for name, each in types.items() if not name.startswith(_BUILT_IN)}


def _unbounded(fields: Any) -> list[Any]:
    """Fields without the bounds of their texts and sequences, which ROS 1 does not have."""
    return [(name, _unbounded_field(kind)) for name, kind in fields]


def _unbounded_field(kind: Any) -> Any:
    node, detail = kind
    if node == Nodetype.NAME:
        return kind
    if node == Nodetype.BASE:
        return (node, (detail[0], 0))
    return (node, (_unbounded_field(detail[0]), detail[1] if node == Nodetype.ARRAY else 0))


@dataclass
class _Comparison:
    """Two sets of types, and how those of one name differ."""

    old: Typestore
    new: Typestore
    # Whose the new ones are, and the old ones.
    into: str
    of: str
    # Base types that are the same under two names.
    aliases: dict[str, str]
    # Fields that the new types may lack, as most messages leave them empty; without it, none.
    without_place: Unconverted | None = None
    added: list[str] = field(default_factory=list)
    # Whether fields have other places.
    differs: bool = False

    def compare(self, name: str, target: str, within: tuple[str, ...]) -> None:
        """Raises ConversionError where something of the old type has no place in the new one."""
        if target.startswith(_BUILT_IN):
            return
        if target == HEADER:
            self._header()
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
            for each in names:
                if each not in places:
                    self._misses(name, target, each)
            pairs = [((each, kind), (each, places[each])) for each, kind in old if each in places]
            self.added += [f"{target}.{each}" for each in others if each not in names]
        for (each, kind), (called, other) in pairs:
            # rosbags pairs those of other capital letters where they are of one type.
            if each != called and kind != other:
                raise ConversionError(f"{target}.{each} is of another type in {self.into}")
            self._field(f"{target}.{each}", kind, other, (*within, name))

    def _header(self) -> None:
        """rosbags knows both by their name: with `seq` in ROS 1, and without it in ROS 2."""
        for store, of in ((self.old, self.of), (self.new, self.into)):
            fields = list(store.fielddefs[HEADER][1])
            named = [each for each, _ in fields[:-2]]
            if fields[-2:] != _STAMPED or named not in ([], ["seq"] if of == "ROS 1" else []):
                names = ", ".join(each for each, _ in fields)
                raise ConversionError(f"{HEADER} of {of} has the fields {names}, or of other types")

    def _misses(self, name: str, target: str, each: str) -> None:
        if self.without_place is None:
            raise ConversionError(
                f"{target} of {self.into} has no field {each}, which {self.of}'s has"
            )
        self.without_place.add(name, each)

    def _field(self, where: str, kind: Any, other: Any, within: tuple[str, ...]) -> None:
        (node, detail), (new_node, new_detail) = kind, other
        if node == new_node == Nodetype.NAME:
            if _RENAMED.get(detail, detail) == new_detail:
                self.compare(detail, new_detail, within)
                return
        elif node == new_node == Nodetype.BASE:
            known = self.aliases.get
            if known(detail[0], detail[0]) == known(new_detail[0], new_detail[0]):
                return
        elif node == new_node and self._has_room(node, detail[1], new_detail[1]):
            self._field(where, detail[0], new_detail[0], within)
            return
        raise ConversionError(f"{where} is of another type in {self.into}")

    @staticmethod
    def _has_room(node: Nodetype, size: int, new_size: int) -> bool:
        # A sequence without a bound is one of size 0.
        return size == new_size or (node == Nodetype.SEQUENCE and new_size == 0)
