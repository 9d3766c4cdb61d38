"""What a bag's tail says: which chunks hold which times, without reading a payload.

Format: bag 2.0, http://wiki.ros.org/Bags/Format/2.0. The file header record names
`index_pos`; from there to the end lie the CONNECTION records and one CHUNK_INFO per chunk.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass

MAGIC = b"#ROSBAG V2.0\n"
_FILE_HEADER_BYTES = 4096
_OP_FILE_HEADER, _OP_INDEX, _OP_CHUNK_INFO, _OP_CONNECTION = 3, 4, 6, 7
_MAX_TAIL_BYTES = 1 << 30
# op, compression and size, each with its name and length, are some 50 bytes.
_CHUNK_HEADER_BYTES = 256
# An index record has a time and an offset for each message, and a header of some 60 bytes.
_INDEX_ENTRY, _INDEX_HEADER_BYTES = struct.Struct("<III"), 128

Read = Callable[[int, int], bytes]


class BagError(Exception):
    """A bag that can't be planned; `reason` is CamelCase, the sentence names the byte offset."""

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason


@dataclass(frozen=True)
class Connection:
    """One recorded publisher of a topic; its record lies `length` bytes from `offset`."""

    id: int
    topic: str
    datatype: str
    caller_id: str
    latching: bool
    offset: int
    length: int


@dataclass(frozen=True)
class Chunk:
    """One chunk: bytes `offset` to `end` of the file; times in ns; messages per connection."""

    offset: int
    end: int
    start_time: int
    end_time: int
    counts: dict[int, int]


@dataclass(frozen=True)
class BagTail:
    """All that planning needs to know of a bag of `size` bytes."""

    size: int
    connections: list[Connection]
    chunks: list[Chunk]


def read_tail(read: Read, size: int) -> BagTail:
    """Read a bag's first 4 KiB and its tail by `read(offset, length)`.

    Raises BagError with the reason BagEmpty, BagUnreadable, BagCut or BagNotIndexed.
    """
    if size == 0:
        raise BagError("BagEmpty", "the file is empty (0 bytes)")
    head = read(0, min(_FILE_HEADER_BYTES + len(MAGIC) + 64, size))
    if not head.startswith(MAGIC):
        raise BagError(
            "BagUnreadable", f"the file begins with {head[:13]!r}, expected {MAGIC!r} (bag 2.0)"
        )
    header = _file_header(head)
    index_position = _u64(header, "index_pos", len(MAGIC))
    if header.get("encryptor"):
        raise BagError("BagUnreadable", "the bag is encrypted: decrypt it with rosbag decrypt")
    if index_position == 0:
        raise BagError(
            "BagNotIndexed", "the bag has no index (its recorder was stopped): run rosbag reindex"
        )
    if not len(MAGIC) <= index_position <= size:
        raise BagError(
            "BagCut",
            f"the bag is cut: its index should be at byte {index_position},"
            f" but the file ends at byte {size}: copy it again, or run rosbag reindex",
        )
    if size - index_position > _MAX_TAIL_BYTES:
        raise BagError("BagUnreadable", f"the index at byte {index_position} is above 1 GiB")
    tail = read(index_position, size - index_position)
    return _parse_tail(tail, index_position, size, _counts(header))


def compression_of(read: Read, chunk: Chunk) -> str:
    """A chunk's compression (none, lz4 or bz2), from its header alone. Raises BagError."""
    data = read(chunk.offset, min(_CHUNK_HEADER_BYTES, chunk.end - chunk.offset))
    header, _ = _sized(data, 0, chunk.offset)
    return _fields(header, chunk.offset).get("compression", b"").decode(errors="replace")


def message_times(read: Read, chunk: Chunk) -> dict[int, list[int]]:
    """Times in ns of a chunk's messages for each connection, from the index records behind it.

    Raises BagError where these are not what the chunk's counts say.
    """
    head = read(chunk.offset, min(_CHUNK_HEADER_BYTES, chunk.end - chunk.offset))
    _, at = _sized(head, 0, chunk.offset)
    begin = chunk.offset + at + 4 + int.from_bytes(head[at : at + 4], "little")
    counts = {connection: count for connection, count in chunk.counts.items() if count}
    most = _INDEX_ENTRY.size * sum(counts.values()) + _INDEX_HEADER_BYTES * len(counts)
    times: dict[int, list[int]] = {}
    if 0 < chunk.end - begin <= most:
        for operation, header, _, body, offset in _records(
            read(begin, chunk.end - begin), begin, 0
        ):
            if operation == _OP_INDEX and len(body) % _INDEX_ENTRY.size == 0:
                times.setdefault(_u32(header, "conn", offset), []).extend(
                    seconds * 1_000_000_000 + nanoseconds
                    for seconds, nanoseconds, _ in _INDEX_ENTRY.iter_unpack(body)
                )
    inside = all(
        chunk.start_time <= time <= chunk.end_time for found in times.values() for time in found
    )
    if not inside or {connection: len(found) for connection, found in times.items()} != counts:
        raise BagError(
            "BagUnreadable", f"the chunk at byte {chunk.offset} has no index of all its messages"
        )
    return times


def _file_header(head: bytes) -> dict[str, bytes]:
    for operation, header, _length, _data, _offset in _records(head, 0, len(MAGIC)):
        if operation != _OP_FILE_HEADER:
            raise BagError(
                "BagUnreadable", f"byte {len(MAGIC)} holds op {operation}, expected op 3"
            )
        return header
    raise BagError("BagUnreadable", f"no file header record at byte {len(MAGIC)}")


def _counts(header: dict[str, bytes]) -> tuple[int, int]:
    return _u32(header, "conn_count", len(MAGIC)), _u32(header, "chunk_count", len(MAGIC))


def _parse_tail(tail: bytes, base: int, size: int, expected: tuple[int, int]) -> BagTail:
    connections: list[Connection] = []
    infos: list[tuple[int, int, int, dict[int, int]]] = []
    for operation, header, length, data, offset in _records(tail, base, 0):
        if operation == _OP_CONNECTION:
            connections.append(_connection(header, length, data, offset))
        elif operation == _OP_CHUNK_INFO:
            infos.append(_chunk_info(header, data, offset))
        else:
            raise BagError("BagUnreadable", f"byte {offset} of the index holds op {operation}")
    if (len(connections), len(infos)) != expected:
        raise BagError(
            "BagCut",
            f"the bag is cut: its index at byte {base} holds {len(connections)} connections and"
            f" {len(infos)} chunks, its header counts {expected[0]} and {expected[1]}:"
            " copy it again, or run rosbag reindex",
        )
    if not infos or not any(sum(counts.values()) for _, _, _, counts in infos):
        raise BagError("BagEmpty", "the bag holds no messages")
    return BagTail(size, connections, _chunks(infos, base))


def _connection(header: dict[str, bytes], length: int, data: bytes, offset: int) -> Connection:
    fields = _fields(data, offset)
    return Connection(
        id=_u32(header, "conn", offset),
        topic=resolve(header.get("topic", b"").decode(errors="replace")),
        datatype=fields.get("type", b"").decode(errors="replace"),
        caller_id=fields.get("callerid", b"").decode(errors="replace"),
        latching=fields.get("latching", b"0") == b"1",
        offset=offset,
        length=length,
    )


def resolve(topic: str) -> str:
    """A recorded topic as the ROS graph knows it: with its leading slash."""
    return topic if topic.startswith("/") else f"/{topic}"


def _chunk_info(
    header: dict[str, bytes], data: bytes, offset: int
) -> tuple[int, int, int, dict[int, int]]:
    position = _u64(header, "chunk_pos", offset)
    count = _u32(header, "count", offset)
    if len(data) != count * 8:
        raise BagError(
            "BagUnreadable", f"chunk info at byte {offset}: {len(data)} bytes for {count} counts"
        )
    counts = dict(struct.iter_unpack("<II", data))
    times = _time(header, "start_time", offset), _time(header, "end_time", offset)
    return position, times[0], times[1], counts


def _chunks(infos: list[tuple[int, int, int, dict[int, int]]], end: int) -> list[Chunk]:
    """Chunks in the file's order; each ends where the next begins, its index records included."""
    ordered = sorted(infos, key=lambda info: info[0])
    ends = [position for position, *_ in ordered[1:]] + [end]
    chunks = []
    for (position, start, stop, counts), until in zip(ordered, ends, strict=True):
        if not len(MAGIC) <= position < until <= end:
            raise BagError(
                "BagUnreadable", f"the index names a chunk at byte {position}, outside the file"
            )
        chunks.append(Chunk(position, until, start, stop, counts))
    return chunks


def _records(
    data: bytes, base: int, at: int
) -> Iterator[tuple[int, dict[str, bytes], int, bytes, int]]:
    """(op, header, length of the whole record, data, offset in the file) of each record."""
    while at < len(data):
        begin = at
        header_bytes, at = _sized(data, at, base)
        header = _fields(header_bytes, base + begin)
        operation = header.get("op", b"")
        if len(operation) != 1:
            raise BagError("BagUnreadable", f"the record at byte {base + begin} has no op")
        if operation[0] == _OP_FILE_HEADER:
            yield operation[0], header, 0, b"", base + begin
            return
        body, at = _sized(data, at, base)
        yield operation[0], header, at - begin, body, base + begin


def _sized(data: bytes, at: int, base: int) -> tuple[bytes, int]:
    if at + 4 > len(data):
        raise BagError(
            "BagCut", f"the bag is cut: a record's length is missing at byte {base + at}"
        )
    (length,) = struct.unpack_from("<I", data, at)
    end = at + 4 + length
    if end > len(data):
        raise BagError(
            "BagCut",
            f"the bag is cut: the record at byte {base + at} needs {length} bytes,"
            f" {len(data) - at - 4} are left",
        )
    return data[at + 4 : end], end


def _fields(data: bytes, offset: int) -> dict[str, bytes]:
    fields: dict[str, bytes] = {}
    at = 0
    while at < len(data):
        field, at = _sized(data, at, offset)
        name, separator, value = field.partition(b"=")
        if not separator:
            raise BagError("BagUnreadable", f"a header field without '=' near byte {offset}")
        fields[name.decode(errors="replace")] = value
    return fields


def _integer(header: dict[str, bytes], name: str, offset: int, layout: str) -> tuple[int, ...]:
    value = header.get(name)
    if value is None or len(value) != struct.calcsize(layout):
        raise BagError("BagUnreadable", f"the record at byte {offset} has no valid {name}")
    return struct.unpack(layout, value)


def _u32(header: dict[str, bytes], name: str, offset: int) -> int:
    return _integer(header, name, offset, "<I")[0]


def _u64(header: dict[str, bytes], name: str, offset: int) -> int:
    return _integer(header, name, offset, "<Q")[0]


def _time(header: dict[str, bytes], name: str, offset: int) -> int:
    seconds, nanoseconds = _integer(header, name, offset, "<II")
    return seconds * 1_000_000_000 + nanoseconds


def split_record(data: bytes, at: int, base: int) -> tuple[dict[str, bytes], int, int]:
    """(header fields, begin and end of the body) of the record at `at`; `base` is for errors.

    Raises BagError where the record is cut.
    """
    header, body = _sized(data, at, base)
    _, end = _sized(data, body, base)
    return _fields(header, base + at), body + 4, end


def connection_fields(record: bytes, offset: int) -> dict[str, bytes]:
    """What a CONNECTION record says of its publisher: type, md5sum, message_definition, ..."""
    _, begin, end = split_record(record, 0, offset)
    return _fields(record[begin:end], offset)
