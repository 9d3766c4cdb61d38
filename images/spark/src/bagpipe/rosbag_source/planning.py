"""Partitions of `spark.read.format("rosbag")`, from the bags' heads and tails alone."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from bagpipe.plan.bag_tail import BagError, BagTail, Connection, connection_fields, read_tail
from bagpipe.plan.bag_tail import resolve as resolved
from bagpipe.plan.fragments import Window, cut
from bagpipe.storage import OpenFile, Storage, StorageError
from bagpipe.storage.reading import REQUEST_BYTES

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
        length = int(seconds * _NANOSECONDS)
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
    md5sum: str
    definition: str


@dataclass(frozen=True)
class Fragment:
    """One task: the messages with start <= time < end in the (offset, end) chunks of a bag."""

    uri: str
    window: Window
    chunks: tuple[tuple[int, int], ...]
    types: dict[int, TopicType]
    # The bag's mark when it was planned: another bag's bytes are none of its messages.
    version: str


def plan(options: Options, storage: Storage) -> list[Fragment]:
    """All fragments of all bags. Raises StorageError, also for a bag that can't be planned."""
    uris = storage.expand(options.path)
    if not uris:
        raise StorageError(f"{options.path} names no bag")
    return [fragment for uri in uris for fragment in _of_bag(options, storage, uri)]


def topic_type(options: Options, storage: Storage) -> TopicType:
    """The one type of the one topic. Raises StorageError where bags differ or none has it."""
    found: dict[str, TopicType] = {}
    for uri in storage.expand(options.path):
        file = storage.open(uri)
        for kind in _types(options, file, _tail(file).connections).values():
            found[kind.md5sum] = kind
    if len(found) != 1:
        kinds = ", ".join(sorted(f"{kind.type} {md5}" for md5, kind in found.items())) or "none"
        raise StorageError(
            f"{options.topics[0]} in {options.path} has {len(found)} types ({kinds}); columns need"
            " one: read without decode, or fewer bags"
        )
    return next(iter(found.values()))


def _of_bag(options: Options, storage: Storage, uri: str) -> list[Fragment]:
    file = storage.open(uri)
    tail = _tail(file)
    types = _types(options, file, tail.connections)
    found = []
    try:
        parts = cut(tail, list(options.topics), options.fragment, 0)
    except BagError as error:
        raise StorageError(f"{file.uri}: {error}") from error
    for part in parts:
        start = max(part.window.start, options.start or part.window.start)
        end = min(part.window.end, options.end or part.window.end)
        chunks = tuple(
            (chunk.offset, chunk.end)
            for chunk in tail.chunks
            if chunk.start_time < end and chunk.end_time >= start
            if any(chunk.counts.get(connection) for connection in types)
        )
        if start < end and chunks:
            window = Window(start, start, end)
            found.append(Fragment(uri, window, chunks, types, file.version))
    return found


def _tail(file: OpenFile) -> BagTail:
    try:
        tail = read_tail(file.read, file.size)
    except BagError as error:
        raise StorageError(f"{file.uri}: {error}") from error
    if tail.is_mcap:
        raise StorageError(
            f"{file.uri} is MCAP, and format('rosbag') reads bags alone: bagpipe.MemoryBag reads"
            " it, and the fragments of BinPipedRDD are made of it"
        )
    return tail


def _types(options: Options, file: OpenFile, connections: list[Connection]) -> dict[int, TopicType]:
    wanted = [one for one in connections if not options.topics or one.topic in options.topics]
    found = {}
    for connection, record in zip(wanted, _records(file, wanted), strict=True):
        fields = connection_fields(record, connection.offset)
        text = fields.get("message_definition", b"").decode(errors="replace")
        md5sum = fields.get("md5sum", b"").decode(errors="replace")
        definition = text if options.decode else ""
        found[connection.id] = TopicType(connection.topic, connection.datatype, md5sum, definition)
    return found


def _records(file: OpenFile, connections: list[Connection]) -> Iterator[bytes]:
    """The connections' records; they lie side by side, so that one request brings them all."""
    ranges = [(one.offset, one.length) for one in connections]
    data = b"".join(file.pieces(ranges, REQUEST_BYTES))
    at = 0
    for _offset, length in ranges:
        yield data[at : at + length]
        at += length
