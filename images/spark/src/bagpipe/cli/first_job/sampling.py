"""Reads a few chunks of a recording, to see how large messages are and whether they have stamps."""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Any

from bagpipe.cli.first_job.facts import Sample
from bagpipe.evaluate.decoding import stamp_reader
from bagpipe.plan.bag_tail import BagError, BagTail, Chunk
from bagpipe.plan.fragments import Window, cut_one, holding, ranges_of
from bagpipe.plan.framing import framed
from bagpipe.plan.rosbag2 import Rosbag2, joined
from bagpipe.recording_format import in_memory
from bagpipe.storage import OpenFile, Storage, StorageError
from bagpipe.topic_names import resolve

# As they are stored, and what they may become in memory.
_MOST_BYTES = 16 << 20
_MOST_UNPACKED_BYTES = 256 << 20
_MOST_CHUNKS = 16
_MOST_MESSAGES = 200_000
_PIECE_BYTES = 1 << 20
_SECOND = 1_000_000_000


@dataclass(frozen=True)
class Sampled:
    """A sample of each topic, and how many times the bytes that were read grew; None: nothing was.

    It is empty where nothing could be read: a job is proposed without it.
    """

    topics: dict[str, Sample]
    growth: float | None


def sample_of_file(file: OpenFile, tail: BagTail, stamped: Collection[str]) -> Sampled:
    """Of a bag or a file of MCAP; stamps are read of the topics `stamped` alone, as each definition
    takes its time. Never raises for what is in it.
    """
    chunks = _with_each_topic(tail)
    ranges = tail.declarations + ranges_of(chunks)
    if not chunks or sum(length for _, length in ranges) > 2 * _MOST_BYTES:
        return Sampled({}, None)
    try:
        data = b"".join(framed(ranges, file.pieces(ranges, _PIECE_BYTES)))
        stored = sum(chunk.end - chunk.offset for chunk in chunks)
        return _sampled(lambda: in_memory(data, _MOST_UNPACKED_BYTES), stored, stamped)
    except StorageError:
        return Sampled({}, None)


def sample_of_folder(folder: Rosbag2, storage: Storage, stamped: Collection[str]) -> Sampled:
    """The same of the first seconds of a folder of rosbag2."""
    begin = min(chunk.start_time for chunk in folder.tail.chunks)
    for seconds in (10, 1):
        window = Window(begin, begin, begin + seconds * _SECOND)
        parts = folder.parts(cut_one(folder.tail, [], window), [])
        if parts and sum(part.bytes for part in parts) <= _MOST_BYTES:
            break
    else:
        return Sampled({}, None)
    stored = sum(part.bytes for part in parts) if folder.metadata.as_stored else 0
    try:
        made = joined(parts, folder.metadata, storage, {})
        return _sampled(lambda: in_memory(made, _MOST_UNPACKED_BYTES), stored, stamped)
    except (BagError, StorageError):
        return Sampled({}, None)


def _with_each_topic(tail: BagTail) -> list[Chunk]:
    """Few chunks that together have as many topics as they can; the first ones, once each."""
    missing = {number for chunk in tail.chunks for number in holding(chunk)}
    found: list[Chunk] = []
    size = 0
    for chunk in tail.chunks:
        length = chunk.end - chunk.offset
        if missing & holding(chunk) and size + length <= _MOST_BYTES:
            found.append(chunk)
            size += length
            missing -= holding(chunk)
        if not missing or len(found) == _MOST_CHUNKS:
            break
    return found


def _sampled(opened: Callable[[], Any], stored: int, stamped: Collection[str]) -> Sampled:
    try:
        return _of_messages(opened().messages(), stored, stamped)
    except ValueError:  # a damaged chunk: whoever plays it says what is wrong
        return Sampled({}, None)


def _of_messages(messages: Iterable[Any], stored: int, stamped: Collection[str]) -> Sampled:
    readers: dict[int, Callable[[memoryview], int | None] | None] = {}
    counts: dict[str, list[int]] = {}
    ages: dict[str, list[int]] = {}
    whole = 0
    for number, (connection, time, raw) in enumerate(messages):
        if number == _MOST_MESSAGES:
            break
        topic = resolve(connection.topic)
        if connection.id not in readers:
            readers[connection.id] = stamp_reader(connection) if topic in stamped else None
        count = counts.setdefault(topic, [0, 0])
        count[0] += 1
        count[1] += len(raw)
        whole += len(raw)
        reader = readers[connection.id]
        stamp = reader(raw) if reader else None
        if stamp is not None:
            ages.setdefault(topic, []).append(time - stamp)
    topics = {
        topic: Sample(number, size, tuple(ages.get(topic, ())))
        for topic, (number, size) in counts.items()
    }
    return Sampled(topics, whole / stored if stored and whole else None)
