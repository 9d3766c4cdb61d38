"""Looks into recordings within bounds of bytes and time: their indexes, and a few chunks."""

import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

from bagpipe.cli.first_job.facts import (
    Course,
    Looked,
    Recordings,
    Sample,
    Stretch,
    Topic,
    course_in,
)
from bagpipe.cli.first_job.sampling import Sampled, sample_of_file, sample_of_folder
from bagpipe.native import native
from bagpipe.plan.bag_tail import BagError, BagTail, Chunk, compression_of, message_times, read_tail
from bagpipe.plan.fragments import cut, holding
from bagpipe.plan.rosbag2 import Rosbag2
from bagpipe.plan.rosbag2_metadata import Metadata, is_folder, read_metadata
from bagpipe.storage import OpenFile, Storage, StorageError
from bagpipe.topic_names import resolve

_SECOND = 1_000_000_000
# Of one request for an index. That of a bag of a terabyte has some 50 MB; whoever wrote a greater
# place into a bag's head would have the whole bag read.
_MOST_INDEX_BYTES = 256 << 20
# Of a folder's files that have no index: below it they are read whole. Compressed ones grow.
_MOST_WHOLE_BYTES, _MOST_PACKED_BYTES = 64 << 20, 8 << 20
# Of a folder: each takes requests of its own.
_MOST_FILES = 200
# Messages whose times are read, and chunks: each is a request, where there is no file.
_MOST_TIMES = 2_000_000
_MOST_CHUNKS, _MOST_REMOTE_CHUNKS = 4_000, 64
# Of a whole recording; those of its single files follow.
_START = re.compile(rb"nanoseconds_since_epoch:\s*([0-9]{1,19})")
_LENGTH = re.compile(rb"duration:\s*[{]?\s*nanoseconds:\s*([0-9]{1,19})")
# Fragments times chunks: what cutting takes grows with it.
_MOST_CUTTING = 5_000_000


class LateError(Exception):
    """The time for looking is over."""


@dataclass(frozen=True)
class Bounds:
    """How many recordings are looked into, and for how many seconds; `clock` counts seconds."""

    recordings: int = 20
    seconds: float = 30.0
    clock: Callable[[], float] = time.monotonic


@dataclass
class Looking:
    """A look into recordings: what of each topic of `outputs` is asked for is when it came.

    `cut_at` gives the length and the warm-up of fragments, in seconds, for what is known so far.
    """

    storage: Storage
    outputs: Sequence[str]
    bounds: Bounds = field(default_factory=Bounds)
    _until: float = 0.0

    def __post_init__(self) -> None:
        self._until = self.bounds.clock() + self.bounds.seconds

    def into(
        self, uris: Sequence[str], cut_at: Callable[[Recordings], tuple[float, float]]
    ) -> Recordings:
        """The recordings at these URIs, the first ones where they are many."""
        found: list[Looked] = []
        refused: list[str] = []
        opened: dict[str, _Opened] = {}
        for uri in uris[: self.bounds.recordings]:
            if found and self._late():
                break
            try:
                opened[uri] = self._opened(uri)
                found.append(self._looked(uri, opened[uri]))
            except (BagError, StorageError) as error:
                refused.append(f"{uri}: {error}")
        known = Recordings(found, len(uris), refused)
        length, _ = cut_at(known)
        whole = [
            replace(each, courses=self._courses(opened[each.uri], round(length * _SECOND)))
            for each in found
        ]
        return replace(known, looked=whole)

    def _late(self) -> bool:
        return self.bounds.clock() > self._until

    def _opened(self, uri: str) -> "_Opened":
        if is_folder(uri):
            return self._folder(uri)
        file = self.storage.open(uri)
        tail = read_tail(_bounded(file), file.size)
        kind = "MCAP" if tail.is_mcap else "bag"
        remote = not uri.startswith(("file://", "pvc://"))

        def sampled() -> Sampled:
            return sample_of_file(file, tail, self.outputs)

        def times(chunk: Chunk) -> dict[int, list[int]]:
            return message_times(_bounded(file), chunk)

        def compression(chunk: Chunk) -> str:
            return compression_of(file.read, chunk)

        return _Opened(kind, file.size, tail, sampled, times, compression, remote)

    def _folder(self, uri: str) -> "_Opened":
        metadata = read_metadata(uri, self.storage)
        sizes = [self.storage.size(each) for each in metadata.files[:_MOST_FILES]]
        remote = not uri.startswith(("file://", "pvc://"))
        kind = f"folder of rosbag2 ({metadata.storage})"
        most = _MOST_PACKED_BYTES if metadata.compressed == "file" else _MOST_WHOLE_BYTES
        large = sum(sizes) > most and not metadata.by_ranges
        if large or len(metadata.files) > _MOST_FILES:
            return _Opened(kind, sum(sizes), metadata=metadata, remote=remote)
        folder = Rosbag2(metadata, self.storage)

        def sampled() -> Sampled:
            return sample_of_folder(folder, self.storage, self.outputs)

        def compression(chunk: Chunk) -> str:
            # Its own file is known to the folder alone; what is packed otherwise is never plain.
            return (chunk.compression or "zstd") if metadata.as_stored else "zstd"

        return _Opened(
            kind, sum(sizes), folder.tail, sampled, folder.times, compression, remote, metadata
        )

    def _looked(self, uri: str, opened: "_Opened") -> Looked:
        if opened.tail is None:
            return _by_metadata(uri, opened)
        tail = opened.tail
        if not tail.chunks:
            raise BagError("BagEmpty", "it holds no message")
        start = min(chunk.start_time for chunk in tail.chunks)
        end = max(chunk.end_time for chunk in tail.chunks)
        sampled = Sampled({}, None) if self._late() else opened.sampled()
        packed = any(_is_packed(opened, chunk) for chunk in tail.chunks[:3])
        return Looked(
            uri,
            opened.kind,
            opened.bytes,
            start,
            end,
            _topics(tail, (end - start) / _SECOND, sampled.topics),
            _stretches(tail, opened),
            sampled.growth if packed else 0.0,
        )

    def _courses(self, opened: "_Opened", length: int) -> dict[str, Course]:
        """When each output came, as far as the indexes say it in a time that is bounded."""
        tail = opened.tail
        if tail is None or not self.outputs or self._late():
            return {}
        ids = {each.id: each.topic for each in tail.connections if each.topic in self.outputs}
        chunks = [chunk for chunk in tail.chunks if ids.keys() & holding(chunk)]
        most = _MOST_REMOTE_CHUNKS if opened.remote else _MOST_CHUNKS
        entries = sum(sum(chunk.counts.values()) for chunk in chunks)
        span = max(c.end_time for c in tail.chunks) - min(c.start_time for c in tail.chunks)
        if len(chunks) > most or entries > _MOST_TIMES:
            return {}
        if (span // length + 1) * len(tail.chunks) > _MOST_CUTTING:
            return {}
        try:
            times = self._times(opened, chunks, ids)
            windows = [f.window for f in cut(tail, [], length, 0, None)]
        except (BagError, StorageError, LateError):
            return {}
        edges = [(window.start, window.end) for window in windows]
        found = {topic: course_in(sorted(times[topic]), edges) for topic in set(ids.values())}
        return {topic: course for topic, course in found.items() if course is not None}

    def _times(
        self, opened: "_Opened", chunks: Iterable[Chunk], ids: dict[int, str]
    ) -> dict[str, list[int]]:
        times: dict[str, list[int]] = {topic: [] for topic in ids.values()}
        for chunk in chunks:
            if self._late():
                raise LateError
            found = opened.times(chunk)
            for number, topic in ids.items():
                times[topic] += found.get(number, [])
        return times


def _is_packed(opened: "_Opened", chunk: Chunk) -> bool:
    try:
        return opened.compression(chunk) != "none"
    except BagError:  # a damaged chunk: whoever plays it says what is wrong
        return True


def _no_sample() -> Sampled:
    return Sampled({}, None)


def _no_times(_chunk: Chunk) -> dict[int, list[int]]:
    raise BagError("BagUnreadable", "a file that is read whole has no index of a part")


def _unknown(_chunk: Chunk) -> str:
    return "zstd"


@dataclass(frozen=True)
class _Opened:
    """A recording of which the index was read, or of a folder without one the metadata alone."""

    kind: str
    bytes: int
    tail: BagTail | None = None
    sampled: Callable[[], Sampled] = _no_sample
    times: Callable[[Chunk], dict[int, list[int]]] = _no_times
    compression: Callable[[Chunk], str] = _unknown
    remote: bool = False
    metadata: Metadata | None = None


def _bounded(file: OpenFile) -> Callable[[int, int], bytes]:
    def read(offset: int, length: int) -> bytes:
        if length > _MOST_INDEX_BYTES:
            raise BagError(
                "BagUnreadable",
                f"its index would have {length:,} bytes from byte {offset}, expected at most"
                f" {_MOST_INDEX_BYTES:,}: the file is damaged; `bagpipe bag reindex` mends it",
            )
        return file.read(offset, length)

    return read


def _topics(tail: BagTail, seconds: float, samples: dict[str, Sample]) -> dict[str, Topic]:
    counts: Counter[int] = Counter()
    for chunk in tail.chunks:
        counts.update(chunk.counts)
    found: dict[str, Topic] = {}
    for each in tail.connections:
        kinds, encodings = frozenset({each.datatype}), frozenset({each.encoding})
        number = counts[each.id]
        topic = Topic(each.topic, kinds, encodings, number, each.in_force > 0, 0.0)
        known = found.get(each.topic)
        # One that published nothing decides nothing about what the topic's messages are.
        if known is None or not known.messages:
            found[each.topic] = topic
        elif number:
            found[each.topic] = known.joined(topic)
    return {
        name: replace(topic, seconds=seconds, sample=samples.get(name, Sample()))
        for name, topic in found.items()
    }


def _stretches(tail: BagTail, opened: _Opened) -> tuple[Stretch, ...]:
    if opened.metadata is not None and not opened.metadata.by_ranges:
        return ()
    return tuple(
        Stretch(chunk.start_time, chunk.end_time, chunk.end - chunk.offset) for chunk in tail.chunks
    )


def _by_metadata(uri: str, opened: _Opened) -> Looked:
    """What a folder's metadata.yaml says, where its files would have to be read whole."""
    assert opened.metadata is not None  # noqa: S101  a recording without a tail has it
    text = opened.metadata.text
    start, length = (
        found and int(found[1]) for found in (_START.search(text), _LENGTH.search(text))
    )
    seconds = (length or 0) / _SECOND
    topics = {}
    for name, kind, encoding, count in native("rosbag2_metadata", "reading a folder")(text)[5]:
        kinds, encodings = frozenset({kind}), frozenset({encoding})
        topics[resolve(name)] = Topic(resolve(name), kinds, encodings, count, False, seconds)
    end = None if start is None else start + (length or 0)
    return Looked(uri, opened.kind, opened.bytes, start, end, topics, basis="metadata.yaml")
