"""Which files a job reads and which partition each goes to; nothing here reads their bytes."""

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bagpipe.binpiped.record import Fields, InputRecord
from bagpipe.plan.bag_tail import BagError, read_tail
from bagpipe.plan.fragments import cut
from bagpipe.plan.framing import framing
from bagpipe.storage import Stat, Storage, StorageError
from bagpipe.wire.frames import MAX_PAYLOAD_BYTES

# A partition of this many bytes is work for some seconds and little to repeat.
PARTITION_BYTES = 128 << 20
_NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class Descriptor:
    """One record before it is read: (offset, length) ranges of a file, in bytes.

    They lie behind the bytes `head` and before the bytes `end`.
    """

    name: str
    uri: str
    ranges: tuple[tuple[int, int], ...]
    head: bytes = b""
    end: bytes = b""
    fields: Fields = field(default_factory=dict)
    # The file's mark when it was planned: another file's bytes in its ranges are no record.
    version: str = ""

    @property
    def size(self) -> int:
        """Bytes of the record."""
        return len(self.head) + sum(length for _, length in self.ranges) + len(self.end)

    def open(self, storage: Storage) -> InputRecord:
        """The record, to be read when its turn comes."""

        def pieces() -> Iterable[bytes]:
            if self.head:
                yield self.head
            ranges = list(self.ranges)
            yield from storage.pieces(self.uri, ranges, MAX_PAYLOAD_BYTES, self.version)
            if self.end:
                yield self.end

        return InputRecord(self.name, self.size, lambda: iter(pieces()), self.fields)


def whole_files(storage: Storage, patterns: Iterable[str]) -> list[Descriptor]:
    """One record for each file that the patterns name. Raises StorageError."""
    return [_whole(uri, storage.stat(uri)) for uri in _expand(storage, patterns)]


def _whole(uri: str, found: Stat) -> Descriptor:
    ranges = ((0, found.size),) if found.size else ()
    return Descriptor(uri, uri, ranges, version=found.version)


def bag_fragments(
    storage: Storage, patterns: Iterable[str], seconds: float, topics: Sequence[str]
) -> list[Descriptor]:
    """One record for each fragment of each bag, by chunk boundaries, from the bags' tails alone.

    A record is a recording without an index: the connections and the chunks that hold the window.
    Raises StorageError, also for a bag that can't be planned.
    """
    found = []
    for uri in _expand(storage, patterns):
        file = storage.open(uri)
        try:
            tail = read_tail(file.read, file.size)
            parts = cut(tail, list(topics), round(seconds * _NANOSECONDS), 0)
        except BagError as error:
            raise StorageError(f"{uri}: {error}") from error
        (head, end), declarations = framing(tail.declarations), tuple(tail.declarations)
        for part in parts:
            window: Fields = {"start": part.window.start, "end": part.window.end}
            ranges = declarations + tuple(part.ranges)
            name = f"{uri}#{part.number}"
            found.append(Descriptor(name, uri, ranges, head, end, window, file.version))
    return found


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
