"""bagpipe.MemoryBag against rosbags, another author's reader and writer of the same format."""

import struct
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_typestore

import bagpipe
from bagpipe import BagError, MemoryBag
from bagpipe.native import NativeModuleError, native
from tests.recording import MESSAGES, fetch
from tests.unit.bagpipe.bags import Recorded, steady, write_bag

MD5SUM = "992ce8a1687cec8c8bd883ec73ca41d1"
SECOND = 1_000_000_000
ROS1 = get_typestore(Stores.ROS1_NOETIC)
FORMATS = {"none": None, "lz4": Writer.CompressionFormat.LZ4, "bz2": Writer.CompressionFormat.BZ2}
Seen = tuple[str, int, bytes]


def by_rosbags(path: Path) -> list[Seen]:
    with Reader(path) as reader:
        return [(each.topic, time, bytes(raw)) for each, time, raw in reader.messages()]


def ours(bag: MemoryBag) -> list[Seen]:
    return [(each.topic, time, bytes(raw)) for each, time, raw in bag.messages()]


def written(bag: MemoryBag, folder: Path) -> list[Seen]:
    """What rosbags reads of a bag of ours."""
    path = folder / "written.bag"
    path.write_bytes(bag.view())
    return by_rosbags(path)


def text(data: str) -> bytes:
    return struct.pack("<I", len(data)) + data.encode()


def put(writer: bagpipe.MemoryBagWriter, topic: str, time: int, raw: bytes) -> None:
    kind, definition = "std_msgs/String", "string data\n"
    writer.write(topic, time, raw, type=kind, md5sum=MD5SUM, definition=definition)


def filled(messages: Iterable[Seen], compression: str = "none") -> MemoryBag:
    writer = MemoryBag.writer(compression=compression)  # type: ignore[arg-type]
    for topic, time, raw in messages:
        put(writer, topic, time, raw)
    return writer.finish()


@pytest.fixture(scope="module", params=["none", "lz4", "bz2"])
def recorded(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two topics and a latched one, in many chunks of each compression."""
    path = tmp_path_factory.mktemp("recorded") / f"{request.param}.bag"
    messages = [*steady("/scan", 400, 10_000_000), *steady("/odom", 100, 40_000_000, SECOND + 7)]
    messages.append(Recorded("/map", SECOND + 5, "m", True))
    messages.sort(key=lambda each: each.time)
    writer = Writer(path)
    writer.chunk_threshold = 2048
    if compression := FORMATS[request.param]:
        writer.set_compression(compression)
    with writer:
        kind = "std_msgs/msg/String"
        connections = {
            topic: writer.add_connection(
                topic, kind, typestore=ROS1, callerid="/recorder", latching=int(topic == "/map")
            )
            for topic in ("/scan", "/odom", "/map")
        }
        for each in messages:
            raw = ROS1.serialize_ros1(ROS1.types[kind](each.text), kind)
            writer.write(connections[each.topic], each.time, raw)
    return path


def test_reads_what_rosbags_reads(recorded: Path) -> None:
    bag = MemoryBag.open(recorded)
    assert bag.compressions == [recorded.stem]
    assert (bag.message_count, bag.topics) == (501, ["/map", "/odom", "/scan"])
    assert bag.chunk_count > 8
    assert (bag.start, bag.end) == (SECOND, SECOND + 399 * 10_000_000)
    assert bag.damage is None
    assert ours(bag) == by_rosbags(recorded)
    with Reader(recorded) as reader:
        expected = [(c.id, c.topic, c.digest, c.msgdef.data) for c in reader.connections]
    found = [(c.id, c.topic, c.md5sum, c.definition) for c in bag.connections]
    assert sorted(found) == sorted(expected)
    latched = {c.topic: c.latching for c in bag.connections}
    assert latched == {"/scan": False, "/odom": False, "/map": True}
    assert {c.callerid for c in bag.connections} == {"/recorder"}
    assert {c.type for c in bag.connections} == {"std_msgs/String"}


def test_the_real_pr2_recording_and_rosbags_deserialises_its_messages() -> None:
    path = fetch()
    bag = MemoryBag(path.read_bytes())
    assert bag.message_count == MESSAGES == len(ours(bag))
    assert ours(bag) == by_rosbags(path)
    joints = [
        ROS1.deserialize_ros1(raw, "sensor_msgs/msg/JointState") for *_, raw in bag.messages()
    ]
    assert {len(getattr(each, "name", ())) for each in joints} == {42}
    assert bag.check().sound


def test_a_window_and_topics(recorded: Path) -> None:
    bag = MemoryBag.open(recorded)
    start, end = 2 * SECOND, 3 * SECOND
    expected = [e for e in by_rosbags(recorded) if start <= e[1] < end and e[0] == "/odom"]
    found = [(c.topic, time, bytes(raw)) for c, time, raw in bag.messages(["/odom"], start, end)]
    assert found == expected
    assert len(found) == 25
    assert list(bag.messages([])) == []
    assert list(bag.messages(start=end, end=end)) == []
    assert bag.messages(start=start, end=end).__length_hint__() == 125


def test_messages_of_one_time_keep_their_place_in_the_file() -> None:
    seen = [("/a", 5, text("second")), ("/b", 5, text("third")), ("/a", 4, text("first"))]
    assert ours(filled(seen)) == [seen[2], seen[0], seen[1]]


def test_rosbags_reads_slices(recorded: Path, tmp_path: Path) -> None:
    bag = MemoryBag.open(recorded)
    start, end = 2 * SECOND, 4 * SECOND
    inside = [each for each in by_rosbags(recorded) if start <= each[1] < end]
    # A latched message goes with the slice, at its start.
    assert ours(bag.slice(start, end)) == [("/map", start, text("m")), *inside]
    found = written(bag.slice(start, end), tmp_path)
    # rosbags has an order of its own for messages of one time.
    assert sorted(found) == sorted([("/map", start, text("m")), *inside])
    odom = [each for each in inside if each[0] == "/odom"]
    assert len(odom) == 50
    for compression in FORMATS:
        part = bag.slice(start, end, ["/odom"], compression=compression)  # type: ignore[arg-type]
        assert written(part, tmp_path) == odom
        assert part.compressions == [compression]
        assert part.check().sound


def test_rosbags_reads_merged_bags(recorded: Path, tmp_path: Path) -> None:
    bag = MemoryBag.open(recorded)
    middle = 3 * SECOND
    parts = [bag.slice(end=middle), bag.slice(middle, topics=["/scan", "/odom"])]
    for compression in FORMATS:
        merged = MemoryBag.merge(parts, compression=compression)  # type: ignore[arg-type]
        assert written(merged, tmp_path) == by_rosbags(recorded)
        assert merged.compressions == [compression]
    # What two bags declare alike is one connection.
    assert [c.topic for c in merged.connections] == ["/scan", "/odom", "/map"]


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    messages=st.lists(
        st.tuples(
            st.sampled_from(["/a", "/b", "/c/d"]),
            st.integers(0, 2**32 * SECOND - 1),
            st.binary(max_size=300),
        ),
        min_size=1,
        max_size=60,
    ),
    compression=st.sampled_from(sorted(FORMATS)),
)
def test_what_is_written_rosbags_reads(
    messages: list[Seen], compression: str, tmp_path: Path
) -> None:
    bag = filled(messages, compression)
    in_order = sorted(messages, key=lambda each: each[1])
    assert ours(bag) == in_order
    assert sorted(written(bag, tmp_path)) == sorted(messages)
    assert bag.check().sound
    assert ours(MemoryBag(bag.to_bytes())) == in_order


def test_connections_differ_in_every_field_of_their_headers() -> None:
    writer = MemoryBag.writer()
    plain = {"type": "a/B", "md5sum": "0" * 32, "definition": "int32 b\n"}
    for more in ({}, {}, {"type": "a/C"}, {"callerid": "/n"}, {"latching": True}):
        writer.write("/t", 1, b"", **{**plain, **more})  # type: ignore[arg-type]
    bag = writer.finish()
    found = [(c.id, c.type, c.callerid, c.latching) for c in bag.connections]
    assert found == [
        (0, "a/B", None, False),
        (1, "a/C", None, False),
        (2, "a/B", "/n", False),
        (3, "a/B", None, True),
    ]
    assert [c.id for c, *_ in bag.messages()] == [0, 0, 1, 2, 3]
    assert bag.check().problems == [f"topic /t is a/B ({'0' * 32}) and a/C ({'0' * 32})"]


def test_any_buffer_can_be_written_and_opened(tmp_path: Path) -> None:
    writer = MemoryBag.writer()
    for raw in (b"one", bytearray(b"two"), memoryview(b"xthreex")[1:-1]):
        put(writer, "/t", 1, raw)  # type: ignore[arg-type]
    bag = writer.finish()
    expected = [("/t", 1, b"one"), ("/t", 1, b"two"), ("/t", 1, b"three")]
    copy = bytearray(bag.view())
    again = MemoryBag(copy)
    copy[:] = bytes(len(copy))  # it was copied, so this changes nothing
    assert ours(again) == ours(bag) == written(bag, tmp_path) == expected


def test_the_module_is_missing_in_one_sentence() -> None:
    code = "import sys; sys.modules['bagpipe_bag'] = None; import bagpipe.spec, bagpipe; "
    done = subprocess.run(
        [sys.executable, "-c", code + "bagpipe.MemoryBag"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.stderr.splitlines()[-1] == (
        "bagpipe.native.NativeModuleError: bagpipe.MemoryBag needs the native module "
        "bagpipe_bag, which is not installed here: `make wheels` in a checkout builds it for pip, "
        "`make venv` into .venv, and the Spark image has it"
    )
    with pytest.raises(AttributeError, match="no attribute 'Bag'"):
        _ = bagpipe.Bag


def test_a_module_that_is_too_old_is_named() -> None:
    assert issubclass(NativeModuleError, ImportError)
    with pytest.raises(NativeModuleError, match=r"needs a newer native module .*`make venv`"):
        native("what_it_will_have_one_day", "reading a bag")


def example(page: Path) -> Sequence[str]:
    blocks = page.read_text().split("```python\n")[1:]
    return [block.split("```")[0] for block in blocks]


def test_the_pages_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = Path(__file__).parents[3] / "docs/reference/memory-bag.md"
    blocks = example(page)
    assert len(blocks) == 2
    write_bag(tmp_path / "drive.bag", steady("/chatter", 300, SECOND // 10))
    monkeypatch.chdir(tmp_path)
    found: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(page), "exec"), found)  # noqa: S102 (the page's own code)
    assert found["count"] == 300
    assert len(by_rosbags(tmp_path / "part.bag")) == 100


def test_errors_name_the_place_and_what_was_expected(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r'^byte 0: expected the line "#ROSBAG V2.0"'):
        MemoryBag(b"no bag at all")
    path = tmp_path / "no.bag"
    with pytest.raises(FileNotFoundError, match=r"no\.bag"):
        MemoryBag.open(path)
    path.write_bytes(b"")
    with pytest.raises(BagError, match=rf"^{path}: byte 0: expected"):
        MemoryBag.open(path)
    bag = filled([("/t", 7, b"x")])
    with pytest.raises(BagError, match="no topic /T; it has: /t"):
        bag.messages(["/T"])
    with pytest.raises(BagError, match="start 9 lies behind end 8"):
        bag.slice(9, 8)
    with pytest.raises(BagError, match='"zip"; it can be none, lz4 or bz2'):
        MemoryBag.writer(compression="zip")  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        bag.messages("/t")
    assert issubclass(BagError, ValueError)
