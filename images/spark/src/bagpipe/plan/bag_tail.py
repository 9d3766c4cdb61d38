"""What a bag's tail says: which chunks hold which times, without reading a payload.

Format: bag 2.0, http://wiki.ros.org/Bags/Format/2.0. The file header record names
`index_pos`; from there to the end lie the CONNECTION records and one CHUNK_INFO per chunk.
Which bytes are read is decided here; the native module says what they mean, as the agent's own
crate does. Everything that reads a bag raises NativeModuleError where it is missing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bagpipe.native import native
from bagpipe.plan import mcap_summary
from bagpipe.recording_format import MCAP_MAGIC
from bagpipe.topic_names import resolve

MAGIC = b"#ROSBAG V2.0\n"
_FILE_HEADER_BYTES = 4096
# What is a part of a recording, and what to do with it.
_OTHERS = {
    b"SQLite format 3\0": "it is a file of SQLite: name the folder that it lies in, whose"
    " metadata.yaml makes it a recording, or make MCAP of it by `bagpipe bag convert`",
    b"rosbag2_bagfile_information:": "it is a folder of rosbag2, which is not taken here: make MCAP"
    " of it by `bagpipe bag convert`",
}
# op, compression and size, each with its name and length, are some 50 bytes.
_CHUNK_HEADER_BYTES = 256
# An index has a time and an offset for each message (12 bytes in a bag, 16 in MCAP), and a header
# of some 60 bytes for each connection.
_INDEX_ENTRY_BYTES, _INDEX_HEADER_BYTES = 16, 128

Read = Callable[[int, int], bytes]


class BagError(Exception):
    """A bag that can't be planned; `reason` is CamelCase, the sentence names the byte offset."""

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason


@dataclass(frozen=True)
class Connection:
    """One recorded publisher of a topic; its record lies `length` bytes from `offset`.

    `encoding` says what its messages' bytes are, such as ros1 or cdr; `in_force` how many of its
    last messages a subscriber that joins late gets.
    """

    id: int
    topic: str
    datatype: str
    caller_id: str
    encoding: str
    in_force: int
    offered_qos: str
    offset: int
    length: int


@dataclass(frozen=True)
class Chunk:
    """One chunk: bytes `offset` to `end` of the file; times in ns; messages per connection.

    Its message index begins at byte `index`; that and its compression are None where the chunk's
    own record must be asked.
    """

    offset: int
    end: int
    start_time: int
    end_time: int
    counts: dict[int, int]
    index: int | None = None
    compression: str | None = None


@dataclass(frozen=True)
class BagTail:
    """All that planning needs to know of a bag of `size` bytes.

    `declarations` are the (offset, length) ranges of what a reader of its chunks needs before them,
    in bytes, in their order. Where `counted` is false, nothing but the chunk indexes of MCAP says
    which chunks have messages of which connections.
    """

    size: int
    declarations: list[tuple[int, int]]
    connections: list[Connection]
    chunks: list[Chunk]
    counted: bool = True

    @property
    def is_mcap(self) -> bool:
        """Its declarations begin with its own head, which those of a bag never do."""
        return bool(self.declarations) and self.declarations[0][0] == 0


def read_tail(read: Read, size: int) -> BagTail:
    """Read a bag's first 4 KiB and its tail by `read(offset, length)`.

    Raises BagError with the reason BagEmpty, BagUnreadable, BagCut or BagNotIndexed.
    """
    if size == 0:
        # A recorder writes a head first, so that bytes are missing: messages may be, too.
        raise BagError("BagCut", "the file is empty (0 bytes): copy it again")
    head = read(0, min(_FILE_HEADER_BYTES + len(MAGIC) + 64, size))
    if head.startswith(MCAP_MAGIC):
        return _tail(size, mcap_summary.read_index(read, size, head, parsed))
    if advice := next((text for magic, text in _OTHERS.items() if head.startswith(magic)), None):
        raise BagError("BagUnreadable", advice)
    if not head.startswith(MAGIC):
        raise BagError(
            "BagUnreadable",
            f"the file begins with {head[:13]!r}, expected {MAGIC!r} (bag 2.0) or"
            f" {MCAP_MAGIC!r} (MCAP)",
        )
    found = parsed("parse_head", head, size)
    index_position = found[0]
    tail = read(index_position, size - index_position)
    return _tail(size, parsed("bag_index", tail, found))


def _tail(size: int, index: Any) -> BagTail:
    declarations, connections, chunks, counted = index
    return BagTail(
        size,
        declarations,
        [Connection(number, resolve(topic), *rest) for number, topic, *rest in connections],
        [Chunk(*each) for each in chunks],
        counted,
    )


def compression_of(read: Read, chunk: Chunk) -> str:
    """A chunk's compression (such as none or lz4), from its header alone. Raises BagError."""
    if chunk.compression is not None:
        return chunk.compression
    data = read(chunk.offset, min(_CHUNK_HEADER_BYTES, chunk.end - chunk.offset))
    compression: str = parsed("chunk_compression", data, chunk.offset)
    return compression


def message_times(read: Read, chunk: Chunk) -> dict[int, list[int]]:
    """Times in ns of a chunk's messages for each connection that has some, from the index records
    behind it.

    Raises BagError where these are not what the chunk's counts say.
    """
    counts = {connection: count for connection, count in chunk.counts.items() if count}
    # Writers of MCAP may leave an index without an entry for a channel without a message.
    most = _INDEX_ENTRY_BYTES * sum(counts.values()) + _INDEX_HEADER_BYTES * len(chunk.counts)
    times: dict[int, list[int]] = {}
    begin = chunk.index or _index_of(read, chunk)
    if 0 < chunk.end - begin <= most:
        parser = "index_times" if chunk.index is None else "mcap_index_times"
        found = parsed(parser, read(begin, chunk.end - begin), begin)
        times = {connection: each for connection, each in found.items() if each}
    inside = all(
        chunk.start_time <= time <= chunk.end_time for found in times.values() for time in found
    )
    if not inside or {connection: len(found) for connection, found in times.items()} != counts:
        raise BagError(
            "BagUnreadable", f"the chunk at byte {chunk.offset} has no index of all its messages"
        )
    return times


def _index_of(read: Read, chunk: Chunk) -> int:
    """Where a bag's chunk says that its index records begin; its end where it does not."""
    head = read(chunk.offset, min(_CHUNK_HEADER_BYTES, chunk.end - chunk.offset))
    length: int | None = parsed("chunk_length", head, chunk.offset)
    return chunk.end if length is None else chunk.offset + length


def split_record(data: bytes, at: int, base: int) -> tuple[dict[str, bytes], int, int]:
    """(header fields, begin and end of the body) of the record at `at`; `base` is for errors.

    Raises BagError where the record is cut.
    """
    split: tuple[dict[str, bytes], int, int] = parsed("split_record", data, at, base)
    return split


def connection_fields(record: bytes, offset: int) -> dict[str, bytes]:
    """What a CONNECTION record says of its publisher: type, md5sum, message_definition, ..."""
    fields: dict[str, bytes] = parsed("connection_fields", record, offset)
    return fields


def parsed(parser: str, *given: Any, user: str = "reading a bag") -> Any:
    """What the native module's parser of that name says; `user` is what needs it.

    Raises BagError.
    """
    parse = native(parser, user)
    try:
        return parse(*given)
    except native("TailError", user) as refused:
        reason, sentence = refused.args
        raise BagError(reason, sentence) from None
