"""One MCAP file of what a case was given, what its stack published, and what was found in it."""

import heapq
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from mcap.writer import CompressionType, Writer

from bagpipe.recording_format import in_memory
from bagpipe.topic_names import resolve
from bagpipe.view.course import Note

# Of a recording's uncompressed chunks: a small file may have any number of bytes in them.
_MOST_BYTES = 4 << 30
# Where a topic is that was recorded, and that the stack published as well.
RECORDED = "/recorded"


@dataclass(frozen=True)
class Topic:
    """A topic of the file: its name, type and encoding, and how many messages it has."""

    name: str
    type: str
    encoding: str
    messages: int


class _Channel(NamedTuple):
    topic: str
    type: str
    encoding: str
    schema_encoding: str
    definition: bytes
    publisher: str


class _Message(NamedTuple):
    time: int
    channel: _Channel
    data: bytes


class Recording:
    """A bag or MCAP in memory, or the `only` topics of it. Raises bagpipe.BagError where it is
    neither.
    """

    def __init__(self, data: bytes, only: Collection[str] = ()) -> None:
        self._opened = in_memory(data, _MOST_BYTES)
        self._only = {resolve(topic) for topic in only}

    @property
    def topics(self) -> set[str]:
        """The names of its topics, whether chosen or not."""
        return {resolve(topic) for topic in self._opened.topics}

    @property
    def damage(self) -> str:
        """What was expected where something is lost; nothing where it is whole."""
        lost = self._opened.damage
        return "" if lost is None else str(lost.description)

    def messages(self, span: tuple[int, int], moved: set[str]) -> Iterator[_Message]:
        """Those of `span` by time; the topics of `moved` are below RECORDED."""
        channels: dict[int, _Channel] = {}
        chosen = [
            topic for topic in self._opened.topics if not self._only or resolve(topic) in self._only
        ]
        for connection, time, raw in self._opened.messages(chosen, *span):
            channel = channels.get(connection.id)
            if channel is None:
                channel = channels[connection.id] = _channel(connection, moved)
            yield _Message(time, channel, bytes(raw))


def write_view(
    target: Path,
    given: Recording | None,
    published: Iterable[Recording],
    notes: Iterable[Note],
    span: tuple[int, int],
    about: dict[str, str],
) -> list[Topic]:
    """Writes the messages of `span` (ns, without its end) by time; the file's topics.

    A topic of the given recording that the stack published as well is below /recorded: what was
    recorded then and what is published now are seen side by side. Raises bagpipe.BagError for
    damaged chunks, and OSError.
    """
    outputs = list(published)
    own: set[str] = set().union(*(each.topics for each in outputs))
    sources = [each.messages(span, set()) for each in outputs]
    if given is not None:
        sources.insert(0, given.messages(span, own))
    sources.append(_of_notes(notes, span))
    # Who looks at the file of before keeps it until there is another.
    part = target.with_name(f".{target.name}.part")
    try:
        with part.open("wb") as file:
            topics = _write(file, heapq.merge(*sources, key=lambda each: each.time), about)
        part.replace(target)
    finally:
        part.unlink(missing_ok=True)
    return topics


def _write(file: BinaryIO, messages: Iterable[_Message], about: dict[str, str]) -> list[Topic]:
    writer = Writer(file, compression=CompressionType.LZ4)
    writer.start(profile="", library="bagpipe")
    schemas: dict[tuple[str, str, bytes], int] = {}
    channels: dict[_Channel, int] = {}
    counts: dict[tuple[str, str, str], int] = {}
    for time, channel, data in messages:
        if channel not in channels:
            schema = (channel.type, channel.schema_encoding, channel.definition)
            if schema not in schemas:
                schemas[schema] = writer.register_schema(*schema)
            publisher = {"callerid": channel.publisher} if channel.publisher else {}
            channels[channel] = writer.register_channel(
                channel.topic, channel.encoding, schemas[schema], publisher
            )
        writer.add_message(channels[channel], time, data, time)
        topic = (channel.topic, channel.type, channel.encoding)
        counts[topic] = counts.get(topic, 0) + 1
    writer.add_metadata("bagpipe", about)
    writer.finish()
    return [Topic(*topic, messages=many) for topic, many in sorted(counts.items())]


def _channel(connection: Any, moved: set[str]) -> _Channel:
    topic = resolve(connection.topic)
    return _Channel(
        RECORDED + topic if topic in moved else topic,
        connection.type,
        connection.encoding,
        connection.schema_encoding,
        connection.definition.encode(),
        connection.callerid or "",
    )


def _of_notes(notes: Iterable[Note], span: tuple[int, int]) -> Iterator[_Message]:
    for note in sorted(notes, key=lambda each: each.time):
        if span[0] <= note.time < span[1]:
            schema = note.schema
            channel = _Channel(
                note.topic, schema.name, "json", "jsonschema", schema.text.encode(), ""
            )
            yield _Message(note.time, channel, note.data)
