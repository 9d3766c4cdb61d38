"""Which files a job reads and which partition each goes to; nothing here reads their bytes."""

import heapq
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from bagpipe.binpiped.record import Fields, InputRecord
from bagpipe.plan.bag_tail import BagError, message_times, read_tail
from bagpipe.plan.fragments import cut
from bagpipe.plan.framing import framing
from bagpipe.plan.left_out import check_left_out
from bagpipe.plan.part import Part
from bagpipe.plan.rosbag2 import Rosbag2, in_folders, joined, without_members
from bagpipe.plan.rosbag2_metadata import is_folder, read_metadata
from bagpipe.storage import Stat, Storage, StorageError
from bagpipe.wire.frames import MAX_PAYLOAD_BYTES, payloads

# A partition of this many bytes is work for some seconds and little to repeat.
PARTITION_BYTES = 128 << 20
_NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class Descriptor:
    """One record before it is read: (offset, length) ranges of a file, in bytes.

    They lie behind the bytes `head` and before the bytes `end`. A folder of rosbag2 has `parts` of
    its files in their place.
    """

    name: str
    uri: str
    ranges: tuple[tuple[int, int], ...]
    head: bytes = b""
    end: bytes = b""
    fields: Fields = field(default_factory=dict)
    # The file's mark when it was planned: another file's bytes in its ranges are no record.
    version: str = ""
    parts: tuple[Part, ...] = ()

    @property
    def size(self) -> int:
        """Bytes of the record; of parts, those that are read for it."""
        ranges = sum(length for _, length in self.ranges) + sum(part.bytes for part in self.parts)
        return len(self.head) + ranges + len(self.end)

    def open(self, storage: Storage) -> InputRecord:
        """The record, to be read when its turn comes. Raises StorageError."""
        if self.parts:
            data = self._joined(storage)
            return InputRecord(self.name, len(data), lambda: payloads(data), self.fields)
        if length := self._one_piece:
            whole = partial(self._whole, storage, length)
            return InputRecord(self.name, length, whole, self.fields)

        def pieces() -> Iterable[bytes]:
            if self.head:
                yield self.head
            ranges = list(self.ranges)
            yield from storage.pieces(self.uri, ranges, MAX_PAYLOAD_BYTES, self.version)
            if self.end:
                yield self.end

        return InputRecord(self.name, self.size, lambda: iter(pieces()), self.fields)

    @property
    def _one_piece(self) -> int:
        """Bytes of a record that is the beginning of a file and fits a frame; 0 for others."""
        if len(self.ranges) != 1 or self.head or self.end or not self.version:
            return 0
        offset, length = self.ranges[0]
        return length if offset == 0 and length <= MAX_PAYLOAD_BYTES else 0

    def _whole(self, storage: Storage, length: int) -> Iterator[bytes]:
        return iter((storage.read_planned(self.uri, length, self.version),))

    def _joined(self, storage: Storage) -> bytes:
        """The parts as one file of MCAP, in memory. Raises StorageError."""
        try:
            metadata = read_metadata(self.uri, storage, self.version)
            return joined(self.parts, metadata, storage, {})
        except BagError as error:
            raise StorageError(f"{self.uri}: {error}") from error


def whole_files(storage: Storage, patterns: Iterable[str]) -> list[Descriptor]:
    """One record for each file that the patterns name. Raises StorageError."""
    return [_whole(uri, storage.stat(uri)) for uri in _expand(storage, patterns)]


def _whole(uri: str, found: Stat) -> Descriptor:
    ranges = ((0, found.size),) if found.size else ()
    return Descriptor(uri, uri, ranges, version=found.version)


def fragments(
    storage: Storage, patterns: Iterable[str], seconds: float, topics: Sequence[str]
) -> list[Descriptor]:
    """One record for each fragment of each recording, from their indexes alone.

    A record is a recording without an index: of a bag or of MCAP the connections and the chunks
    that hold the window, of a folder of rosbag2 the messages in it, as MCAP. Raises StorageError,
    also for what can't be planned.
    """
    length = round(seconds * _NANOSECONDS)
    found: list[Descriptor] = []
    for uri in _recordings(storage, patterns):
        plan = _of_folder if is_folder(uri) else _of_file
        try:
            found += plan(storage, uri, length, list(topics))
        except BagError as error:
            raise StorageError(f"{uri}: {error}") from error
    return found


def _of_file(storage: Storage, uri: str, length: int, topics: list[str]) -> Iterator[Descriptor]:
    file = storage.open(uri)
    tail = read_tail(file.read, file.size)
    (head, end), declarations = framing(tail.declarations), tuple(tail.declarations)
    check_left_out(tail, topics, partial(message_times, file.read))
    for part in cut(tail, topics, length, 0):
        window: Fields = {"start": part.window.start, "end": part.window.end}
        ranges = declarations + tuple(part.ranges)
        yield Descriptor(f"{uri}#{part.number}", uri, ranges, head, end, window, file.version)


def _of_folder(storage: Storage, uri: str, length: int, topics: list[str]) -> Iterator[Descriptor]:
    folder = Rosbag2(read_metadata(uri, storage), storage, most_times=0)
    check_left_out(folder.tail, topics, folder.times)
    for each in cut(folder.tail, topics, length, 0):
        window: Fields = {"start": each.window.start, "end": each.window.end}
        parts = tuple(folder.parts(each, topics))
        name = f"{uri}#{each.number}"
        yield Descriptor(name, uri, (), fields=window, version=folder.version, parts=parts)


def _recordings(storage: Storage, patterns: Iterable[str]) -> list[str]:
    found: dict[str, None] = {}
    for pattern in patterns:
        uris = without_members(in_folders(located(pattern), storage), storage)
        if not uris:
            raise StorageError(f"{pattern} names no file")
        found.update(dict.fromkeys(uris))
    return without_members(list(found), storage)


def _expand(storage: Storage, patterns: Iterable[str]) -> list[str]:
    found: dict[str, None] = {}
    for pattern in patterns:
        uris = storage.expand(located(pattern))
        if not uris:
            raise StorageError(f"{pattern} names no file")
        found.update(dict.fromkeys(uris))
    return list(found)


def located(uri: str) -> str:
    """A URI; a plain path is one of this machine's files."""
    return uri if "://" in uri else f"file://{Path(uri).absolute()}"


def pack(descriptors: Sequence[Descriptor], partitions: int) -> list[list[Descriptor]]:
    """Partitions of about equal bytes, biggest record first; at most one for each record."""
    count = max(1, min(partitions, len(descriptors)))
    packed: list[list[Descriptor]] = [[] for _ in range(count)]
    loads = [(0, number) for number in range(count)]
    for descriptor in sorted(descriptors, key=lambda one: (-one.size, one.name)):
        load, number = loads[0]
        packed[number].append(descriptor)
        # An empty file costs something too.
        heapq.heapreplace(loads, (load + descriptor.size + 1, number))
    return packed


def partitions_for(descriptors: Sequence[Descriptor], parallelism: int) -> int:
    """As many as the executors run at once, and more where a partition would grow too big."""
    total = sum(descriptor.size for descriptor in descriptors)
    return max(parallelism, -(-total // PARTITION_BYTES))
