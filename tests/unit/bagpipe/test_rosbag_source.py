"""The rosbag data source without Spark: plans from the tail, reads what a library wrote."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from bagpipe.plan.bag_tail import read_tail
from bagpipe.rosbag_source import RosbagReader
from bagpipe.rosbag_source.columns import Decoder
from bagpipe.rosbag_source.messages import messages
from bagpipe.rosbag_source.planning import OptionError, parse_options, plan, topic_type
from bagpipe.storage import Stat, Storage, StorageError
from bagpipe.storage.local import LocalBackend
from tests.unit.bagpipe.bags import Recorded, write_bag

SECOND = 1_000_000_000
STORE = get_typestore(Stores.ROS1_NOETIC)


@dataclasses.dataclass
class Asked:
    """What was asked of the file system: looks at files, and the bytes from begin to end."""

    stats: list[str] = dataclasses.field(default_factory=list)
    ranges: list[tuple[int, int]] = dataclasses.field(default_factory=list)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Asked:
    """Every request of the test, as a remote storage would get it."""
    found = Asked()
    stat, read = LocalBackend.stat, LocalBackend.read

    def counted_stat(backend: LocalBackend, path: str) -> Stat:
        found.stats.append(path)
        return stat(backend, path)

    def counted_read(
        backend: LocalBackend, path: str, offset: int, length: int, version: str
    ) -> bytes:
        found.ranges.append((offset, offset + length))
        return read(backend, path, offset, length, version)

    monkeypatch.setattr(LocalBackend, "stat", counted_stat)
    monkeypatch.setattr(LocalBackend, "read", counted_read)
    return found


def chunked_bag(path: Path) -> Path:
    """100 s at 10 Hz on /a and 1 Hz on /b, in chunks of a few KiB."""
    recorded = [
        Recorded("/b" if number % 10 == 9 else "/a", 1 + number * SECOND // 10, "x" * 200)
        for number in range(1000)
    ]
    return write_bag(path, recorded, chunk_bytes=8192)


def options(path: Path, **given: Any) -> Any:
    return parse_options({"path": f"file://{path}", **{k: str(v) for k, v in given.items()}})


def test_planning_reads_no_payload(tmp_path: Path, asked: Asked) -> None:
    bag = chunked_bag(tmp_path / "a.bag")
    fragments = plan(options(bag, fragment=10), Storage({}))
    assert len(fragments) == 10
    ranges = list(asked.ranges)
    assert (len(asked.stats), len(ranges)) == (2, 3)
    size = bag.stat().st_size
    tail = read_tail(lambda at, n: Storage({}).read(f"file://{bag}", at, n), size)
    first, last = tail.chunks[0].offset, tail.chunks[-1].end
    payload = sum(max(0, min(end, last) - max(begin, first)) for begin, end in ranges)
    # The head is read 4 KiB and some bytes far, as the format pads it; chunks begin right behind.
    assert payload <= 64 + 13
    assert sum(end - begin for begin, end in ranges) < size / 4


@pytest.mark.parametrize("topics", ["", "/t7,/t12"])
def test_the_requests_of_planning_do_not_grow_with_the_topics(
    tmp_path: Path, asked: Asked, monkeypatch: pytest.MonkeyPatch, topics: str
) -> None:
    # Neighbours share a request, as on remote storage.
    monkeypatch.setattr(LocalBackend, "gap_bytes", 256 << 10)
    recorded = [Recorded(f"/t{number % 20}", 1 + number, "x") for number in range(100)]
    bag = write_bag(tmp_path / "a.bag", recorded)
    (fragment,) = plan(options(bag, **({"topics": topics} if topics else {})), Storage({}))
    assert sorted(kind.topic for kind in fragment.types.values()) == sorted(
        topics.split(",") if topics else (f"/t{number}" for number in range(20))
    )
    assert all(kind.type == "std_msgs/String" for kind in fragment.types.values())
    # Whether it is there, and its size and version; its head, its index, its connections.
    assert (len(asked.stats), len(asked.ranges)) == (2, 3)


def test_every_message_is_in_one_fragment(tmp_path: Path) -> None:
    bag = chunked_bag(tmp_path / "a.bag")
    storage = Storage({})
    times = [
        message.time
        for fragment in plan(options(bag, fragment=7), storage)
        for message in messages(fragment, storage)
    ]
    assert sorted(times) == [1 + number * SECOND // 10 for number in range(1000)]


def test_topics_and_times_narrow_what_is_read(tmp_path: Path) -> None:
    bag = chunked_bag(tmp_path / "a.bag")
    chosen = options(bag, topics="b", start=20 * SECOND, end=30 * SECOND, fragment=10)
    fragments = plan(chosen, Storage({}))
    found = [m for fragment in fragments for m in messages(fragment, Storage({}))]
    assert [m.kind.topic for m in found] == ["/b"] * 10
    assert all(20 * SECOND <= m.time < 30 * SECOND for m in found)
    chunks = sum(len(fragment.chunks) for fragment in fragments)
    assert chunks < len(plan(options(bag, fragment=1000), Storage({}))[0].chunks) / 5


def test_batches_are_bounded(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "a.bag", (Recorded("/a", 1 + n, "x" * 2_000_000) for n in range(12)))
    reader = RosbagReader(options(bag))
    rows = [batch.num_rows for part in reader.partitions() for batch in reader.read(part)]
    assert rows == [5, 5, 2]


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_compressed_chunks_are_read(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "a.bag"
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat[compression.upper()])
    with writer:
        connection = writer.add_connection("/a", "std_msgs/msg/String", typestore=STORE)
        text = STORE.types["std_msgs/msg/String"]("hello")
        data = bytes(STORE.serialize_ros1(text, "std_msgs/msg/String"))
        writer.write(connection, 5, data)
    (fragment,) = plan(options(path), Storage({}))
    assert [(m.time, m.data) for m in messages(fragment, Storage({}))] == [(5, data)]


def test_a_damaged_chunk_is_named_with_its_byte(tmp_path: Path) -> None:
    bag = chunked_bag(tmp_path / "a.bag")
    offset = plan(options(bag, fragment=1000), Storage({}))[0].chunks[3][0]
    with bag.open("r+b") as file:
        file.seek(offset + 4)
        file.write(b"\xff" * 8)
    (fragment,) = plan(options(bag, fragment=1000), Storage({}))
    with pytest.raises(StorageError, match=rf"a\.bag.*byte {offset}"):
        list(messages(fragment, Storage({})))


def test_a_bag_that_was_replaced_since_it_was_planned_is_refused(tmp_path: Path) -> None:
    bag = chunked_bag(tmp_path / "a.bag")
    (fragment,) = plan(options(bag, fragment=1000), Storage({}))
    other = write_bag(tmp_path / "b.bag", [Recorded("/a", 1, "y" * 1_000_000)])
    other.replace(bag)
    with pytest.raises(StorageError, match=r"a\.bag is no longer the file that was planned"):
        next(messages(fragment, Storage({})))


def test_options_are_refused_with_what_to_write(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="exactly one topic"):
        options(tmp_path, decode="true")
    with pytest.raises(OptionError, match="integers of ns"):
        options(tmp_path, start="yesterday")
    with pytest.raises(OptionError, match="needs a path"):
        parse_options({})
    with pytest.raises(StorageError, match="names no bag"):
        plan(options(tmp_path / "*.bag"), Storage({}))


def test_a_decoded_message_has_the_values_that_were_written(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    kinds = STORE.types
    time = kinds["builtin_interfaces/msg/Time"](sec=7, nanosec=8)
    header = kinds["std_msgs/msg/Header"](seq=2**32 - 1, stamp=time, frame_id="lidar ü")
    field = kinds["sensor_msgs/msg/PointField"](name="x", offset=4, datatype=7, count=1)
    cloud = kinds["sensor_msgs/msg/PointCloud2"](
        header, 1, 2, [field, field], False, 8, 16, np.arange(16, dtype=np.uint8), True
    )
    with Writer(path) as writer:
        connection = writer.add_connection("/c", cloud.__msgtype__, typestore=STORE)
        writer.write(connection, 5, STORE.serialize_ros1(cloud, cloud.__msgtype__))
    chosen = options(path, topics="/c", decode="true")
    kind = topic_type(chosen, Storage({}))
    assert (kind.type, kind.md5sum) == (
        "sensor_msgs/PointCloud2",
        "1158d486dd51d683ce2f1be655c3c181",
    )
    assert "point_step" in Decoder(kind).column.spark.simpleString()
    reader = RosbagReader(chosen)
    (batch,) = reader.read(reader.partitions()[0])
    (row,) = batch.to_pylist()
    assert row["message"] == {
        "header": {"seq": 2**32 - 1, "stamp": 7 * SECOND + 8, "frame_id": "lidar ü"},
        "height": 1,
        "width": 2,
        "fields": [{"name": "x", "offset": 4, "datatype": 7, "count": 1}] * 2,
        "is_bigendian": False,
        "point_step": 8,
        "row_step": 16,
        "data": bytes(range(16)),
        "is_dense": True,
    }


@pytest.mark.parametrize("seconds", ["0", "-1", "1e-10", "nan", "inf"])
def test_a_fragment_of_no_length_is_refused(tmp_path: Path, seconds: str) -> None:
    with pytest.raises(OptionError, match="rosbag: fragment is "):
        options(tmp_path / "a.bag", fragment=seconds)
    assert options(tmp_path / "a.bag", fragment="1e-9").fragment == 1
