"""Planning over MCAP: as over a bag of the same messages, and every file that can't be planned."""

import io
import struct
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType, IndexType, Writer

from bagpipe.native import native
from bagpipe.plan.bag_tail import BagError, BagTail, compression_of, message_times, read_tail
from bagpipe.plan.fragments import cut
from bagpipe.plan.framing import framing
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.mcap_of_bag import COMPRESSIONS, mcap_of
from tests.unit.bagpipe.bags import Recorded, steady, write_bag

SECOND = 1_000_000_000
REINDEX = "(`bagpipe bag reindex BAG --to NEW`)"


def tail_of(data: bytes) -> BagTail:
    return read_tail(lambda offset, length: data[offset : offset + length], len(data))


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """200 messages of /scan over two seconds and a latched /map, in small chunks."""
    messages = [*steady("/scan", 200, 10_000_000), Recorded("/map", 2_500_000_000, "m", True)]
    messages.sort(key=lambda message: message.time)
    folder = tmp_path_factory.mktemp("bags")
    return write_bag(folder / "two.bag", messages, chunk_bytes=2048)


@pytest.mark.parametrize("compression", sorted(COMPRESSIONS))
def test_it_says_what_the_bag_of_the_same_messages_says(bag: Path, compression: str) -> None:
    data = mcap_of(bag, bag.with_suffix(f".{compression}"), compression, 2048).read_bytes()
    ours, other = tail_of(data), tail_of(bag.read_bytes())
    named = [(c.topic, c.datatype, c.in_force, c.encoding) for c in ours.connections]
    assert named == [
        ("/scan", "std_msgs/String", 0, "ros1"),
        ("/map", "std_msgs/String", 1, "ros1"),
    ]
    assert [c.caller_id for c in ours.connections] == [c.caller_id for c in other.connections]
    assert len(ours.chunks) > 3
    times: dict[str, list[int]] = {}
    topics = {c.id: c.topic for c in ours.connections}
    read = lambda offset, length: data[offset : offset + length]  # noqa: E731
    for chunk in ours.chunks:
        assert compression_of(read, chunk) == compression
        for number, found in message_times(read, chunk).items():
            times.setdefault(topics[number], []).extend(found)
    assert times["/map"] == [2_500_000_000]
    assert times["/scan"] == [SECOND + i * 10_000_000 for i in range(200)]


def test_it_reads_the_head_the_footer_and_the_summary(bag: Path, tmp_path: Path) -> None:
    data = mcap_of(bag, tmp_path / "a.mcap", "zstd", 2048).read_bytes()
    read: list[tuple[int, int]] = []

    def ranged(offset: int, length: int) -> bytes:
        read.append((offset, length))
        return data[offset : offset + length]

    tail = read_tail(ranged, len(data))
    assert len(read) == 3
    assert read[1] == (len(data) - 37, 37)
    assert tail.chunks[-1].end <= read[2][0]


@pytest.mark.parametrize("compression", sorted(COMPRESSIONS))
def test_a_fragment_is_mcap_that_its_own_library_reads(
    bag: Path, tmp_path: Path, compression: str
) -> None:
    data = mcap_of(bag, tmp_path / "a.mcap", compression, 2048).read_bytes()
    tail = tail_of(data)
    found = []
    for fragment in cut(tail, ["/scan"], SECOND // 2, 0):
        ranges = tail.declarations + fragment.ranges
        head, end = framing(ranges)
        assert head == b""
        part = b"".join([*(data[offset : offset + length] for offset, length in ranges), end])
        window = fragment.window
        for _, channel, message in NonSeekingReader(io.BytesIO(part)).iter_messages():
            if channel.topic == "/scan" and window.start <= message.log_time < window.end:
                found.append(message.log_time)
    assert found == [SECOND + i * 10_000_000 for i in range(200)]


def written(encoding: str = "ros1", **options: Any) -> bytes:
    """Ten messages of /a, which are nothing, and none of /silent."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=64, compression=CompressionType.NONE, **options)
    writer.start()
    schema = writer.register_schema(name="a/B", encoding="ros1msg", data=b"string data")
    channel = writer.register_channel(topic="/a", message_encoding=encoding, schema_id=schema)
    writer.register_channel(topic="/silent", message_encoding="json", schema_id=schema)
    for number in range(10):
        writer.add_message(channel, number, b"\0\0\0\0", number)
    writer.finish()
    return stream.getvalue()


def without_summary(data: bytes) -> bytes:
    """The footer states that there is none."""
    return data[:-28] + bytes(20) + data[-8:]


def reindexed(data: bytes, folder: Path) -> bytes:
    """What `bagpipe bag reindex` makes of a recording."""
    (folder / "old.mcap").write_bytes(data)
    made, _, _ = native("mend_recording", "this test")(
        folder / "old.mcap", compression="none", memory=1 << 20
    )
    return bytes(made)


def planned_messages(data: bytes) -> int:
    """How many messages the chunks have that fragments are planned by."""
    return sum(sum(chunk.counts.values()) for chunk in tail_of(data).chunks)


@pytest.mark.parametrize(
    ("data", "reason", "words"),
    [
        (written()[:-1], "BagCut", "no footer at byte"),
        (written()[:200], "BagCut", "its recorder was stopped"),
        (written()[:11], "BagCut", "byte 8"),
        (b"\x89MCAP0\r\n", "BagCut", "byte 8"),
        (written(use_chunking=False), "BagNotIndexed", REINDEX),
        (written(index_types=IndexType.CHUNK), "BagNotIndexed", REINDEX),
        (written(repeat_channels=False), "BagNotIndexed", "does not declare channel 1"),
        (b"\x89MCAP1\r\n" + bytes(100), "BagUnreadable", "(MCAP)"),
    ],
    ids=[
        "one-byte-short", "cut", "cut-in-its-head", "magic-alone", "unchunked", "no-message-index",
        "no-channels", "another-version",
    ],
)  # fmt: skip
def test_what_cant_be_planned_has_a_reason_and_a_place(
    data: bytes, reason: str, words: str
) -> None:
    with pytest.raises(BagError) as caught:
        tail_of(data)
    assert caught.value.reason == reason
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("data", "messages"),
    [
        (written()[:-1], 10),
        (written()[:400], 3),
        (written(use_chunking=False), 10),
        (written(index_types=IndexType.CHUNK), 10),
        (written(repeat_channels=False), 10),
        (without_summary(written()), 10),
        (written()[:-12] + b"\1" + written()[-11:], 10),
    ],
    ids=[
        "one-byte-short", "cut", "unchunked", "no-message-index", "no-channels", "no-summary",
        "another-crc",
    ],
)  # fmt: skip
def test_what_cant_be_planned_can_be_once_it_is_reindexed(
    data: bytes, messages: int, tmp_path: Path
) -> None:
    with pytest.raises(BagError):
        tail_of(data)
    assert planned_messages(reindexed(data, tmp_path)) == messages


def test_a_chunk_index_that_lies_is_refused() -> None:
    data = bytearray(written(enable_crcs=False))
    tail = tail_of(bytes(data))
    place = data.index(struct.pack("<Q", tail.chunks[0].offset), tail.chunks[-1].end)
    data[place : place + 8] = struct.pack("<Q", len(data))
    with pytest.raises(BagError, match="chunk") as caught:
        tail_of(bytes(data))
    assert caught.value.reason == "BagUnreadable"


def test_a_summary_with_another_checksum_is_refused() -> None:
    data = bytearray(written())
    data[tail_of(bytes(data)).chunks[-1].end + 40] ^= 1
    with pytest.raises(BagError, match="the CRC-32 that the footer states") as caught:
        tail_of(bytes(data))
    assert caught.value.reason == "BagUnreadable"


def spec_over(name: str, engine: str, **source: Any) -> SimulationJobSpec:
    fields: dict[str, Any] = {
        "source": {"bags": [f"pvc://drives/{name}"], **source},
        "stack": {"image": "stack", "engine": engine, "command": ["run"]},
        "output": {"uri": "pvc://results/a"},
    }
    if engine == "ros1":
        fields["record"] = {"topics": ["/b"]}
    return SimulationJobSpec.model_validate(fields)


def test_messages_that_the_engine_cant_play_are_refused_before_any_case(tmp_path: Path) -> None:
    (tmp_path / "ros2.mcap").write_bytes(written("cdr"))
    storage = Storage({"drives": str(tmp_path)})
    refused = plan(spec_over("ros2.mcap", "ros1"), storage)
    assert refused.cases == []
    (unplanned,) = refused.unplanned
    assert unplanned.reason == "BagUnreadable"
    assert "/a holds messages in cdr, and the stack would read them as ros1" in unplanned.message
    # A program that judges itself is given the file's own bytes.
    assert len(plan(spec_over("ros2.mcap", "exec"), storage).cases) == 1


def test_a_publisher_without_a_message_is_no_reason_to_refuse(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(written())
    planned = plan(spec_over("a.mcap", "ros1"), Storage({"drives": str(tmp_path)}))
    assert [case.id for case in planned.cases] == ["a-0000"]
