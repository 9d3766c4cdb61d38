"""Recordings of ROS 2 by other authors' libraries: messages in CDR, written as MCAP."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

_STORE = get_typestore(Stores.ROS2_HUMBLE)
IMU = "sensor_msgs/msg/Imu"
# As rosbag2 writes it, which plays nothing with less.
QOS = """- history: keep_last
  depth: 10
  reliability: reliable
  durability: volatile
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: automatic
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""
BEGIN = 1_700_000_000_000_000_000


def imu(time: int, number: int) -> bytes:
    """A message of sensor_msgs/msg/Imu, stamped with a time in ns."""
    types = _STORE.types
    vector = types["geometry_msgs/msg/Vector3"]
    message = types[IMU](
        header=types["std_msgs/msg/Header"](
            stamp=types["builtin_interfaces/msg/Time"](sec=time // 10**9, nanosec=time % 10**9),
            frame_id="imu",
        ),
        orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=np.zeros(9),
        angular_velocity=vector(x=0.0, y=0.0, z=float(number)),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(x=float(number), y=0.0, z=9.81),
        linear_acceleration_covariance=np.zeros(9),
    )
    return bytes(_STORE.serialize_cdr(message, IMU))


def claims(folder: Path, messages: int) -> dict[str, str]:
    """Folders of claims below `folder`, with so many messages of /in as drive.mcap."""
    made = {name: folder / name for name in ("recordings", "results")}
    for path in made.values():
        path.mkdir()
    write(made["recordings"] / "drive.mcap", ["/in"], messages)
    return {name: str(path) for name, path in made.items()}


def write(path: Path, topics: list[str], messages: int, period: int = 5_000_000) -> Path:
    """Messages on each topic in turn, `period` ns after each other, from `BEGIN` on."""
    times = [(number, BEGIN + number * period) for number in range(messages)]
    made = ((topics[number % len(topics)], time, imu(time, number)) for number, time in times)
    return write_messages(path, IMU, topics, made, chunk_size=64 << 10)


def write_messages(
    path: Path,
    kind: str,
    topics: Iterable[str],
    messages: Iterable[tuple[str, int, bytes]],
    qos: str = QOS,
    **chunks: Any,
) -> Path:
    """Topic, time in ns and CDR of each message; `chunks` is how the file has them."""
    definition, _ = _STORE.generate_msgdef(kind, ros_version=2)
    with path.open("wb") as stream:
        writer = Writer(stream, **{"compression": CompressionType.LZ4} | chunks)
        writer.start(profile="ros2", library="tests")
        schema = writer.register_schema(kind, "ros2msg", definition.encode())
        metadata = {"offered_qos_profiles": qos}
        channels = {
            topic: writer.register_channel(topic, "cdr", schema, metadata=metadata)
            for topic in topics
        }
        for number, (topic, time, data) in enumerate(messages):
            writer.add_message(channels[topic], time, data, time, number)
        writer.finish()
    return path
