"""Files of rosbag2 that are read whole: of SQLite, and those that are compressed as a file."""

import contextlib
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from bagpipe.plan.bag_tail import BagError, BagTail, Chunk, Connection, message_times, read_tail
from bagpipe.plan.rosbag2_metadata import Metadata, parsed
from bagpipe.storage import OpenFile, Storage, StorageError
from bagpipe.topic_names import resolve

# Of a file, as it is stored and again as it is uncompressed, on this disk.
MOST_WHOLE_BYTES = 4 << 30
_PIECE_BYTES = 1 << 20


def tail_of_whole(path: Path, metadata: Metadata, size: int) -> BagTail:
    """The tail of a file that lies on this disk, whose chunks have places of no meaning."""
    if metadata.storage == "mcap":
        with path.open("rb") as stream:

            def read(offset: int, length: int) -> bytes:
                stream.seek(offset)
                return stream.read(length)

            tail = read_tail(read, path.stat().st_size)
            for chunk in () if tail.counted else tail.chunks:
                message_times(read, chunk)  # which the parts of a fragment have no place for
    else:
        connections, stretches = parsed("database_rows", path, metadata.text)
        tail = BagTail(
            size,
            [],
            [Connection(number, resolve(topic), *rest) for number, topic, *rest in connections],
            [Chunk(0, 0, start, end, counts) for start, end, counts in stretches],
        )
        if not stretches:
            raise BagError("BagEmpty", "the file holds no messages")
    if len(tail.chunks) > size:
        raise BagError("BagUnreadable", f"{len(tail.chunks)} chunks in a file of {size} bytes")
    placed = [replace(each, offset=at, end=at + 1) for at, each in enumerate(tail.chunks)]
    return replace(tail, chunks=placed, counted=True)


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
