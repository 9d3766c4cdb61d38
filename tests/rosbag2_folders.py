"""Folders of rosbag2 as its recorder leaves them: SQLite by hand, MCAP by MCAP's own library."""

import sqlite3
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import yaml
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

VOLATILE = "- history: 3\n  depth: 0\n  reliability: 1\n  durability: 2"
TRANSIENT_LOCAL = "- history: 3\n  depth: 0\n  reliability: 1\n  durability: 1"
MS = 1_000_000
START = 1_700_000_000_000 * MS
_TYPE = "std_msgs/msg/String"
# As Jazzy makes them.
_TABLES = """
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
  serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
  type_description_hash TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
  timestamp INTEGER NOT NULL, data BLOB NOT NULL);
CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL,
  encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL,
  type_description_hash TEXT NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
INSERT INTO schema VALUES (4, 'jazzy');
INSERT INTO message_definitions VALUES (1, 'std_msgs/msg/String', 'ros2msg', 'string data', '');
"""


class Message(NamedTuple):
    """One message, as every format has it."""

    topic: str
    time: int
    data: bytes
    qos: str = VOLATILE
    type: str = _TYPE
    encoding: str = "cdr"


@dataclass(frozen=True)
class Form:
    """How a folder is stored: `mode` is empty, FILE or MESSAGE."""

    storage: str
    mode: str = ""
    version: int = 6

    def __str__(self) -> str:
        return f"{self.storage}-{self.mode or 'plain'}-{self.version}"


FORMS = [
    Form("mcap"),
    Form("mcap", "FILE", 5),
    Form("mcap", "MESSAGE", 8),
    Form("sqlite3", "", 4),
    Form("sqlite3", "FILE", 7),
    Form("sqlite3", "MESSAGE", 9),
]


def text(word: str) -> bytes:
    """A std_msgs/String as ROS 2 has it in DDS: little-endian."""
    data = word.encode() + b"\0"
    return b"\0\1\0\0" + len(data).to_bytes(4, "little") + data


def drive(count: int = 60, step: int = 100 * MS) -> list[Message]:
    """A latched map first, then messages on /a and /b in turn."""
    messages = [Message("/map", START, text("the map"), TRANSIENT_LOCAL)]
    for number in range(count):
        topic = ("/a", "/b")[number % 2]
        messages.append(Message(topic, START + number * step + MS, text(f"message {number}")))
    return messages


def folder(at: Path, form: Form, files: Iterable[list[Message]], *, chunk_bytes: int = 500) -> Path:
    """Writes the folder; each list of messages is one of its files. Returns its metadata.yaml."""
    at.mkdir(parents=True)
    parts = list(files)
    names = []
    packed: Callable[[bytes], bytes] = bytes
    if form.mode == "MESSAGE":
        packed = zstandard.ZstdCompressor().compress
    for number, messages in enumerate(parts):
        path = at / f"{at.name}_{number}.{'mcap' if form.storage == 'mcap' else 'db3'}"
        stored = [each._replace(data=packed(each.data)) for each in messages]
        if form.storage == "mcap":
            _mcap(path, stored, chunk_bytes)
        else:
            _sqlite(path, stored)
        if form.mode == "FILE":
            whole = path.with_name(f"{path.name}.zstd")
            whole.write_bytes(zstandard.ZstdCompressor().compress(path.read_bytes()))
            path.unlink()
            path = whole
        names.append(path.name)
    metadata = at / "metadata.yaml"
    everything = [each for messages in parts for each in messages]
    metadata.write_text(yaml.safe_dump(_metadata(form, names, everything), sort_keys=False))
    return metadata


def _topics(messages: list[Message]) -> list[Message]:
    return list({each.topic: each for each in messages}.values())


def _metadata(form: Form, names: list[str], messages: list[Message]) -> object:
    times = [each.time for each in messages] or [0]

    def topic(each: Message) -> object:
        qos = yaml.safe_load(each.qos) if form.version > 8 else each.qos
        counts = sum(other.topic == each.topic for other in messages)
        described = {
            "name": each.topic,
            "type": each.type,
            "serialization_format": each.encoding,
            "offered_qos_profiles": qos,
        }
        return {"topic_metadata": described, "message_count": counts}

    return {
        "rosbag2_bagfile_information": {
            "version": form.version,
            "storage_identifier": form.storage,
            "duration": {"nanoseconds": max(times) - min(times)},
            "starting_time": {"nanoseconds_since_epoch": min(times)},
            "message_count": len(messages),
            "topics_with_message_count": [topic(each) for each in _topics(messages)],
            "compression_format": "zstd" if form.mode else "",
            "compression_mode": form.mode,
            "relative_file_paths": names,
        }
    }


def _mcap(path: Path, messages: list[Message], chunk_bytes: int) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_bytes, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="tests")
        channels = {}
        for each in _topics(messages):
            schema = writer.register_schema(each.type, "ros2msg", b"string data")
            metadata = {"offered_qos_profiles": each.qos}
            channels[each.topic] = writer.register_channel(
                each.topic, each.encoding, schema, metadata
            )
        for each in messages:
            writer.add_message(channels[each.topic], each.time, each.data, each.time)
        writer.finish()


def _sqlite(path: Path, messages: list[Message]) -> None:
    file = sqlite3.connect(path)
    file.executescript(_TABLES)
    ids = {each.topic: number for number, each in enumerate(_topics(messages), 5)}
    for each in _topics(messages):
        row = (ids[each.topic], each.topic, each.type, each.encoding, each.qos)
        file.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?, '')", row)
    for each in messages:
        message = (ids[each.topic], each.time, each.data)
        file.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", message)
    file.commit()
    file.close()


def read_mcap(path: Path) -> list[Message]:
    """All messages by MCAP's own library, in order of time."""
    with path.open("rb") as stream:
        found = [
            Message(
                channel.topic,
                message.log_time,
                message.data,
                channel.metadata.get("offered_qos_profiles", ""),
                schema.name if schema else "",
                channel.message_encoding,
            )
            for schema, channel, message in make_reader(stream).iter_messages()
        ]
    return sorted(found, key=lambda each: each.time)
