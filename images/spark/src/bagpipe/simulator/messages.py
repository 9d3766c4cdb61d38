"""The simulator's messages as ROS 1 serialises them, written straight into bytes.

Which type, md5 sum and definition a topic has comes from rosbags; the tests compare every layout
here with that library's own serialisation.
"""

import math
import struct
from dataclasses import dataclass
from functools import cache
from typing import Any

from rosbags.typesys import Stores, get_typestore

from bagpipe.simulator.actors import Body
from bagpipe.simulator.vehicle import Pose, Wish

FRAME = "map"
BODY_FRAME = "base_link"

ODOMETRY = "nav_msgs/Odometry"
POSES = "geometry_msgs/PoseArray"
FLAG = "std_msgs/Bool"
LIGHTS = "std_msgs/UInt8MultiArray"
CLOUD = "sensor_msgs/PointCloud2"
MARKERS = "visualization_msgs/MarkerArray"
CONTROLS = ("geometry_msgs/Twist", "geometry_msgs/TwistStamped")

_NO_COVARIANCE = struct.pack("<36d", *[0.0] * 36)
_POINT_BYTES = 12
_FLOAT32 = 7


class ControlError(Exception):
    """What came on the control topic steers no car; the sentence is for the user."""


@dataclass(frozen=True)
class Publication:
    """A topic as its publisher advertises it."""

    topic: str
    type: str
    md5sum: str
    definition: str
    latching: bool


@cache
def typestore() -> Any:
    return get_typestore(Stores.ROS1_NOETIC)


def publication(topic: str, kind: str, *, latching: bool = False) -> Publication:
    """A topic of a type that ROS 1 ships, such as `nav_msgs/Odometry`."""
    name = kind.replace("/", "/msg/")
    definition, md5sum = typestore().generate_msgdef(name, ros_version=1)
    return Publication(topic, kind, md5sum, definition, latching)


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def header(number: int, time: int, frame: str = FRAME) -> bytes:
    """std_msgs/Header: the moment's number, its time in ns, the frame."""
    return struct.pack("<III", number, *divmod(time, 1_000_000_000)) + _text(frame)


def _turned(heading: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)


def odometry(number: int, time: int, pose: Pose) -> bytes:
    """nav_msgs/Odometry: the body's middle in the map, its motion in its own frame."""
    return b"".join((
        header(number, time),
        _text(BODY_FRAME),
        struct.pack("<7d", pose.x, pose.y, 0.0, *_turned(pose.heading)),
        _NO_COVARIANCE,
        struct.pack("<6d", pose.speed, pose.lateral_speed, 0.0, 0.0, 0.0, pose.yaw_rate),
        _NO_COVARIANCE,
    ))  # fmt: skip


def poses(number: int, time: int, bodies: list[Body]) -> bytes:
    """geometry_msgs/PoseArray: the middles of bodies, each always at its own place."""
    packed = [struct.pack("<7d", body.x, body.y, 0.0, *_turned(body.heading)) for body in bodies]
    return header(number, time) + struct.pack("<I", len(bodies)) + b"".join(packed)


def flag(value: bool) -> bytes:
    """std_msgs/Bool."""
    return bytes([value])


def lights(shown: list[int]) -> bytes:
    """std_msgs/UInt8MultiArray without dimensions: one number for each light."""
    return struct.pack("<III", 0, 0, len(shown)) + bytes(shown)


def cloud(number: int, time: int, points: bytes) -> bytes:
    """sensor_msgs/PointCloud2 in the body's frame: x, y and z as float32, in one row."""
    count = len(points) // _POINT_BYTES
    fields = b"".join(
        _text(name) + struct.pack("<IBI", offset, _FLOAT32, 1)
        for name, offset in (("x", 0), ("y", 4), ("z", 8))
    )
    return b"".join((
        header(number, time, BODY_FRAME),
        struct.pack("<III", 1, count, 3),
        fields,
        struct.pack("<BIII", 0, _POINT_BYTES, len(points), len(points)),
        points,
        b"\x01",
    ))  # fmt: skip


def wish(topic: str, kind: str, data: bytes) -> Wish:
    """What a control message asks for: `linear.x` in m/s and `angular.z` in rad/s.

    Raises ControlError for another type, and for what is no number.
    """
    if kind not in CONTROLS:
        raise ControlError(
            f"the stack publishes {kind or 'an unknown type'} on {topic}, and the simulator obeys"
            f" {' or '.join(CONTROLS)}: publish one of them, or name another topic in"
            " source.simulator.topics.control"
        )
    body = data[_header_bytes(data) :] if kind == CONTROLS[1] else data
    if len(body) != struct.calcsize("<6d"):
        raise ControlError(f"a message on {topic} is no {kind}: it has {len(data)} bytes")
    numbers = struct.unpack("<6d", body)
    if not (math.isfinite(numbers[0]) and math.isfinite(numbers[5])):
        raise ControlError(
            f"a message on {topic} asks for the speed {numbers[0]} and the yaw rate {numbers[5]}:"
            " both must be numbers"
        )
    return Wish(numbers[0], numbers[5])


def _header_bytes(data: bytes) -> int:
    if len(data) < 16:
        return len(data)
    return 16 + int(struct.unpack_from("<I", data, 12)[0])
