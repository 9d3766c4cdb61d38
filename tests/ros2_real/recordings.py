"""Recordings that nodes of a real ROS 2 are played."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from rosbags.typesys import Stores, get_typestore

from tests.ros2_recording import BEGIN, QOS, write_messages

_STORE = get_typestore(Stores.ROS2_HUMBLE)
TEXT, SCAN = "std_msgs/msg/String", "sensor_msgs/msg/LaserScan"
TWIST = "geometry_msgs/msg/Twist"


def text(data: str) -> bytes:
    """A message of std_msgs/msg/String."""
    return bytes(_STORE.serialize_cdr(_STORE.types[TEXT](data=data), TEXT))


def scan(time: int, metres: float) -> bytes:
    """A sensor_msgs/msg/LaserScan of a wall all around, stamped with a time in ns."""
    types = _STORE.types
    stamp = types["builtin_interfaces/msg/Time"](*divmod(time, 10**9))
    message = types[SCAN](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="base_scan"),
        angle_min=0.0,
        angle_max=6.28,
        angle_increment=0.0174,
        time_increment=0.0,
        scan_time=0.2,
        range_min=0.12,
        range_max=3.5,
        ranges=np.full(360, metres, np.float32),
        intensities=np.zeros(0, np.float32),
    )
    return bytes(_STORE.serialize_cdr(message, SCAN))


def write_scans(path: Path, metres: Iterable[float], period: int = 200_000_000) -> Path:
    """Scans on /scan, `period` ns after each other, each of a wall so many metres away."""
    walls = ((BEGIN + number * period, distance) for number, distance in enumerate(metres))
    scans = (("/scan", time, scan(time, distance)) for time, distance in walls)
    # As a laser's driver offers them.
    offered = QOS.replace("reliability: reliable", "reliability: best_effort")
    return write_messages(path, SCAN, ["/scan"], scans, offered)


def twist(forwards: float, turning: float) -> bytes:
    """A geometry_msgs/msg/Twist in m/s along x and rad/s about z."""
    vector = _STORE.types["geometry_msgs/msg/Vector3"]
    linear, angular = vector(x=forwards, y=0.0, z=0.0), vector(x=0.0, y=0.0, z=turning)
    return bytes(_STORE.serialize_cdr(_STORE.types[TWIST](linear, angular), TWIST))


def write_twists(
    path: Path, commands: Iterable[tuple[float, float]], period: int = 50_000_000
) -> Path:
    """Commands on /cmd_vel, `period` ns after each other, each in m/s and rad/s."""
    twists = (
        ("/cmd_vel", BEGIN + number * period, twist(*command))
        for number, command in enumerate(commands)
    )
    return write_messages(path, TWIST, ["/cmd_vel"], twists)


def write_texts(
    path: Path, topics: dict[str, Iterable[str]], qos: str = QOS, period: int = 5_000_000
) -> Path:
    """Texts of each topic, `period` ns after each other; those of the first topic come first."""
    texts = ((topic, text(data)) for topic, all_of_it in topics.items() for data in all_of_it)
    messages = (
        (topic, BEGIN + number * period, data) for number, (topic, data) in enumerate(texts)
    )
    return write_messages(path, TEXT, topics, messages, qos, chunk_size=4 << 20)
