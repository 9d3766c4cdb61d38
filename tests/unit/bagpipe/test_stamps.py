"""Stamps of headers moved in serialised messages, compared with what rosbags reads of them."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from bagpipe.source import stamps
from bagpipe.source.stamps import StampError

STORE = get_typestore(Stores.ROS1_NOETIC)
TYPES = STORE.types
SECOND = 1_000_000_000


def moved(kind: str, definition: str, raw: bytes, shift: int) -> bytes:
    """Of a message of ROS 1."""
    return stamps.moved(connection(kind, definition, "ros1", "ros1msg"), raw, shift)


def connection(kind: str, definition: str, encoding: str, schema: str) -> SimpleNamespace:
    return SimpleNamespace(
        type=kind, definition=definition, encoding=encoding, schema_encoding=schema
    )


def stamp(ns: int) -> Any:
    return TYPES["builtin_interfaces/msg/Time"](*divmod(ns, SECOND))


def header(ns: int, frame: str = "map") -> Any:
    return TYPES["std_msgs/msg/Header"](seq=7, stamp=stamp(ns), frame_id=frame)


def shifted(kind: str, message: Any, shift: int) -> Any:
    """The message after `moved`, decoded; its other bytes are checked to be the same."""
    name = kind.replace("/", "/msg/")
    definition, _ = STORE.generate_msgdef(name, ros_version=1)
    raw = bytes(STORE.serialize_ros1(message, name))
    return STORE.deserialize_ros1(moved(kind, definition, raw, shift), name)


def ns(message: Any) -> int:
    found = message.header.stamp
    # rosbags takes the seconds for signed, as ROS 2 has them.
    return int(found.sec % (1 << 32)) * SECOND + int(found.nanosec)


def pose_stamped(time: int) -> Any:
    zero = TYPES["geometry_msgs/msg/Point"](1.0, 2.0, 3.0)
    turned = TYPES["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    pose = TYPES["geometry_msgs/msg/Pose"](zero, turned)
    return TYPES["geometry_msgs/msg/PoseStamped"](header(time, f"frame{time}"), pose)


def test_a_header_at_the_front_is_moved_and_nothing_else() -> None:
    data = np.arange(100, dtype=np.uint8)
    image = TYPES["sensor_msgs/msg/Image"](header(5 * SECOND + 3), 10, 10, "mono8", 0, 10, data)
    found = shifted("sensor_msgs/Image", image, -2 * SECOND)
    assert ns(found) == 3 * SECOND + 3
    assert (found.header.seq, found.header.frame_id, found.encoding) == (7, "map", "mono8")
    assert found.data.tolist() == data.tolist()


def test_headers_in_a_list_are_moved_each_by_itself() -> None:
    poses = [pose_stamped(9 * SECOND), pose_stamped(0), pose_stamped(11 * SECOND)]
    path = TYPES["nav_msgs/msg/Path"](header(8 * SECOND), poses)
    found = shifted("nav_msgs/Path", path, SECOND)
    assert ns(found) == 9 * SECOND
    assert [ns(pose) for pose in found.poses] == [10 * SECOND, 0, 12 * SECOND]
    assert [pose.header.frame_id for pose in found.poses] == [
        "frame9000000000", "frame0", "frame11000000000",
    ]  # fmt: skip


def test_headers_behind_fields_of_any_length_are_found() -> None:
    definition = f"""string[] names
float64[3] fixed
geometry_msgs/Point[2] corners
Item[] items
time other
{"=" * 80}
MSG: x/Item
duration[] waits
std_msgs/Header header
{"=" * 80}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
{"=" * 80}
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
"""
    one, two = (1).to_bytes(4, "little"), (2).to_bytes(4, "little")
    before = two + one + b"a" + two + b"bc" + bytes(24) + bytes(48) + two
    item = one + bytes(8) + one + one + one + one + b"f"
    behind = one + one  # a time that is in no header
    found = moved("x/Mixed", definition, before + item + item + behind, SECOND)
    moved_item = one + bytes(8) + one + two + one + one + b"f"
    assert found == before + moved_item + moved_item + behind


@pytest.mark.parametrize(
    ("time", "shift", "expected"),
    [
        (0, 5 * SECOND, 0),
        (5 * SECOND, -6 * SECOND, 0),
        (5 * SECOND, 1 << 63, ((1 << 32) - 1) * SECOND),
        (SECOND - 1, 1, SECOND),
    ],
)
def test_a_stamp_stays_within_what_a_stamp_can_say(time: int, shift: int, expected: int) -> None:
    assert ns(shifted("geometry_msgs/PoseStamped", pose_stamped(time), shift)) == expected


def test_what_has_no_header_or_no_shift_is_left_alone() -> None:
    definition, _ = STORE.generate_msgdef("std_msgs/msg/String", ros_version=1)
    raw = b"\x01\0\0\0a"
    assert moved("std_msgs/String", definition, raw, SECOND) is raw
    assert moved("x/Unknown", "no definition", raw, 0) is raw


def test_a_message_that_is_not_its_type_is_refused() -> None:
    definition, _ = STORE.generate_msgdef("geometry_msgs/msg/PoseStamped", ros_version=1)
    for raw in (b"", b"\0" * 14, b"\0" * 12 + b"\xff\xff\xff\xff"):
        with pytest.raises(StampError, match=f"message of {len(raw)} bytes is no geometry_msgs"):
            moved("geometry_msgs/PoseStamped", definition, raw, SECOND)
    with pytest.raises(StampError, match="the definition of x/Odd can't be read"):
        moved("x/Odd", "Missing field\n", b"", SECOND)


BREAK = "=" * 80
HEADER = f"{BREAK}\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"


def header_bytes(seconds: int, frame: bytes = b"map") -> bytes:
    numbers = (7, seconds, 5, len(frame))
    return b"".join(number.to_bytes(4, "little") for number in numbers) + frame


@pytest.mark.parametrize(
    ("kind", "size"),
    [
        ("bool", 1), ("byte", 1), ("char", 1), ("int8", 1), ("uint8", 1), ("int16", 2),
        ("uint16", 2), ("int32", 4), ("uint32", 4), ("int64", 8), ("uint64", 8), ("float32", 4),
        ("float64", 8), ("time", 8), ("duration", 8),
    ],
)  # fmt: skip
def test_a_header_lies_behind_fields_of_every_kind(kind: str, size: int) -> None:
    definition = f"{kind} one\n{kind}[3] three\n{kind}[] some\nstd_msgs/Header header\n{HEADER}"
    before = b"\xff" * (4 * size) + (2).to_bytes(4, "little") + b"\xff" * (2 * size)
    raw = before + header_bytes(9)
    assert moved("x/Kind", definition, raw, SECOND) == before + header_bytes(10)


def test_lists_of_a_fixed_number_are_walked_one_by_one_where_it_takes_that() -> None:
    definition = (
        f"string[2] names\nItem[2] items\nstd_msgs/Header header\n"
        f"{BREAK}\nMSG: x/Item\nstring name\nstd_msgs/Header header\n{HEADER}"
    )
    text = (3).to_bytes(4, "little") + b"abc"

    def message(*seconds: int) -> bytes:
        one, two, last = map(header_bytes, seconds)
        return text + text + text + one + text + two + last

    assert moved("x/Two", definition, message(4, 5, 6), SECOND) == message(5, 6, 7)


@pytest.mark.parametrize("kind", ["std_msgs/Header", "std_msgs/msg/Header", "roslib/Header"])
def test_a_message_may_be_a_header_itself(kind: str) -> None:
    definition = "uint32 seq\ntime stamp\nstring frame_id\n"
    assert moved(kind, definition, header_bytes(4), -SECOND) == header_bytes(3)


def test_nothing_is_looked_at_behind_the_last_header() -> None:
    definition = f"std_msgs/Header header\nstring text\nfloat64 number\n{HEADER}"
    odd = b"\xff\xff\xff\xff not so long"
    assert moved("x/Odd", definition, header_bytes(4) + odd, SECOND) == header_bytes(5) + odd


def test_a_type_that_holds_itself_is_refused() -> None:
    definition = f"Item[] items\n{BREAK}\nMSG: x/Item\nItem[] items\n"
    with pytest.raises(StampError, match=r"definition of x/Tree can't be read: .* holds itself"):
        moved("x/Tree", definition, b"", SECOND)


def test_a_stamp_of_less_than_a_second_or_of_whole_ones_is_a_time() -> None:
    assert ns(shifted("geometry_msgs/PoseStamped", pose_stamped(7), SECOND)) == SECOND + 7
    assert ns(shifted("geometry_msgs/PoseStamped", pose_stamped(SECOND), 7)) == SECOND + 7
    last = ((1 << 32) - 1) * SECOND
    assert ns(shifted("geometry_msgs/PoseStamped", pose_stamped(SECOND), last - SECOND)) == last
