"""Messages of ROS 1 as messages of ROS 2: the same values, or a refusal."""

import random
from typing import Any

import numpy as np
import pytest
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bagpipe.conversion import ConversionError, to_ros2

OLD, NEW = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)
HEADER = "std_msgs/msg/Header"
# The field of a type without fields.
PLACEHOLDER = "structure_needs_at_least_one_member"
# What ROS 2 has of the same name and with more or other fields, of all that are in both.
GROWN = {
    "sensor_msgs/msg/Range",
    "visualization_msgs/msg/InteractiveMarker",
    "visualization_msgs/msg/InteractiveMarkerControl",
    "visualization_msgs/msg/InteractiveMarkerInit",
    "visualization_msgs/msg/InteractiveMarkerUpdate",
    "visualization_msgs/msg/Marker",
    "visualization_msgs/msg/MarkerArray",
}
REFUSED = {"shape_msgs/msg/SolidPrimitive"}
BOTH = sorted(set(OLD.fielddefs) & set(NEW.fielddefs))


def definition(kind: str) -> str:
    return str(OLD.generate_msgdef(kind, ros_version=1)[0])


def value(kind: Any, chance: random.Random) -> Any:
    """Of a field of ROS 1, as rosbags has it."""
    node, detail = kind
    if node == Nodetype.NAME:
        return message(detail, chance)
    if node == Nodetype.BASE:
        return base(detail[0], chance)
    length = detail[1] if node == Nodetype.ARRAY else chance.randrange(4)
    each = [value(detail[0], chance) for _ in range(length)]
    inner, name = detail[0][0], detail[0][1][0]
    if inner == Nodetype.NAME or name == "string":
        return each
    return np.array(each, dtype={"char": "uint8", "byte": "int8"}.get(name, name))


def base(name: str, chance: random.Random) -> Any:
    if name == "string":
        return "".join(chance.choices("aé\n", k=chance.randrange(6)))
    if name == "bool":
        return chance.random() < 0.5
    return float(chance.randrange(-99, 99)) / 4 if "float" in name else chance.randrange(100)


def message(kind: str, chance: random.Random) -> Any:
    return OLD.types[kind](*(value(each, chance) for _, each in OLD.fielddefs[kind][1]))


def same(kind: str, old: Any, new: Any) -> None:
    """That each field of ROS 1's, but a header's seq, has its value."""
    if kind.startswith("builtin_interfaces"):
        assert (old.sec, old.nanosec) == (new.sec, new.nanosec)
        return
    for name, each in OLD.fielddefs[kind][1]:
        if (kind, name) == (HEADER, "seq") or name == PLACEHOLDER:
            continue
        after = getattr(new, name if hasattr(new, name) else name.lower())
        before = getattr(old, name)
        inner: Any = each if each[0] == Nodetype.NAME else each[1][0]
        if each[0] == Nodetype.NAME:
            same(str(each[1]), before, after)
        elif each[0] != Nodetype.BASE and inner[0] == Nodetype.NAME:
            assert len(before) == len(after)
            for one, other in zip(before, after, strict=True):
                same(inner[1], one, other)
        else:
            assert np.array_equal(np.asarray(before), np.asarray(after)), (kind, name)


@pytest.mark.parametrize("kind", [each for each in BOTH if each not in REFUSED])
def test_each_value_of_a_type_that_ros_2_has_is_there(kind: str) -> None:
    chance = random.Random(kind)  # noqa: S311
    found = to_ros2(kind, definition(kind))
    assert found.kind == kind
    assert bool(found.added) == (kind in GROWN), found.added
    for _ in range(5):
        old = message(kind, chance)
        raw = bytes(OLD.serialize_ros1(old, kind))
        same(kind, old, NEW.deserialize_cdr(found.convert(raw), kind))


@pytest.mark.parametrize("kind", ["sensor_msgs/msg/CameraInfo", "nav_msgs/msg/Odometry"])
def test_the_definition_is_ros_2_s_own(kind: str) -> None:
    found = to_ros2(kind, definition(kind))
    assert found.definition == NEW.generate_msgdef(kind, ros_version=2)[0]


def test_a_type_that_nobody_knows_keeps_its_fields_and_has_ros_2_s_header() -> None:
    text = f"Header header\nchar a\nbyte[2] b\nmine/Part[] parts\n{'=' * 80}\nMSG: mine/Part\n"
    text += f"duration d\nstring s\n{'=' * 80}\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\n"
    text += "string frame_id\n"
    found = to_ros2("mine/Whole", text)
    assert (found.kind, found.added) == ("mine/msg/Whole", ())
    types = get_types_from_msg(found.definition, found.kind)
    assert [name for name, _ in types[found.kind][1]] == ["header", "a", "b", "parts"]
    assert [name for name, _ in types[HEADER][1]] == ["stamp", "frame_id"]
    raw = b"\7\0\0\0\5\0\0\0\6\0\0\0\2\0\0\0hi\xfe\x01\xff"
    raw += b"\1\0\0\0\xff\xff\xff\xff\3\0\0\0\1\0\0\0s"
    cdr = b"\0\1\0\0\5\0\0\0\6\0\0\0\3\0\0\0hi\0\xfe\x01\xff\0\0"
    cdr += b"\1\0\0\0\xff\xff\xff\xff\3\0\0\0\2\0\0\0s\0"
    assert found.convert(raw) == cdr


def test_transforms_of_the_old_tf_are_those_of_tf2() -> None:
    kind = "geometry_msgs/msg/TransformStamped"
    text = (
        f"geometry_msgs/TransformStamped[] transforms\n{'=' * 80}\nMSG: {kind}\n{definition(kind)}"
    )
    found = to_ros2("tf/tfMessage", text)
    assert found.kind == "tf2_msgs/msg/TFMessage"
    chance = random.Random(3)  # noqa: S311
    old = [message(kind, chance) for _ in range(3)]
    raw = b"\3\0\0\0" + b"".join(bytes(OLD.serialize_ros1(each, kind)) for each in old)
    new: Any = NEW.deserialize_cdr(found.convert(raw), found.kind)
    for before, after in zip(old, new.transforms, strict=True):
        same(kind, before, after)


def test_what_has_no_place_in_ros_2_is_refused_by_its_field() -> None:
    kind = "shape_msgs/msg/SolidPrimitive"
    with pytest.raises(ConversionError, match=r"SolidPrimitive\.dimensions is of another type"):
        to_ros2(kind, definition(kind))
    with pytest.raises(ConversionError, match="of ROS 2 has no field more"):
        to_ros2("std_msgs/String", "string data\nstring more")
    with pytest.raises(ConversionError, match=r"String\.data is of another type"):
        to_ros2("std_msgs/String", "int32 data")
    # The same types in another order: by place, each would be the other.
    swapped = to_ros2("geometry_msgs/Point", "float64 y\nfloat64 x\nfloat64 z")
    new: Any = NEW.deserialize_cdr(
        swapped.convert(np.array([1.0, 2.0, 3.0]).tobytes()), "geometry_msgs/msg/Point"
    )
    assert (new.x, new.y, new.z) == (2.0, 1.0, 3.0)


@pytest.mark.parametrize(
    "text",
    [
        "a/B b",
        "",
        "int32",
        "string[] s\n\0",
        "a/A a",
        "mine/Gone g",
        "int32 class",
        "int32[9999999] a",
    ],
)
def test_any_text_as_a_definition_is_a_conversion_or_a_sentence(text: str) -> None:
    try:
        found = to_ros2("a/A", text)
    except ConversionError as error:
        assert "a/" in str(error) or "mine/" in str(error)
    else:
        with pytest.raises(ConversionError, match="it is no a/msg/A"):
            found.convert(b"\1\2\3")


def test_bytes_that_are_no_such_message_are_refused() -> None:
    kind = "std_msgs/msg/String"
    found = to_ros2(kind, definition(kind))
    for raw in (b"", b"\5\0\0\0abc", b"\1\0\0\0ab"):
        with pytest.raises(ConversionError, match="it is no std_msgs/msg/String"):
            found.convert(raw)
