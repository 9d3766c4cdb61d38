"""MCAP written record by record: files that MCAP's own library does not write."""

import struct
from collections.abc import Mapping, Sequence

MAGIC = b"\x89MCAP0\r\n"
Times = list[int]


def record(op: int, content: bytes) -> bytes:
    return struct.pack("<BQ", op, len(content)) + content


def text(content: bytes) -> bytes:
    return struct.pack("<I", len(content)) + content


HEAD = MAGIC + record(1, text(b"ros1") + text(b"tests"))
SCHEMA = record(
    3, struct.pack("<H", 1) + text(b"std_msgs/String") + text(b"ros1msg") + text(b"string data\n")
)


def channel(number: int, topic: str, encoding: str = "ros1", schema: int = 1) -> bytes:
    words = text(topic.encode()) + text(encoding.encode())
    return record(4, struct.pack("<HH", number, schema) + words + text(b""))


def message(number: int, time: int) -> bytes:
    return record(5, struct.pack("<HIQQ", number, 0, time, time) + text(b"m"))


def chunk(times: Mapping[int, Times], before: bytes = b"") -> tuple[bytes, bytes, tuple[int, int]]:
    """A chunk of messages of each channel, its message indexes, and its times (0 without any)."""
    records, indexes = before, b""
    for number, logged in times.items():
        entries = b""
        for time in logged:
            entries += struct.pack("<QQ", time, len(records))
            records += message(number, time)
        indexes += record(7, struct.pack("<H", number) + text(entries))
    every = [time for logged in times.values() for time in logged] or [0]
    span = (min(every), max(every))
    fields = struct.pack("<QQQI", *span, len(records), 0) + text(b"")
    return record(6, fields + struct.pack("<Q", len(records)) + records), indexes, span


def chunk_index(
    offset: int, made: tuple[bytes, bytes, tuple[int, int]], numbers: list[int]
) -> bytes:
    data, indexes, span = made
    places, at = b"", 0
    for number in numbers:
        places += struct.pack("<HQ", number, offset + len(data) + at)
        at += 9 + 2 + 4 + struct.unpack_from("<I", indexes, at + 11)[0]
    fields = struct.pack("<QQQQ", *span, offset, len(data)) + text(places)
    return record(8, fields + struct.pack("<Q", len(indexes)) + text(b"") + bytes(16))


def mcap(
    chunks: Sequence[Mapping[int, Times]],
    channels: list[bytes],
    behind: bytes = b"",
    statistics: bool = True,
    before: bytes = b"",
) -> bytes:
    """A file of those chunks, `behind` which the data goes on; every chunk begins with `before`."""
    data, index, messages = HEAD, b"", 0
    for times in chunks:
        made = chunk(times, before)
        index += chunk_index(len(data), made, list(times))
        data += made[0] + made[1]
        messages += sum(len(logged) for logged in times.values())
    data += behind + record(15, bytes(4))
    summary = SCHEMA + b"".join(channels) + index
    if statistics:
        counted = struct.pack("<QHIIIIQQ", messages, 1, len(channels), 0, 0, len(chunks), 0, 0)
        summary += record(11, counted + text(b""))
    return data + summary + record(2, struct.pack("<QQI", len(data), 0, 0)) + MAGIC
