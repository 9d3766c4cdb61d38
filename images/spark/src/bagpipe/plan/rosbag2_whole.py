"""Files of rosbag2 that are read whole: of SQLite, and those that are compressed as a file."""

import contextlib
import tempfile
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from bagpipe.plan.bag_tail import (
    BagError,
    BagTail,
    Chunk,
    Connection,
    Read,
    message_times,
    read_tail,
)
from bagpipe.plan.rosbag2_metadata import Metadata, parsed
from bagpipe.storage import OpenFile, Storage, StorageError
from bagpipe.topic_names import resolve

# Of a file, as it is stored and again as it is uncompressed, on this disk.
MOST_WHOLE_BYTES = 4 << 30
# Messages of a folder whose times are kept in memory, of 8 bytes each.
MOST_TIMES = 16_000_000
_PIECE_BYTES = 1 << 20


@dataclass(frozen=True)
class Whole:
    """What a file that was read whole holds. Its chunks have places of no meaning.

    `times` has for each chunk the time of each message in ns, packed as integers of 8 bytes, for
    one connection after the other as the chunk counts them; nothing where that is not known.
    """

    tail: BagTail
    times: list[bytes]

    @property
    def kept(self) -> int:
        """How many times are kept."""
        return sum(map(len, self.times)) // array("Q").itemsize

    def times_of(self, chunk: Chunk) -> dict[int, list[int]]:
        """Times in ns of a chunk's messages for each connection. Raises BagError."""
        times = iter(memoryview(self.times[chunk.offset]).cast("Q"))
        found = {each: list(islice(times, count)) for each, count in chunk.counts.items()}
        if any(len(found[each]) != count for each, count in chunk.counts.items()):
            raise BagError("BagUnreadable", "the times of a chunk's messages are not known")
        return found


def read_whole(path: Path, metadata: Metadata, size: int, most_times: int) -> Whole:
    """Reads a file that lies on this disk; of one with more messages than `most_times` no times are
    kept. Raises BagError.
    """
    if metadata.storage == "mcap":
        tail, times = _mcap(path, most_times)
    else:
        tail, times = _sqlite(path, metadata, size, most_times)
    if len(tail.chunks) > size:
        raise BagError("BagUnreadable", f"{len(tail.chunks)} chunks in a file of {size} bytes")
    placed = [replace(each, offset=at, end=at + 1) for at, each in enumerate(tail.chunks)]
    return Whole(replace(tail, chunks=placed, counted=True), times)


def _mcap(path: Path, most_times: int) -> tuple[BagTail, list[bytes]]:
    with path.open("rb") as stream:

        def read(offset: int, length: int) -> bytes:
            stream.seek(offset)
            return stream.read(length)

        tail = read_tail(read, path.stat().st_size)
        known = sum(sum(chunk.counts.values()) for chunk in tail.chunks) <= most_times
        if tail.counted and not known:
            return tail, [b""] * len(tail.chunks)
        times = [_times_of(chunk, read, tail.counted) for chunk in tail.chunks]
        return tail, times if known else [b""] * len(times)


def _times_of(chunk: Chunk, read: Read, counted: bool) -> bytes:
    """A damaged index is no fault where the counts of messages don't depend on it."""
    try:
        found = message_times(read, chunk)
    except BagError:
        if not counted:
            raise
        return b""
    packed = array("Q")
    for connection in chunk.counts:
        packed.extend(found.get(connection, ()))
    return packed.tobytes()


def _sqlite(
    path: Path, metadata: Metadata, size: int, most_times: int
) -> tuple[BagTail, list[bytes]]:
    connections, stretches = parsed("database_rows", path, metadata.text, most_times)
    if not stretches:
        raise BagError("BagEmpty", "the file holds no messages")
    tail = BagTail(
        size,
        [],
        [Connection(number, resolve(topic), *rest) for number, topic, *rest in connections],
        [Chunk(0, 0, start, end, counts) for start, end, counts, _ in stretches],
    )
    return tail, [times for *_, times in stretches]


@contextlib.contextmanager
def whole_file(file: OpenFile, metadata: Metadata, storage: Storage) -> Iterator[Path]:
    """A file of a folder on this disk, uncompressed where it is compressed as a whole.

    Raises BagError and StorageError.
    """
    log = f"{file.uri}-wal"
    # A reader that was killed leaves an empty one.
    if metadata.storage == "sqlite3" and storage.exists(log) and storage.size(log):
        raise BagError(
            "BagUnreadable",
            "beside it lies a write-ahead log (-wal), which holds messages that are not in the file"
            " yet: open the file once by `sqlite3 FILE 'PRAGMA user_version'`, and copy it again",
        )
    if file.size > MOST_WHOLE_BYTES:
        raise BagError(
            "BagUnreadable",
            f"it has {file.size:,} bytes and must be read whole, which is done up to"
            f" {MOST_WHOLE_BYTES:,}: `bagpipe bag convert` makes MCAP of it",
        )
    with tempfile.TemporaryDirectory(prefix="bagpipe-") as folder:
        path = Path(folder, "stored")
        try:
            with path.open("wb") as stored:
                for piece in file.pieces([(0, file.size)], _PIECE_BYTES):
                    stored.write(piece)
            if metadata.compressed == "file":
                whole = Path(folder, "whole")
                parsed("uncompress_file", path, whole, MOST_WHOLE_BYTES)
                path.unlink()
                path = whole
        except OSError as error:
            raise StorageError(f"{file.uri}: it can't be copied to this disk: {error}") from error
        yield path
