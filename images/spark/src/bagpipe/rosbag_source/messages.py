"""The messages of a fragment; of a bag one chunk is in memory at a time, of others all of it."""

import bz2
import struct
from collections.abc import Iterator
from typing import NamedTuple

import lz4.frame

from bagpipe.plan.bag_tail import BagError, split_record
from bagpipe.rosbag_source.parts import in_window
from bagpipe.rosbag_source.planning import Fragment, TopicType, kind_of
from bagpipe.storage import Storage, StorageError

_OP_MESSAGE, _OP_CHUNK, _OP_CONNECTION = b"\x02", b"\x05", b"\x07"


class Message(NamedTuple):
    """One message: bag time in ns and its bytes as ROS serialises them."""

    kind: TopicType
    time: int
    data: bytes


def messages(fragment: Fragment, storage: Storage) -> Iterator[Message]:
    """In the chunks' order, which is the recorder's; of MCAP and of folders by time.

    Raises StorageError with the byte offset, also where the bag is another one than was planned.
    """
    if fragment.parts:
        yield from _of_parts(fragment, storage)
        return
    file = storage.open(fragment.uri, fragment.version)
    for offset, end in fragment.chunks:
        try:
            yield from _of_chunk(fragment, file.read(offset, end - offset), offset)
        except BagError as error:
            raise StorageError(f"{fragment.uri}: {error}") from error


def _of_parts(fragment: Fragment, storage: Storage) -> Iterator[Message]:
    kinds: dict[int, TopicType] = {}
    for connection, time, raw in in_window(fragment.uri, fragment.parts, storage):
        if connection.id not in kinds:
            kinds[connection.id] = kind_of(connection)
        yield Message(kinds[connection.id], time, bytes(raw))


def _of_chunk(fragment: Fragment, record: bytes, offset: int) -> Iterator[Message]:
    header, begin, end = split_record(record, 0, offset)
    if header.get("op") != _OP_CHUNK:
        raise BagError("BagUnreadable", f"byte {offset} holds no chunk, though the index says so")
    data = _decompressed(header.get("compression", b"none"), record[begin:end], offset)
    window = fragment.window
    at = 0
    while at < len(data):
        header, begin, end = split_record(data, at, offset)
        at = end
        if header.get("op") != _OP_MESSAGE:
            continue
        try:
            (connection,) = struct.unpack("<I", header["conn"])
            seconds, nanoseconds = struct.unpack("<II", header["time"])
        except (KeyError, struct.error) as error:
            raise BagError(
                "BagUnreadable", f"a message in the chunk at byte {offset} has no conn or time"
            ) from error
        time = seconds * 1_000_000_000 + nanoseconds
        kind = fragment.types.get(connection)
        if kind is not None and window.start <= time < window.end:
            yield Message(kind, time, data[begin:end])


def _decompressed(compression: bytes, data: bytes, offset: int) -> bytes:
    try:
        if compression == b"none":
            return data
        if compression == b"bz2":
            return bz2.decompress(data)
        if compression == b"lz4":
            return bytes(lz4.frame.decompress(data))
    except (OSError, ValueError, RuntimeError, EOFError) as error:
        raise BagError(
            "BagUnreadable", f"the chunk at byte {offset} can't be unpacked: {error}"
        ) from error
    name = compression.decode(errors="replace")
    raise BagError("BagUnreadable", f"the chunk at byte {offset} is packed by {name}")
