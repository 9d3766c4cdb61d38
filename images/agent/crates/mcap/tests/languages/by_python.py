"""Writes and reads MCAP with PyPI's library, as tests/languages.rs asks.

python by_python.py write PLAN FOLDER: each form of the plan as FOLDER/python-NUMBER.mcap
python by_python.py read FOLDER OUT: what every file of the folder holds, as JSON, by its name
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer

COMPRESSIONS = {
    "none": CompressionType.NONE,
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
}


def write(path: Path, form: dict[str, Any], content: dict[str, Any]) -> None:
    indexes = IndexType.NONE
    if form["summary"]:
        indexes = IndexType.CHUNK | IndexType.ATTACHMENT | IndexType.METADATA
    if form["index"]:
        indexes |= IndexType.MESSAGE
    with path.open("wb") as stream:
        writer = Writer(
            stream,
            chunk_size=form["chunk_size"],
            compression=COMPRESSIONS[form["compression"]],
            index_types=indexes,
            repeat_channels=form["repeat_channels"],
            repeat_schemas=form["repeat_schemas"],
            use_chunking=form["chunked"],
            use_statistics=form["statistics"],
            use_summary_offsets=form["summary"],
            enable_crcs=form["crc"],
            enable_data_crcs=form["crc"],
        )
        writer.start(profile=content["profile"])
        schemas = [
            writer.register_schema(name, encoding, bytes.fromhex(data))
            for name, encoding, data in content["schemas"]
        ]
        channels = [
            writer.register_channel(
                topic, encoding, 0 if schema is None else schemas[schema], metadata
            )
            for topic, encoding, schema, metadata in content["channels"]
        ]
        for number, (channel, log, publish, sequence, data) in enumerate(content["messages"]):
            if number == content["before_message"]:
                surround(writer, form, content)
            writer.add_message(
                channels[channel], int(log), bytes.fromhex(data), int(publish), sequence
            )
        writer.finish()


def surround(writer: Writer, form: dict[str, Any], content: dict[str, Any]) -> None:
    if form["attachments"]:
        for log, create, name, media_type, data in content["attachments"]:
            writer.add_attachment(int(create), int(log), name, media_type, bytes.fromhex(data))
    if form["metadata"]:
        for name, entries in content["metadata"]:
            writer.add_metadata(name, entries)


def message(schema: Schema | None, channel: Channel, each: Message) -> list[Any]:
    kind = None if schema is None else [schema.name, schema.encoding, schema.data.hex()]
    about = [channel.topic, channel.message_encoding, kind, channel.metadata]
    return [*about, str(each.log_time), str(each.publish_time), each.sequence, each.data.hex()]


def held(records: Iterator[McapRecord]) -> dict[str, Any]:
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    found: dict[str, Any] = {"messages": [], "attachments": [], "metadata": [], "by_index": None}
    for each in records:
        match each:
            case Schema():
                schemas[each.id] = each
            case Channel():
                channels[each.id] = each
            case Message():
                channel = channels[each.channel_id]
                found["messages"].append(message(schemas.get(channel.schema_id), channel, each))
            case Attachment():
                times = [str(each.log_time), str(each.create_time)]
                about = [each.name, each.media_type, each.data.hex()]
                found["attachments"].append([*times, *about])
            case Metadata():
                found["metadata"].append([each.name, each.metadata])
    return found


def read(path: Path) -> dict[str, Any]:
    with path.open("rb") as stream:
        found = held(StreamReader(stream, validate_crcs=True).records)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        # With chunks' indexes it looks for channels and schemas in the summary alone.
        indexed = summary is None or not summary.chunk_indexes
        if indexed or (summary.channels and summary.schemas):
            found["by_index"] = [message(*each) for each in reader.iter_messages()]
    return found


def main(verb: str, first: Path, second: Path) -> None:
    if verb == "write":
        plan = json.loads(first.read_text())
        for number, form in enumerate(plan["forms"]):
            write(second / f"python-{number}.mcap", form, plan["content"])
    else:
        everything = {path.stem: read(path) for path in first.glob("*.mcap")}
        second.write_text(json.dumps(everything))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
