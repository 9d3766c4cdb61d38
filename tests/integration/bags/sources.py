"""Bags as other recorders could have written them: fields in any order, chunks of any size."""

import bz2
import hashlib
import random
import struct
from collections.abc import Iterable
from dataclasses import dataclass, field

import lz4.frame

from tests.integration.bags.readers import ReadMessage, read_message

SECOND = 1_000_000_000
TYPES = {"std_msgs/String": "string data\n", "lab_msgs/Blob": "uint8[] data\n"}
# A topic has one type, however many publish it.
NAMES = {"/scan": "std_msgs/String", "/tf_static": "lab_msgs/Blob", "odom": "std_msgs/String"}
Fields = list[tuple[str, bytes]]


@dataclass(frozen=True)
class Topic:
    """A connection of a bag."""

    id: int
    name: str
    type: str
    callerid: str | None
    latching: bool

    @property
    def md5sum(self) -> str:
        return hashlib.md5(TYPES[self.type].strip().encode()).hexdigest()  # noqa: S324  the format's

    def as_read(self, time: int, data: bytes) -> ReadMessage:
        header = (self.callerid, self.latching, self.type, self.md5sum, TYPES[self.type])
        return read_message(self.name, time, data, header)


@dataclass
class Source:
    """A bag's bytes, and its messages in its own order: by time, then by place."""

    data: bytes
    index_position: int
    in_order: bool
    messages: list[tuple[Topic, int, bytes]]

    def as_read(self) -> list[ReadMessage]:
        return [topic.as_read(time, data) for topic, time, data in self.messages]

    def sliced(self, start: int, end: int) -> list[ReadMessage]:
        """What a slice holds: the window, and at its start what each publisher latched before.

        Publishers without names are distinguished by their connections.
        """
        latched = {
            (topic.name, topic.callerid or topic.id): (topic, data)
            for topic, time, data in self.messages
            if topic.latching and time < start
        }
        before = [topic.as_read(start, data) for topic, data in latched.values()]
        inside = [m for m in self.messages if start <= m[1] < end]
        return before + [topic.as_read(time, data) for topic, time, data in inside]


@dataclass
class Recorder:
    """Writes records; `shuffled` gives every header an order of its own, else all keep one."""

    rng: random.Random
    shuffled: bool
    out: bytearray = field(default_factory=bytearray)
    orders: dict[tuple[str, ...], list[int]] = field(default_factory=dict)

    def header(self, fields: Fields) -> bytes:
        names = tuple(sorted(name for name, _ in fields))
        order = self.orders.get(names)
        if order is None or self.shuffled:
            order = self.rng.sample(range(len(fields)), len(fields))
            self.orders[names] = order
        pairs = (fields[at] for at in order)
        made = b"".join(sized(name.encode() + b"=" + value) for name, value in pairs)
        return sized(made)

    def record(self, fields: Fields, data: bytes) -> bytes:
        return self.header(fields) + sized(data)


def sized(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def u32(value: int) -> bytes:
    return struct.pack("<I", value)


def ros_time(time: int) -> bytes:
    return struct.pack("<II", *divmod(time, SECOND))


def packed(rng: random.Random, data: bytes, compression: str) -> bytes:
    if compression == "bz2":
        return bz2.compress(data)
    if compression == "lz4":
        # Only with these three as ROS's own LZ4 takes it.
        linked, checked, sized = rng.choice([(False, True, False), (True, False, True)])
        return bytes(
            lz4.frame.compress(
                data, block_linked=linked, content_checksum=checked, store_size=sized
            )
        )
    return data


def source(seed: int) -> Source:
    """A bag of random topics, messages, chunks and orders; the same for the same seed."""
    rng = random.Random(seed)  # noqa: S311
    topics = some_topics(rng)
    in_order = rng.random() < 0.7
    times = [SECOND * 1_000 + rng.randrange(40) * 100_000_000 + rng.randrange(3) for _ in range(
        rng.randrange(1, 150))]  # fmt: skip
    if in_order:
        times.sort()
    written = [(rng.choice(topics), time, some_data(rng)) for time in times]
    recorder = Recorder(rng, shuffled=rng.random() < 0.6)
    most = rng.choice([1, 3, 10, 50, 1000])
    chunks = list(cut(rng, written, most))
    out, index = whole(recorder, topics, chunks, rng.random() < 0.2)
    # By time; what has one time by its place in the bag.
    return Source(out, index, in_order, sorted(written, key=lambda message: message[1]))


def some_topics(rng: random.Random) -> list[Topic]:
    ids = sorted(rng.sample(range(12), rng.randrange(1, 5)))
    made = []
    for number in ids:
        name = rng.choice(list(NAMES))
        latching = name == "/tf_static" and rng.random() < 0.7
        made.append(
            Topic(number, name, NAMES[name], rng.choice([None, f"/node{number}"]), latching)
        )
    return made


def some_data(rng: random.Random) -> bytes:
    return sized(rng.randbytes(rng.choice([0, 3, 40, 900])).replace(b"\xff", b"."))


def cut(
    rng: random.Random, messages: list[tuple[Topic, int, bytes]], most: int
) -> Iterable[list[tuple[Topic, int, bytes]]]:
    at = 0
    while at < len(messages):
        count = rng.randrange(1, most + 1)
        yield messages[at : at + count]
        at += count


def whole(
    recorder: Recorder,
    topics: list[Topic],
    chunks: list[list[tuple[Topic, int, bytes]]],
    padded: bool,
) -> tuple[bytes, int]:
    """The bag's bytes, and where its tail begins."""
    body, infos = bytearray(), []
    declared: set[int] = set()
    first = 13 + 4096
    for messages in chunks:
        position = first + len(body)
        chunk, entries = chunk_of(recorder, messages, declared)
        compression = recorder.rng.choice(["none", "lz4", "bz2"])
        fields = [("op", b"\x05"), ("compression", compression.encode()), ("size", u32(len(chunk)))]
        body += recorder.record(fields, packed(recorder.rng, chunk, compression))
        for number, found in entries.items():
            index = [("op", b"\x04"), ("ver", u32(1)), ("conn", u32(number)),
                     ("count", u32(len(found) // 12))]  # fmt: skip
            # The format lets a recorder say more than it must.
            body += recorder.record([*index, ("note", b"more")] if padded else index, bytes(found))
        infos.append((position, messages, entries))
    tail = bytearray()
    for topic in topics:
        if topic.id in declared:
            tail += connection(recorder, topic)
    for position, messages, entries in infos:
        times = [time for _, time, _ in messages]
        counts = b"".join(u32(number) + u32(len(found) // 12) for number, found in entries.items())
        info = [("op", b"\x06"), ("ver", u32(1)), ("chunk_pos", struct.pack("<Q", position)),
                ("start_time", ros_time(min(times))), ("end_time", ros_time(max(times))),
                ("count", u32(len(entries)))]  # fmt: skip
        tail += recorder.record(info, counts)
    at = first + len(body)
    head = recorder.header([("op", b"\x03"), ("index_pos", struct.pack("<Q", at)),
                            ("conn_count", u32(len(declared))),
                            ("chunk_count", u32(len(chunks)))])  # fmt: skip
    head += sized(b" " * (4096 - 4 - len(head)))
    return b"#ROSBAG V2.0\n" + head + bytes(body) + bytes(tail), at


def chunk_of(
    recorder: Recorder, messages: list[tuple[Topic, int, bytes]], declared: set[int]
) -> tuple[bytes, dict[int, bytearray]]:
    chunk, entries = bytearray(), dict[int, bytearray]()
    for topic, time, data in messages:
        if topic.id not in declared:
            declared.add(topic.id)
            chunk += connection(recorder, topic)
        entry = ros_time(time) + u32(len(chunk))
        entries.setdefault(topic.id, bytearray()).extend(entry)
        fields = [("op", b"\x02"), ("conn", u32(topic.id)), ("time", ros_time(time))]
        chunk += recorder.record(fields, data)
    return bytes(chunk), entries


def connection(recorder: Recorder, topic: Topic) -> bytes:
    header = [("op", b"\x07"), ("conn", u32(topic.id)), ("topic", topic.name.encode())]
    inner = [
        ("topic", topic.name.encode()),
        ("type", topic.type.encode()),
        ("md5sum", topic.md5sum.encode()),
        ("message_definition", TYPES[topic.type].encode()),
    ]
    if topic.callerid is not None:
        inner.append(("callerid", topic.callerid.encode()))
    if topic.latching:
        inner.append(("latching", b"1"))
    return recorder.header(header) + recorder.header(inner)
