"""Recordings for tests of criteria, with ROS's own message types: bags, or MCAP of ROS 2."""

import math
from collections.abc import Container, Iterable
from functools import cache
from typing import Any

from rosbags.typesys import Stores, get_typestore

from bagpipe import MemoryBag
from bagpipe.evaluate.evidence import Evidence, Recording
from tests.unit.evaluate.ros2_recordings import mcap

STORE = get_typestore(Stores.ROS1_NOETIC)
SECOND = 1_000_000_000

Entry = tuple[str, float, Any]

# What `evidence` is made of: `ros1` for bags, else the language of definitions of ROS 2.
FORMS = ("ros1", "ros2msg", "ros2idl")
form = "ros1"


def time(seconds: float) -> Any:
    whole = round(seconds * SECOND)
    # rosbags writes the seconds with a sign; on the wire they have none.
    signed = (whole // SECOND + 2**31) % 2**32 - 2**31
    return STORE.types["builtin_interfaces/msg/Time"](signed, whole % SECOND)


def header(stamp: float) -> Any:
    return STORE.types["std_msgs/msg/Header"](seq=0, stamp=time(stamp), frame_id="map")


def pose(x: float, y: float, yaw: float = 0.0) -> Any:
    point = STORE.types["geometry_msgs/msg/Point"](x, y, 0.0)
    turn = STORE.types["geometry_msgs/msg/Quaternion"](
        0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)
    )
    return STORE.types["geometry_msgs/msg/Pose"](point, turn)


def stamped(stamp: float, x: float, y: float, yaw: float = 0.0) -> Any:
    return STORE.types["geometry_msgs/msg/PoseStamped"](header(stamp), pose(x, y, yaw))


def poses(stamp: float, *points: tuple[float, float]) -> Any:
    array = [pose(x, y) for x, y in points]
    return STORE.types["geometry_msgs/msg/PoseArray"](header(stamp), array)


def text(data: str) -> Any:
    return STORE.types["std_msgs/msg/String"](data)


def number(data: float) -> Any:
    return STORE.types["std_msgs/msg/Float64"](data)


def bag(entries: Iterable[Entry], latching: Container[str] = ()) -> bytes:
    """(topic, receipt in seconds, message) as a bag; `latching` topics are latched."""
    writer = MemoryBag.writer()
    for topic, seconds, message in sorted(entries, key=lambda e: e[1]):
        name = message.__msgtype__
        definition, md5 = _definition(name)
        writer.write(
            topic,
            round(seconds * SECOND),
            bytes(STORE.serialize_ros1(message, name)),
            type=name.replace("/msg/", "/"),
            md5sum=md5,
            definition=definition,
            latching=topic in latching,
        )
    return writer.finish().to_bytes()


@cache
def _definition(name: str) -> tuple[str, str]:
    """Made once for each type: it takes longer than to write a message."""
    made: tuple[str, str] = STORE.generate_msgdef(name)
    return made


def recording(entries: Iterable[Entry], latching: Container[str], made_of: str) -> bytes:
    """A bag, or MCAP of ROS 2."""
    return bag(entries, latching) if made_of == "ros1" else mcap(entries, latching, made_of)


def evidence(
    recorded: Iterable[Entry],
    source: Iterable[Entry] = (),
    start: float = 10.0,
    end: float = 20.0,
    latching: Container[str] = (),
    **more: Any,
) -> Evidence:
    """Evidence of a window, by default from 10 to 20 s."""
    recorded, source, made_of = list(recorded), list(source), form
    first, last = round(start * SECOND), round(end * SECOND)
    return Evidence(
        recorded=Recording(lambda: recording(recorded, latching, made_of), first, None),
        source=Recording(lambda: recording(source, (), made_of), first, last),
        start=first,
        end=last,
        **more,
    )
