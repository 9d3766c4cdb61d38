"""MCAP made of bags by MCAP's own library for Python, as its converter makes it."""

from pathlib import Path

from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Reader

COMPRESSIONS = {
    "none": CompressionType.NONE,
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
}


def mcap_of(bag: Path, target: Path, compression: str, chunk_bytes: int = 64 << 10) -> Path:
    """Writes the bag's connections and messages to `target`, with a summary and all indexes."""
    with Reader(bag) as recording, target.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_bytes, compression=COMPRESSIONS[compression])
        writer.start(profile="ros1", library="tests")
        channels = {}
        for each in recording.connections:
            text = each.msgdef.data.encode()
            name = each.msgtype.replace("/msg/", "/")
            channels[each.id] = writer.register_channel(
                schema_id=writer.register_schema(name=name, encoding="ros1msg", data=text),
                topic=each.topic,
                message_encoding="ros1",
                metadata={
                    "callerid": getattr(each.ext, "callerid", "") or "",
                    "latching": "1" if getattr(each.ext, "latching", 0) else "0",
                    "md5sum": each.digest,
                },
            )
        for connection, time, raw in recording.messages():
            writer.add_message(channels[connection.id], time, bytes(raw), time)
        writer.finish()
    return target
