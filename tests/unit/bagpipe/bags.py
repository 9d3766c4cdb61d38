"""Bags for tests, written by the rosbags library, so that our reader meets another's writer."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

_STORE = get_typestore(Stores.ROS1_NOETIC)


@dataclass(frozen=True)
class Recorded:
    """One message: time in ns."""

    topic: str
    time: int
    text: str
    latching: bool = False


def write_bag(path: Path, messages: Iterable[Recorded], chunk_bytes: int = 1 << 20) -> Path:
    """A bag of std_msgs/String messages in the order given."""
    kind = "std_msgs/msg/String"
    with Writer(path) as writer:
        writer.chunk_threshold = chunk_bytes
        connections: dict[tuple[str, bool], Connection] = {}
        for message in messages:
            key = (message.topic, message.latching)
            if key not in connections:
                connections[key] = writer.add_connection(
                    message.topic,
                    kind,
                    typestore=_STORE,
                    callerid=f"/recorded{len(connections)}",
                    latching=int(message.latching),
                )
            text = _STORE.types[kind](message.text)
            writer.write(connections[key], message.time, _STORE.serialize_ros1(text, kind))
    return path


def steady(topic: str, count: int, step_ns: int, begin_ns: int = 1_000_000_000) -> list[Recorded]:
    """`count` messages on a topic, `step_ns` apart."""
    return [Recorded(topic, begin_ns + i * step_ns, f"{i:08d}") for i in range(count)]
