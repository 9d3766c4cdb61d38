"""Partitions of `spark.read.format("rosbag")`, from the bags' heads and tails alone."""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from bagpipe.plan.bag_tail import BagError, BagTail, Connection, connection_fields
from bagpipe.plan.by_time import ChunksByTime
from bagpipe.plan.fragments import FragmentPlan, Window, cut, cut_one
from bagpipe.plan.left_out import check_left_out
from bagpipe.plan.part import Part
from bagpipe.plan.rosbag2 import Rosbag2, in_folders, without_members
from bagpipe.rosbag_source.parts import opened, wanted
from bagpipe.rosbag_source.recordings import Bag, McapFile, recording
from bagpipe.storage import OpenFile, Storage, StorageError
from bagpipe.storage.reading import REQUEST_BYTES
from bagpipe.topic_names import resolve as resolved

DEFAULT_FRAGMENT_SECONDS = 60.0
_NANOSECONDS = 1_000_000_000


class OptionError(ValueError):
    """An option that can't be used; the sentence says what to write."""


@dataclass(frozen=True)
class Options:
    """The options of a read, as docs/reference/binpipe-api.md names them; times in ns."""

    path: str
    topics: tuple[str, ...]
    fragment: int
    decode: bool
    start: int | None
    end: int | None
    volumes: tuple[tuple[str, str], ...]

    @property
    def storage(self) -> Storage:
        """Where the bags are read from."""
        return Storage(dict(self.volumes))


def parse_options(given: Mapping[str, str]) -> Options:
    """Options as Spark hands them over, all strings. Raises OptionError."""
    path = given.get("path")
    if not path:
        raise OptionError("rosbag needs a path: spark.read.format('rosbag').load('s3://a/*.bag')")
    try:
        topics = tuple(resolved(t.strip()) for t in given.get("topics", "").split(",") if t.strip())
        seconds = float(given.get("fragment", DEFAULT_FRAGMENT_SECONDS))
        length = round(seconds * _NANOSECONDS)
        times = [int(given[key]) if key in given else None for key in ("start", "end")]
        volumes = tuple(sorted(json.loads(given.get("volumes", "{}")).items()))
    except (ValueError, OverflowError, AttributeError) as error:
        raise OptionError(
            "rosbag: fragment is seconds, start and end are integers of ns, volumes is a JSON map"
            f" of claims to paths: {error}"
        ) from error
    if length < 1:
        raise OptionError(f"rosbag: fragment is {seconds} s, expected more than 0")
    decode = given.get("decode", "false").lower() == "true"
    if decode and len(topics) != 1:
        raise OptionError("rosbag: decode=true needs exactly one topic, whose type the columns are")
    return Options(path, topics, length, decode, times[0], times[1], volumes)


@dataclass(frozen=True)
class TopicType:
    """What the messages of one connection are; `definition` is the bag's own text."""

    topic: str
    type: str
    # Empty in ROS 2, which has none.
    md5sum: str
    definition: str
    # What the messages' bytes are, and what the definition is written in.
    encoding: str
    schema_encoding: str


@dataclass(frozen=True)
class Fragment:
    """One task: the messages with start <= time < end in the (offset, end) chunks of a bag.

    Of MCAP and of a folder of rosbag2 they are in `parts` of its files, which say the types.
    """

    uri: str
    window: Window
    chunks: tuple[tuple[int, int], ...]
    types: dict[int, TopicType]
    # The bag's mark when it was planned: another bag's bytes are none of its messages.
    version: str
    parts: tuple[Part, ...] = ()


def plan(options: Options, storage: Storage) -> list[Fragment]:
    """All fragments of all bags. Raises StorageError, also for a bag that can't be planned."""
    uris = _named(options, storage)
    if not uris:
        raise StorageError(f"{options.path} names no bag")
    return [fragment for uri in uris for fragment in _of_recording(options, storage, uri)]


def _named(options: Options, storage: Storage) -> list[str]:
    return without_members(in_folders(options.path, storage), storage)


def topic_type(options: Options, storage: Storage) -> TopicType:
    """The one type of the one topic. Raises StorageError where bags differ or none has it."""
    found: dict[tuple[str, str], TopicType] = {}
    for uri in _named(options, storage):
        for kind in _kinds(options, storage, uri):
            found[kind.type, kind.md5sum or kind.definition] = kind
    if len(found) != 1:
        kinds = (
            ", ".join(sorted(f"{kind.type} {kind.md5sum}".strip() for kind in found.values()))
            or "none"
        )
        raise StorageError(
            f"{options.topics[0]} in {options.path} has {len(found)} types ({kinds}); columns need"
            " one: read without decode, or fewer bags"
        )
    return next(iter(found.values()))


def _kinds(options: Options, storage: Storage, uri: str) -> Iterable[TopicType]:
    found = recording(uri, storage)
    if isinstance(found, Bag):
        return _types(options, found.file, found.tail.connections).values()
    # What declares the topic stands before its first message.
    fragments = _of_parts(options, found, uri)
    if not fragments:
        return []
    parts = fragments[0].parts
    mcap = opened(uri, parts, storage)
    named = wanted(mcap, parts)
    return [kind_of(each) for each in mcap.connections if each.topic in named]


def kind_of(connection: Any) -> TopicType:
    """What a connection of the native module says."""
    return TopicType(
        resolved(connection.topic),
        connection.type,
        connection.md5sum,
        connection.definition,
        connection.encoding,
        connection.schema_encoding,
    )


def _of_recording(options: Options, storage: Storage, uri: str) -> list[Fragment]:
    found = recording(uri, storage)
    if isinstance(found, Bag):
        return _of_bag(options, found.file, found.tail)
    return _of_parts(options, found, uri)


def _of_bag(options: Options, file: OpenFile, tail: BagTail) -> list[Fragment]:
    types = _types(options, file, tail.connections)
    holding = ChunksByTime(chunk for chunk in tail.chunks if any(map(chunk.counts.get, types)))
    found = []
    for window, _ in _windows(options, tail, file.uri):
        near = holding.near(window.start, window.end)
        if near:
            chunks = tuple(sorted((chunk.offset, chunk.end) for chunk in near))
            found.append(Fragment(file.uri, window, chunks, types, file.version))
    return found


def _of_parts(options: Options, found: McapFile | Rosbag2, uri: str) -> list[Fragment]:
    topics = list(options.topics)
    fragments = []
    try:
        check_left_out(found.tail, topics, found.times)
    except BagError as error:
        raise StorageError(f"{uri}: {error}") from error
    for window, planned in _windows(options, found.tail, uri):
        # Each by itself looks at all chunks again: at most those at both ends are narrowed.
        narrowed = planned.window != window
        parts = found.parts(cut_one(found.tail, topics, window) if narrowed else planned, topics)
        if parts:
            fragments.append(Fragment(uri, window, (), {}, found.version, tuple(parts)))
    return fragments


def _windows(options: Options, tail: BagTail, uri: str) -> Iterator[tuple[Window, FragmentPlan]]:
    """What is to be read of each fragment, and the fragment."""
    try:
        parts = cut(tail, list(options.topics), options.fragment, 0)
    except BagError as error:
        raise StorageError(f"{uri}: {error}") from error
    for part in parts:
        window = part.window
        start = window.start if options.start is None else max(window.start, options.start)
        end = window.end if options.end is None else min(window.end, options.end)
        if start < end:
            yield Window(start, start, end), part


def _types(options: Options, file: OpenFile, connections: list[Connection]) -> dict[int, TopicType]:
    wanted = [one for one in connections if not options.topics or one.topic in options.topics]
    found = {}
    for connection, record in zip(wanted, _records(file, wanted), strict=True):
        fields = connection_fields(record, connection.offset)
        text = fields.get("message_definition", b"").decode(errors="replace")
        md5sum = fields.get("md5sum", b"").decode(errors="replace")
        definition = text if options.decode else ""
        found[connection.id] = TopicType(
            connection.topic,
            connection.datatype,
            md5sum,
            definition,
            connection.encoding,
            "ros1msg",
        )
    return found


def _records(file: OpenFile, connections: list[Connection]) -> Iterator[bytes]:
    """The connections' records; they lie side by side, so that one request brings them all."""
    ranges = [(one.offset, one.length) for one in connections]
    data = b"".join(file.pieces(ranges, REQUEST_BYTES))
    at = 0
    for _offset, length in ranges:
        yield data[at : at + length]
        at += length
