"""`bagpipe bag convert --messages ros2`: MCAP with the messages of ROS 1 as ROS 2 has them."""

import io
from typing import Any

from mcap.writer import CompressionType, Writer

from bagpipe.cli.bag_here import Elsewhere, Written
from bagpipe.cli.bag_reading import BagRefusedError
from bagpipe.conversion import Conversion, ConversionError, to_ros2
from bagpipe.encodings import CDR, ROS1
from bagpipe.recording_format import in_memory
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
    as_mcap = file.converted("all.mcap", "none")
    try:
        recording = in_memory(as_mcap.data, decompressed_bytes=2 * file.budget)
        conversions = _conversions(file.uri, recording.connections)
        data, count = _write(file.uri, recording, conversions, packing)
    except ValueError as error:
        raise BagRefusedError(f"{file.uri}: {error}") from error
    added = sorted({name for each in conversions.values() if each for name in each.added})
    return Written(data, count, as_mcap.damage, tuple(added))


def _conversions(uri: str, connections: list[Any]) -> dict[int, Conversion | None]:
    """By the connection's number; of one in CDR none. What can't be converted is named at once."""
    found: dict[int, Conversion | None] = {}
    refused: dict[str, str] = {}
    for one in connections:
        try:
            found[one.id] = _conversion(one)
        except ConversionError as error:
            refused[resolve(one.topic)] = str(error)
    if refused:
        why = "; ".join(f"{topic}: {text}" for topic, text in sorted(refused.items()))
        raise BagRefusedError(
            f"{uri} has topics that ROS 2 can't have: {why}. `bagpipe bag slice --topic` writes a"
            " recording of the others"
        )
    return found


def _conversion(connection: Any) -> Conversion | None:
    if connection.encoding == CDR:
        return None
    if connection.encoding != ROS1:
        raise ConversionError(f"its messages are in {connection.encoding}")
    return to_ros2(connection.type, connection.definition)


def _write(
    uri: str, recording: Any, conversions: dict[int, Conversion | None], packing: str
) -> tuple[bytes, int]:
    out = io.BytesIO()
    writer = Writer(out, compression=_COMPRESSIONS[packing])
    writer.start(profile="ros2", library="bagpipe")
    channels = {one.id: _channel(writer, one, conversions[one.id]) for one in recording.connections}
    count = 0
    for connection, time, raw in recording.messages():
        conversion = conversions[connection.id]
        try:
            data = bytes(raw) if conversion is None else conversion.convert(raw)
        except ConversionError as error:
            raise BagRefusedError(
                f"{uri}: the message of {resolve(connection.topic)} at {time} ns: {error}"
            ) from error
        writer.add_message(channels[connection.id], time, data, time)
        count += 1
    writer.finish()
    return out.getvalue(), count


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
