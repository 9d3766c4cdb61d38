"""Every layout that is written by hand, against rosbags' own serialisation of the same message, in
ROS 1 and in ROS 2."""

import math
import struct
from typing import Any

import numpy as np
import pytest

from bagpipe.simulator import messages
from bagpipe.simulator.actors import Body
from bagpipe.simulator.markers import markers
from bagpipe.simulator.messages import ControlError, publication, wish
from bagpipe.simulator.scenario import Barrier, Scene, StopLine
from bagpipe.simulator.serialisation import CDR, ROS1, Serialisation
from bagpipe.simulator.vehicle import Pose, Wish

NUMBER, TIME = 7, 12_300_000_000


@pytest.fixture(params=[ROS1, CDR], ids=lambda own: own.name)
def own(request: pytest.FixtureRequest) -> Serialisation:
    found: Serialisation = request.param
    return found


def read(own: Serialisation, kind: str, data: bytes) -> Any:
    """Decoded, after it was seen to encode to the same bytes again."""
    name = kind.replace("/", "/msg/")
    decode = own.types.deserialize_ros1 if own is ROS1 else own.types.deserialize_cdr
    message = decode(data, name)
    assert own.serialised(message, kind) == data
    return message


def check_header(header: Any, frame: str) -> None:
    assert (header.stamp.sec, header.stamp.nanosec) == (12, 300_000_000)
    assert getattr(header, "seq", NUMBER) == NUMBER
    assert header.frame_id == frame


def test_odometry(own: Serialisation) -> None:
    pose = Pose(1.5, -2.5, math.pi / 3, 20.0, 0.25, 0.125)
    decoded = read(own, messages.ODOMETRY, messages.odometry(own, NUMBER, TIME, pose))
    check_header(decoded.header, "map")
    assert decoded.child_frame_id == "base_link"
    where, turned = decoded.pose.pose.position, decoded.pose.pose.orientation
    assert (where.x, where.y, where.z) == (1.5, -2.5, 0.0)
    assert (turned.z, turned.w) == pytest.approx((0.5, math.sqrt(3) / 2))
    motion = decoded.twist.twist
    assert (motion.linear.x, motion.linear.y, motion.angular.z) == (20.0, 0.25, 0.125)
    assert len(decoded.pose.covariance) == len(decoded.twist.covariance) == 36


def test_poses(own: Serialisation) -> None:
    bodies = [Body(1, 2, 0, 4, 2), Body(-3, 4, math.pi, 4, 2)]
    decoded = read(own, messages.POSES, messages.poses(own, NUMBER, TIME, bodies))
    check_header(decoded.header, "map")
    assert [(p.position.x, p.position.y) for p in decoded.poses] == [(1, 2), (-3, 4)]
    assert decoded.poses[1].orientation.z == pytest.approx(1)
    assert read(own, messages.POSES, messages.poses(own, NUMBER, TIME, [])).poses == []


def test_flags_and_lights(own: Serialisation) -> None:
    assert read(own, messages.FLAG, messages.flag(own, True)).data is True
    assert read(own, messages.FLAG, messages.flag(own, False)).data is False
    assert read(own, messages.LIGHTS, messages.lights(own, [0, 2, 1])).data.tolist() == [0, 2, 1]


def test_a_cloud(own: Serialisation) -> None:
    points = np.array([[1, 2, 0], [3, 4, 0]], dtype="<f4").tobytes()
    decoded = read(own, messages.CLOUD, messages.cloud(own, NUMBER, TIME, points))
    check_header(decoded.header, "base_link")
    assert (decoded.height, decoded.width, decoded.point_step, decoded.row_step) == (1, 2, 12, 24)
    assert [(f.name, f.offset, f.datatype) for f in decoded.fields] == [
        ("x", 0, 7), ("y", 4, 7), ("z", 8, 7),
    ]  # fmt: skip
    assert bytes(decoded.data) == points
    assert decoded.is_dense


def test_the_scene_has_its_lanes_stop_lines_and_barriers(own: Serialisation) -> None:
    scene = Scene(
        lanes=2, lane_width=4, stop_lines=[StopLine(x=30)],
        barriers=[Barrier(x=9, y=1, length=3, width=2)],
    )  # fmt: skip
    lanes, stops, barrier = read(own, messages.MARKERS, markers(own, scene, TIME)).markers
    assert [point.y for point in lanes.points] == [-2, -2, 2, 2, 6, 6]
    assert [(point.x, point.y) for point in stops.points] == [(30, -2), (30, 6)]
    assert (barrier.ns, barrier.scale.x, barrier.scale.y) == ("barriers", 3, 2)
    assert (barrier.pose.position.x, barrier.pose.position.y) == (9, 1)


@pytest.mark.parametrize(
    ("kind", "md5sum"),
    [
        # As ROS 1's own packages have them.
        (messages.ODOMETRY, "cd5e73d190d741a2f92e81eda573aca7"),
        (messages.POSES, "916c28c5764443f268b296bb671b9d97"),
        (messages.FLAG, "8b94c1b53db61fb6aed406028ad6332a"),
        (messages.CLOUD, "1158d486dd51d683ce2f1be655c3c181"),
    ],
)
def test_types_have_ros_own_md5_sums(kind: str, md5sum: str) -> None:
    found = publication(ROS1, "/t", kind)
    assert (found.type, found.md5sum) == (kind, md5sum)
    assert found.definition


NUMBERS = (12.5, 0, 0, 0, 0, -0.25)
TWIST = struct.pack("<6d", *NUMBERS)


def test_ros_2_calls_types_by_longer_names() -> None:
    found = publication(CDR, "/t", messages.ODOMETRY, latching=True)
    assert (found.type, found.latching) == ("nav_msgs/msg/Odometry", True)
    assert "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp" in found.definition


def twist(own: Serialisation, kind: str) -> tuple[str, bytes]:
    """As rosbags serialises one, with a frame whose name is of any length."""
    types = own.types.types
    vector = types["geometry_msgs/msg/Vector3"]
    made = types["geometry_msgs/msg/Twist"](linear=vector(12.5, 0, 0), angular=vector(0, 0, -0.25))
    if kind != "geometry_msgs/Twist":
        stamp = types["builtin_interfaces/msg/Time"](sec=4, nanosec=5)
        only_in_ros1 = {"seq": 1} if own is ROS1 else {}
        frame = kind.partition(" ")[2]
        header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **only_in_ros1)
        made = types["geometry_msgs/msg/TwistStamped"](header=header, twist=made)
    name = kind.partition(" ")[0]
    return own.type_name(name), own.serialised(made, name)


@pytest.mark.parametrize(
    "kind",
    ["geometry_msgs/Twist", *(f"geometry_msgs/TwistStamped {'f' * size}" for size in range(9))],
)
def test_a_wish_is_the_speed_and_the_yaw_rate(own: Serialisation, kind: str) -> None:
    assert wish(own, "/cmd", *twist(own, kind)) == Wish(12.5, -0.25)


def test_a_wish_in_the_other_order_of_bytes_is_the_same() -> None:
    big = b"\0\0\0\0" + struct.pack(">6d", *NUMBERS)
    assert wish(CDR, "/cmd", "geometry_msgs/msg/Twist", big) == Wish(12.5, -0.25)


HEAD = b"\0\1\0\0"


@pytest.mark.parametrize(
    ("own", "kind", "data", "words"),
    [
        (ROS1, "std_msgs/String", b"", "publishes std_msgs/String on /cmd, and the simulator"),
        (ROS1, "geometry_msgs/Twist", TWIST[:-1], "Twist: it has 47 bytes, and 48 are expected"),
        (ROS1, "geometry_msgs/TwistStamped", b"\0" * 9, "and it ends within its header"),
        (ROS1, "geometry_msgs/TwistStamped", b"\xff" * 60, "is no geometry_msgs/TwistStamped"),
        (ROS1, "geometry_msgs/Twist", struct.pack("<6d", math.inf, 0, 0, 0, 0, 0), "the speed inf"),
        (CDR, "geometry_msgs/Twist", HEAD + TWIST, "obeys geometry_msgs/msg/Twist or"),
        (CDR, "geometry_msgs/msg/Twist", TWIST, "Twist: it has 48 bytes, and 52 are expected"),
        (CDR, "geometry_msgs/msg/Twist", b"", "it does not begin as CDR does"),
        (CDR, "geometry_msgs/msg/Twist", b"\0\7\0\0" + TWIST, "it does not begin as CDR does"),
        (CDR, "geometry_msgs/msg/Twist", HEAD + TWIST + b"\0", "it has 53 bytes, and 52 are"),
        (CDR, "geometry_msgs/msg/TwistStamped", HEAD + b"\0" * 5, "it ends within its header"),
        (CDR, "geometry_msgs/msg/TwistStamped", HEAD + b"\xff" * 70, "is no geometry_msgs/msg/T"),
    ],
)  # fmt: skip
def test_what_steers_no_car_is_refused(
    own: Serialisation, kind: str, data: bytes, words: str
) -> None:
    with pytest.raises(ControlError, match=words):
        wish(own, "/cmd", kind, data)
