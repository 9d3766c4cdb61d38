"""Recordings that nodes of a real ROS 2 are played."""

from collections.abc import Iterable
from pathlib import Path

from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from tests.ros2_recording import BEGIN, QOS

_STORE = get_typestore(Stores.ROS2_HUMBLE)
TEXT = "std_msgs/msg/String"


def text(data: str) -> bytes:
    """A message of std_msgs/msg/String."""
    return bytes(_STORE.serialize_cdr(_STORE.types[TEXT](data=data), TEXT))


def write_texts(
    path: Path, topics: dict[str, Iterable[str]], qos: str = QOS, period: int = 5_000_000
) -> Path:
    """Texts of each topic, `period` ns after each other; those of the first topic come first."""
    definition, _ = _STORE.generate_msgdef(TEXT, ros_version=2)
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=4 << 20, compression=CompressionType.LZ4)
        writer.start(profile="ros2", library="tests")
        schema = writer.register_schema(TEXT, "ros2msg", definition.encode())
        time = BEGIN
        for topic, texts in topics.items():
            metadata = {"offered_qos_profiles": qos}
            channel = writer.register_channel(topic, "cdr", schema, metadata=metadata)
            for number, data in enumerate(texts):
                writer.add_message(channel, time, text(data), time, number)
                time += period
        writer.finish()
    return path
