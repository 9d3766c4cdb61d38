"""`bagpipe bag convert --messages ros2`: MCAP with the messages of ROS 1 as ROS 2 has them."""

import io
from collections.abc import Iterator
from typing import Any

from mcap.writer import CompressionType, Writer

from bagpipe.cli.bag_here import Elsewhere, Written
from bagpipe.cli.bag_messages import Conversions, rewritten
from bagpipe.cli.bag_reading import BagRefusedError
from bagpipe.conversion import Conversion, ConversionError, to_ros2
from bagpipe.encodings import CDR, ROS1
from bagpipe.topic_names import resolve

_COMPRESSIONS = {
    "none": CompressionType.NONE,
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
}
# As rosbag2 writes it down. Who latched in ROS 1 kept one message for who came late.
_QOS = """- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: automatic
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""
_LATCHED = _QOS.format(depth=1, durability="transient_local")
_OTHERS = _QOS.format(depth=10, durability="volatile")


def for_ros2(file: Elsewhere, target: str, packing: str) -> Written:
    """All messages of a recording, those of ROS 1 in CDR; a channel for each of its connections.

    Raises StorageError, and BagRefusedError where a type or a message can't be one of ROS 2.
    """
    if not target.endswith(".mcap"):
        raise BagRefusedError("--messages ros2 writes MCAP: let --to end in .mcap")
    if packing not in _COMPRESSIONS:
        raise BagRefusedError(f"MCAP has no {packing}: --compression can be none, lz4 or zstd")

    def write(
        connections: list[Any],
        conversions: Conversions,
        messages: Iterator[tuple[Any, int, bytes]],
    ) -> tuple[bytes, int]:
        out = io.BytesIO()
        writer = Writer(out, compression=_COMPRESSIONS[packing])
        writer.start(profile="ros2", library="bagpipe")
        channels = {one.id: _channel(writer, one, conversions[one.id]) for one in connections}
        count = 0
        for connection, time, data in messages:
            writer.add_message(channels[connection.id], time, data, time)
            count += 1
        writer.finish()
        return out.getvalue(), count

    return rewritten(file, "ROS 2", _conversion, write)


def _conversion(connection: Any) -> Conversion | None:
    if connection.encoding == CDR:
        return None
    if connection.encoding != ROS1:
        raise ConversionError(f"its messages are in {connection.encoding}")
    return to_ros2(connection.type, connection.definition)


def _channel(writer: Writer, connection: Any, conversion: Conversion | None) -> int:
    kind, text, encoding = connection.type, connection.definition, connection.schema_encoding
    qos = connection.offered_qos or (_LATCHED if connection.latching else _OTHERS)
    if conversion is not None:
        kind, text, encoding = conversion.kind, conversion.definition, "ros2msg"
    metadata = {"offered_qos_profiles": qos}
    if connection.callerid:
        metadata["callerid"] = connection.callerid
    schema = writer.register_schema(kind, encoding, text.encode())
    return int(writer.register_channel(resolve(connection.topic), CDR, schema, metadata=metadata))
