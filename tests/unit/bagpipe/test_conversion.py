"""Messages of one ROS as messages of the other: the same values, or a refusal."""

import hashlib
import random
from typing import Any

import numpy as np
import pytest
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bagpipe.conversion import ConversionError, to_ros1, to_ros2

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
BUILT_IN = "builtin_interfaces/"
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


def of_ros2(kind: str) -> str:
    return str(NEW.generate_msgdef(kind, ros_version=2)[0])


def into_ros1(kind: str, raw: bytes) -> bytes:
    return to_ros1(kind, of_ros2(kind), "ros2msg").convert(raw)


@pytest.mark.parametrize("kind", [each for each in BOTH if not each.startswith(BUILT_IN)])
def test_each_value_of_a_type_that_ros_1_has_is_there_and_its_definition_is_ros_1_s(
    kind: str,
) -> None:
    chance = random.Random(kind)  # noqa: S311
    back = to_ros1(kind, of_ros2(kind), "ros2msg")
    text, md5sum = OLD.generate_msgdef(kind, ros_version=1)
    assert (back.kind, back.definition, back.md5sum, back.added) == (kind, text, md5sum, ())
    if kind in REFUSED:
        return
    there = to_ros2(kind, definition(kind))
    for _ in range(5):
        cdr = there.convert(bytes(OLD.serialize_ros1(message(kind, chance), kind)))
        old: Any = OLD.deserialize_ros1(back.convert(cdr), kind)
        same(kind, old, NEW.deserialize_cdr(cdr, kind))
        # The order of its bytes is a message's own.
        big = NEW.serialize_cdr(NEW.deserialize_cdr(cdr, kind), kind, little_endian=False)
        assert back.convert(bytes(big)) == back.convert(cdr)


@pytest.mark.parametrize("kind", sorted(set(NEW.fielddefs) - set(OLD.fielddefs)))
def test_a_type_that_ros_2_alone_has_keeps_its_fields(kind: str) -> None:
    found = to_ros1(kind, of_ros2(kind), "ros2msg")
    names = [name for name, _ in get_types_from_msg(found.definition, kind)[kind][1]]
    assert names == [name for name, _ in NEW.fielddefs[kind][1] if name != PLACEHOLDER]
    assert len(found.md5sum) == 32


def test_a_type_that_nobody_knows_loses_its_bounds_and_has_ros_1_s_header() -> None:
    text = f"std_msgs/Header header\nbyte a\nstring<=9[<=4] s\nmine/Part[2] parts\n{'=' * 80}\n"
    text += f"MSG: mine/Part\nbuiltin_interfaces/Duration d\nint32[<=3] n\n{'=' * 80}\n"
    text += f"MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{'=' * 80}\n"
    text += f"MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n{'=' * 80}\n"
    text += "MSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n"
    found = to_ros1("mine/msg/Whole", text, "ros2msg")
    # As gendeps and rosmsg have it: by hand, of the text without its sub-types.
    part = hashlib.md5(b"duration d\nint32[] n").hexdigest()  # noqa: S324
    header = "2176decaecbce78abc3b96ef049fabed"
    own = f"{header} header\nbyte a\nstring[] s\n{part} parts"
    assert found.md5sum == hashlib.md5(own.encode()).hexdigest()  # noqa: S324
    cdr = b"\0\1\0\0\5\0\0\0\6\0\0\0\3\0\0\0hi\0\xfe\1\0\0\0\2\0\0\0s\0\0\0"
    cdr += 2 * b"\1\0\0\0\2\0\0\0\1\0\0\0\7\0\0\0"
    raw = b"\0\0\0\0\5\0\0\0\6\0\0\0\2\0\0\0hi\xfe\1\0\0\0\1\0\0\0s"
    raw += 2 * b"\1\0\0\0\2\0\0\0\1\0\0\0\7\0\0\0"
    assert found.convert(cdr) == raw


def test_a_type_that_the_recording_does_not_define_is_jazzy_s_or_refused() -> None:
    kind = "geometry_msgs/msg/PoseStamped"
    assert to_ros1(kind, "", "").definition == definition(kind)
    with pytest.raises(
        ConversionError, match="no definition of test_msgs/msg/Empty, nor has Jazzy"
    ):
        to_ros1("test_msgs/msg/Empty", "", "")
    # One without fields has an empty definition.
    assert to_ros1("test_msgs/msg/Empty", "", "ros2msg").convert(b"\0\1\0\0\0") == b""


def test_a_field_that_ros_1_does_not_have_is_refused_where_it_is_not_empty() -> None:
    kind = "sensor_msgs/msg/Range"
    header = NEW.types[HEADER](NEW.types["builtin_interfaces/msg/Time"](1, 2), "f")

    def cdr(variance: float) -> bytes:
        one = NEW.types[kind](header, 1, 0.5, 0.25, 2.0, 1.5, variance)
        return bytes(NEW.serialize_cdr(one, kind))

    old: Any = OLD.deserialize_ros1(into_ros1(kind, cdr(0.0)), kind)
    assert (old.header.seq, old.header.frame_id, old.max_range, old.range) == (0, "f", 2.0, 1.5)
    with pytest.raises(ConversionError, match=r"its sensor_msgs/msg/Range\.variance is not empty"):
        into_ros1(kind, cdr(0.5))
    # As deep as it may be.
    kind = "visualization_msgs/msg/InteractiveMarkerUpdate"
    chance = random.Random(1)  # noqa: S311
    there = to_ros2(kind, definition(kind))
    while True:
        update = message(kind, chance)
        markers = [one for pose in update.markers for c in pose.controls for one in c.markers]
        if markers:
            break
    new: Any = NEW.deserialize_cdr(there.convert(bytes(OLD.serialize_ros1(update, kind))), kind)
    into_ros1(kind, bytes(NEW.serialize_cdr(new, kind)))
    last = [one for pose in new.markers for c in pose.controls for one in c.markers][-1]
    for name, value in (
        ("texture_resource", "a"),
        ("uv_coordinates", [NEW.types["visualization_msgs/msg/UVCoordinate"](0.0, 0.0)]),
        ("texture", NEW.types["sensor_msgs/msg/CompressedImage"](header, "", np.empty(0, "u1"))),
    ):
        before = getattr(last, name)
        object.__setattr__(last, name, value)
        with pytest.raises(ConversionError, match=rf"Marker\.{name} is not empty"):
            into_ros1(kind, bytes(NEW.serialize_cdr(new, kind)))
        object.__setattr__(last, name, before)


def test_what_has_no_place_in_ros_1_is_refused_by_its_field() -> None:
    with pytest.raises(ConversionError, match="nor ROS 1 has a/msg/wstring"):
        to_ros1("a/msg/A", "wstring[] s", "ros2msg")
    odd = f"std_msgs/Header h\n{'=' * 80}\nMSG: std_msgs/Header\nint32 count\n"
    with pytest.raises(ConversionError, match="Header of ROS 2 has the fields count"):
        to_ros1("a/msg/A", odd, "ros2msg")
    for fields in (
        "uint32 seq\nbuiltin_interfaces/Time stamp\nstring frame_id",
        "float64 stamp\nstring frame_id",
        "builtin_interfaces/Duration stamp\nstring frame_id",
        "builtin_interfaces/Time stamp\nuint8[] frame_id",
    ):
        odd = f"std_msgs/Header h\n{'=' * 80}\nMSG: std_msgs/Header\n{fields}\n"
        with pytest.raises(ConversionError, match="Header of ROS 2 has the fields"):
            to_ros1("a/msg/A", odd, "ros2msg")
    odd = "builtin_interfaces/Time t\n" + "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\n"
    with pytest.raises(ConversionError, match="Time has other fields than"):
        to_ros1("a/msg/A", f"{odd}int32 nanosec\n", "ros2msg")
    with pytest.raises(ConversionError, match="it is the type of a field, and of no message"):
        to_ros1("builtin_interfaces/msg/Time", "int32 sec\nuint32 nanosec", "ros2msg")
    wide = "module a { module msg { struct A { sequence<long double> w; }; }; };"
    with pytest.raises(ConversionError, match="ROS 1 has no float128, of which a/msg/A has"):
        to_ros1("a/msg/A", wide, "ros2idl")
    # rosbags would leave out what has other capital letters and another bound.
    camera = of_ros2("sensor_msgs/msg/CameraInfo").replace("float64[] d", "float64[<=8] d")
    with pytest.raises(ConversionError, match=r"CameraInfo\.d is of another type in ROS 1"):
        to_ros1("sensor_msgs/msg/CameraInfo", camera, "ros2msg")
    with pytest.raises(ConversionError, match="has several lines"):
        to_ros1("a/msg/A", 'string V="a\nint64 INJECTED"\nint32 x', "ros2msg")
    with pytest.raises(ConversionError, match="no messages of services and actions"):
        to_ros1("example_interfaces/srv/AddTwoInts_Event", "int32 a", "ros2msg")
    with pytest.raises(ConversionError, match="no messages of services and actions"):
        to_ros1("example_interfaces/action/Fibonacci_Feedback", "int32 a", "ros2msg")
    with pytest.raises(ConversionError, match=r"String\.data is of another type in ROS 1"):
        to_ros1("std_msgs/msg/String", "int32 data", "ros2msg")
    with pytest.raises(ConversionError, match=r"String\.more is not empty"):
        to_ros1("std_msgs/msg/String", "string data\nint32 more", "ros2msg").convert(
            b"\0\1\0\0\1\0\0\0\0\0\0\0\1\0\0\0"
        )


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
@pytest.mark.parametrize("encoding", ["ros2msg", "ros2idl"])
def test_any_text_as_a_definition_of_ros_2_is_a_conversion_or_a_sentence(
    text: str, encoding: str
) -> None:
    try:
        found = to_ros1("a/msg/A", text, encoding)
    except ConversionError as error:
        assert "a/" in str(error) or "mine/" in str(error)
    else:
        with pytest.raises(ConversionError, match="it is no a/msg/A"):
            found.convert(b"\1\2\3")


def test_constants_are_written_as_the_recording_has_them_and_bytes_by_their_name() -> None:
    lines = "uint8 F=0x10\nfloat32 G=3.140\nbool B=True\nstring S=1.10\nstring W=007\n"
    lines += "string T=true\nstring U=hello # you\nbyte a\nchar c\n"
    quoted = to_ros2("mine/msg/Part", 'string Q="q"\nint32 a\n')
    assert quoted.definition == "string Q='\"q\"'\nint32 a\n"
    assert to_ros1("mine/msg/Part", quoted.definition, "ros2msg").definition.startswith(
        'string Q="q"'
    )
    kind, md5sum = "mine/msg/Part", hashlib.md5(lines.strip().encode()).hexdigest()  # noqa: S324
    there = to_ros2(kind, lines)
    assert '\nstring S="1.10"\nstring W="007"\nstring T="true"\n' in there.definition
    assert get_types_from_msg(there.definition, kind)[kind][0][3] == ("S", "string", "1.10")
    whole = f"mine/Part p\n{'=' * 80}\nMSG: mine/Part\n"
    back = to_ros1("mine/msg/Whole", whole + lines, "ros2msg")
    assert (back.definition, back.md5sum) == (
        whole + lines,
        hashlib.md5(f"{md5sum} p".encode()).hexdigest(),  # noqa: S324
    )
    # What is written as a value of ROS 2 alone is one of ROS 1.
    odd = to_ros1(
        "a/msg/A", "bool B=true\nstring S=' a b ' # 'c'\nint32 N=3 # three\nint32 n\n", "ros2msg"
    )
    assert odd.definition == "bool B=True\nstring S=a b\nint32 N=3\nint32 n\n"


def test_texts_of_constants_in_idl_are_kept_and_those_that_ros_1_has_not_left_out() -> None:
    text = 'module a { module msg { module A_Constants { const string F = "base # link";\n'
    text += "const wstring W = \"w\"; const char C = 'a'; const octet O = 3; };\n"
    text += '@verbatim(language="comment", text="one") struct A { octet o; }; }; };'
    found = to_ros1("a/msg/A", text, "ros2idl")
    assert found.definition == "string F=base # link\nchar C=97\nbyte O=3\nbyte o\n"
    assert found.convert(b"\0\1\0\0\xc8") == b"\xc8"


@pytest.mark.parametrize("head", [b"\0\0\0\0", b"\0\1\0\0"])
def test_an_octet_keeps_its_bits_in_either_order_of_bytes(head: bytes) -> None:
    assert into_ros1("std_msgs/msg/Byte", head + b"\xc8") == b"\xc8"
    assert to_ros1("a/msg/A", "byte a", "ros2msg").convert(head + b"\xc8") == b"\xc8"


def test_a_message_that_is_too_short_for_its_arrays_costs_no_memory() -> None:
    found = to_ros1("a/msg/A", "uint8[4000000000] a", "ros2msg")
    with pytest.raises(ConversionError, match="8 bytes, of at least 4000000004"):
        found.convert(b"\0\1\0\0\0\0\0\0")
