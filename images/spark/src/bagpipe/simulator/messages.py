"""The simulator's messages, written straight into bytes, as ROS 1 or ROS 2 serialises them.

Which type, md5 sum and definition a topic has comes from rosbags; the tests compare every layout
here with that library's own serialisation.
"""

import math
import struct
from dataclasses import dataclass

from bagpipe.simulator.actors import Body
from bagpipe.simulator.serialisation import MessageWriter, Serialisation
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


def publication(
    own: Serialisation, topic: str, kind: str, *, latching: bool = False
) -> Publication:
    """A topic of a type that ROS ships, such as `nav_msgs/Odometry`."""
    name = kind.replace("/", "/msg/")
    definition, md5sum = own.types.generate_msgdef(name, ros_version=own.ros_version)
    return Publication(topic, own.type_name(kind), md5sum, definition, latching)


def _turned(heading: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)


def odometry(own: Serialisation, number: int, time: int, pose: Pose) -> bytes:
    """nav_msgs/Odometry: the body's middle in the map, its motion in its own frame."""
    message = own.writer()
    message.header(number, time, FRAME)
    message.text(BODY_FRAME)
    message.add(8, struct.pack("<7d", pose.x, pose.y, 0.0, *_turned(pose.heading)))
    message.add(8, _NO_COVARIANCE)
    motion = (pose.speed, pose.lateral_speed, 0.0, 0.0, 0.0, pose.yaw_rate)
    message.add(8, struct.pack("<6d", *motion) + _NO_COVARIANCE)
    return message.finish()


def poses(own: Serialisation, number: int, time: int, bodies: list[Body]) -> bytes:
    """geometry_msgs/PoseArray: the middles of bodies, each always at its own place."""
    message = own.writer()
    message.header(number, time, FRAME)
    message.add(4, struct.pack("<I", len(bodies)))
    packed = [struct.pack("<7d", body.x, body.y, 0.0, *_turned(body.heading)) for body in bodies]
    message.add(8, b"".join(packed))
    return message.finish()


def flag(own: Serialisation, value: bool) -> bytes:
    """std_msgs/Bool."""
    message = own.writer()
    message.add(1, bytes([value]))
    return message.finish()


def lights(own: Serialisation, shown: list[int]) -> bytes:
    """std_msgs/UInt8MultiArray without dimensions: one number for each light."""
    message = own.writer()
    message.add(4, struct.pack("<III", 0, 0, len(shown)))
    message.add(1, bytes(shown))
    return message.finish()


def cloud(own: Serialisation, number: int, time: int, points: bytes) -> bytes:
    """sensor_msgs/PointCloud2 in the body's frame: x, y and z as float32, in one row."""
    message = own.writer()
    message.header(number, time, BODY_FRAME)
    message.add(4, struct.pack("<III", 1, len(points) // _POINT_BYTES, 3))
    for name, offset in (("x", 0), ("y", 4), ("z", 8)):
        _point_field(message, name, offset)
    message.add(1, b"\x00")
    message.add(4, struct.pack("<III", _POINT_BYTES, len(points), len(points)))
    message.add(1, points)
    message.add(1, b"\x01")
    return message.finish()


def _point_field(message: MessageWriter, name: str, offset: int) -> None:
    message.text(name)
    message.add(4, struct.pack("<I", offset))
    message.add(1, bytes([_FLOAT32]))
    message.add(4, struct.pack("<I", 1))


def wish(own: Serialisation, topic: str, kind: str, data: bytes) -> Wish:
    """What a control message asks for: `linear.x` in m/s and `angular.z` in rad/s.

    Raises ControlError for another type, and for what is no number.
    """
    controls = [own.type_name(each) for each in CONTROLS]
    if kind not in controls:
        raise ControlError(
            f"the stack publishes {kind or 'an unknown type'} on {topic}, and the simulator obeys"
            f" {' or '.join(controls)}: publish one of them, or name another topic in"
            " source.simulator.topics.control"
        )
    try:
        message = own.reader(data)
        if kind == controls[1]:
            message.skip_header()
        numbers = message.doubles(6)
    except ValueError as error:
        raise ControlError(
            f"a message on {topic} is no {kind}: it has {len(data)} bytes, and {error}"
        ) from error
    if not (math.isfinite(numbers[0]) and math.isfinite(numbers[5])):
        raise ControlError(
            f"a message on {topic} asks for the speed {numbers[0]} and the yaw rate {numbers[5]}:"
            " both must be numbers"
        )
    return Wish(numbers[0], numbers[5])
