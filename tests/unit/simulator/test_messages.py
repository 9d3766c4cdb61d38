"""Every layout that is written by hand, against rosbags' own serialisation of the same message."""

import math
import struct
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from bagpipe.simulator import messages
from bagpipe.simulator.actors import Body
from bagpipe.simulator.markers import markers
from bagpipe.simulator.messages import ControlError, publication, wish
from bagpipe.simulator.scenario import Barrier, Scene, StopLine
from bagpipe.simulator.vehicle import Pose, Wish

STORE = get_typestore(Stores.ROS1_NOETIC)
NUMBER, TIME = 7, 12_300_000_000


def read(kind: str, data: bytes) -> Any:
    """Decoded, after it was seen to encode to the same bytes again."""
    name = kind.replace("/", "/msg/")
    message = STORE.deserialize_ros1(data, name)
    assert bytes(STORE.serialize_ros1(message, name)) == data
    return message


def check_header(header: Any, frame: str) -> None:
    assert (header.seq, header.stamp.sec, header.stamp.nanosec) == (7, 12, 300_000_000)
    assert header.frame_id == frame


def test_odometry() -> None:
    pose = Pose(1.5, -2.5, math.pi / 3, 20.0, 0.25, 0.125)
    decoded = read(messages.ODOMETRY, messages.odometry(NUMBER, TIME, pose))
    check_header(decoded.header, "map")
    assert decoded.child_frame_id == "base_link"
    where, turned = decoded.pose.pose.position, decoded.pose.pose.orientation
    assert (where.x, where.y, where.z) == (1.5, -2.5, 0.0)
    assert (turned.z, turned.w) == pytest.approx((0.5, math.sqrt(3) / 2))
    motion = decoded.twist.twist
    assert (motion.linear.x, motion.linear.y, motion.angular.z) == (20.0, 0.25, 0.125)
    assert len(decoded.pose.covariance) == len(decoded.twist.covariance) == 36


def test_poses() -> None:
    bodies = [Body(1, 2, 0, 4, 2), Body(-3, 4, math.pi, 4, 2)]
    decoded = read(messages.POSES, messages.poses(NUMBER, TIME, bodies))
    check_header(decoded.header, "map")
    assert [(p.position.x, p.position.y) for p in decoded.poses] == [(1, 2), (-3, 4)]
    assert decoded.poses[1].orientation.z == pytest.approx(1)
    assert read(messages.POSES, messages.poses(NUMBER, TIME, [])).poses == []


def test_flags_and_lights() -> None:
    assert read(messages.FLAG, messages.flag(True)).data is True
    assert read(messages.FLAG, messages.flag(False)).data is False
    assert read(messages.LIGHTS, messages.lights([0, 2, 1])).data.tolist() == [0, 2, 1]


def test_a_cloud() -> None:
    points = np.array([[1, 2, 0], [3, 4, 0]], dtype="<f4").tobytes()
    decoded = read(messages.CLOUD, messages.cloud(NUMBER, TIME, points))
    check_header(decoded.header, "base_link")
    assert (decoded.height, decoded.width, decoded.point_step, decoded.row_step) == (1, 2, 12, 24)
    assert [(f.name, f.offset, f.datatype) for f in decoded.fields] == [
        ("x", 0, 7), ("y", 4, 7), ("z", 8, 7),
    ]  # fmt: skip
    assert bytes(decoded.data) == points
    assert decoded.is_dense


def test_the_scene_has_its_lanes_stop_lines_and_barriers() -> None:
    scene = Scene(
        lanes=2, lane_width=4, stop_lines=[StopLine(x=30)],
        barriers=[Barrier(x=9, y=1, length=3, width=2)],
    )  # fmt: skip
    lanes, stops, barrier = read(messages.MARKERS, markers(scene, TIME)).markers
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
    found = publication("/t", kind)
    assert (found.type, found.md5sum) == (kind, md5sum)
    assert found.definition


TWIST = struct.pack("<6d", 12.5, 0, 0, 0, 0, -0.25)


def test_a_wish_is_the_speed_and_the_yaw_rate() -> None:
    assert wish("/cmd", "geometry_msgs/Twist", TWIST) == Wish(12.5, -0.25)
    stamped = messages.header(1, 5, "base_link") + TWIST
    assert wish("/cmd", "geometry_msgs/TwistStamped", stamped) == Wish(12.5, -0.25)


@pytest.mark.parametrize(
    ("kind", "data", "words"),
    [
        ("std_msgs/String", b"", "publishes std_msgs/String on /cmd, and the simulator obeys"),
        ("geometry_msgs/Twist", TWIST[:-1], "is no geometry_msgs/Twist: it has 47 bytes"),
        ("geometry_msgs/TwistStamped", b"\0" * 9, "is no geometry_msgs/TwistStamped"),
        ("geometry_msgs/TwistStamped", b"\xff" * 60, "is no geometry_msgs/TwistStamped"),
        ("geometry_msgs/Twist", struct.pack("<6d", math.inf, 0, 0, 0, 0, 0), "the speed inf"),
    ],
)
def test_what_steers_no_car_is_refused(kind: str, data: bytes, words: str) -> None:
    with pytest.raises(ControlError, match=words):
        wish("/cmd", kind, data)
