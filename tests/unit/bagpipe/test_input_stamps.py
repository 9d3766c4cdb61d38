"""The inputs' own stamps are read from the few chunks around a time, or from none."""

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as BagWriter

from bagpipe.engine.criteria import judged_by_criteria
from bagpipe.engine.engine import Attempt
from bagpipe.evaluate.decoding import first_stamp_reader
from bagpipe.evaluate.evidence import Recording
from bagpipe.judgement import Judgement
from bagpipe.plan.bag_tail import BagTail, Chunk, read_tail
from bagpipe.plan.case import Case
from bagpipe.plan.fragments import Window
from bagpipe.source.bags import input_stamps
from bagpipe.source.bags.input_stamps import stamps_in
from bagpipe.source.chosen import source_of
from bagpipe.source.planning import plan
from bagpipe.source.source import JobSource
from bagpipe.storage import OpenFile, Storage, StorageError
from tests.rosbag2_folders import Form, Message, folder
from tests.unit.bagpipe.fake_agent import RESULT
from tests.unit.bagpipe.jobs import make_spec
from tests.unit.evaluate.recordings import STORE, bag, number, stamped
from tests.unit.evaluate.ros2_recordings import STORE as ROS2
from tests.unit.evaluate.ros2_recordings import as_ros2, definition, mcap

SECOND = 1_000_000_000
MS = 1_000_000
BEHIND = 300 * MS
_CHUNK_BYTES = 1500
Entries = list[tuple[str, int, Any]]


def drive() -> Entries:
    """Thirty seconds of a camera, which is recorded late, of numbers, and of another camera."""
    entries: Entries = []
    for at in range(10 * SECOND, 40 * SECOND, 100 * MS):
        entries.append(("/camera", at, stamped((at - BEHIND) / SECOND, 1.0, 2.0)))
        entries.append(("/speed", at + MS, number(3.0)))
        entries.append(("/other", at + 2 * MS, stamped(at / SECOND, 1.0, 2.0)))
    return entries


def write(path: Path, entries: Entries, *, counted: bool = True) -> Path:
    """In small chunks, as a bag or as MCAP of ROS 2, whose messages are `counted`."""
    if path.suffix == ".mcap":
        _write_mcap(path, entries, counted)
    else:
        _write_bag(path, entries)
    return path


def _write_bag(path: Path, entries: Entries) -> None:
    with BagWriter(path) as writer:
        writer.chunk_threshold = _CHUNK_BYTES
        made: dict[tuple[str, str], Any] = {}
        for topic, time, message in entries:
            kind = message.__msgtype__
            if (topic, kind) not in made:
                made[topic, kind] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(made[topic, kind], time, STORE.serialize_ros1(message, kind))


def _write_mcap(path: Path, entries: Entries, counted: bool) -> None:
    with path.open("wb") as stream:
        packed = CompressionType.LZ4
        writer = Writer(stream, _CHUNK_BYTES, packed, use_statistics=counted)
        writer.start(profile="ros2", library="tests")
        channels: dict[tuple[str, str], int] = {}
        for topic, time, message in entries:
            kind = message.__msgtype__
            if (topic, kind) not in channels:
                schema = writer.register_schema(
                    kind, "ros2msg", definition(kind, "ros2msg").encode()
                )
                channels[topic, kind] = writer.register_channel(topic, "cdr", schema)
            data = bytes(ROS2.serialize_cdr(as_ros2(message), kind))
            writer.add_message(channels[topic, kind], time, data, time)
        writer.finish()


class Lab:
    """A recording on a claim, of which a case is a window of 10 s behind a lead-in of 5 s."""

    def __init__(self, path: Path, topics: list[str], **changed: Any) -> None:
        self.path = path
        self.storage = Storage({"recordings": str(path.parent)})
        engine = "ros2" if path.suffix == ".mcap" else "ros1"
        self.spec = make_spec(
            source={
                "bags": [f"pvc://recordings/{path.name}"],
                "topics": topics,
                "fragment": {"length": "10s", "warmUp": "5s"},
            },
            stack={"engine": engine, "image": "i", "command": ["c"]},
            **changed,
        )

    def case(self) -> Case:
        cases = plan(self.spec, self.storage).cases
        case = next(each for each in cases if each.window.lead_in_start > 10 * SECOND)
        return replace(case, window=Window(15 * SECOND, 20 * SECOND, 30 * SECOND))

    def stamps(self, begin: int, end: int, case: Case | None = None) -> dict[str, Any]:
        asked = source_of(self.spec).input_stamps(case or self.case(), self.storage)
        assert asked is not None
        return dict(asked(begin, end))


@pytest.fixture(params=["a.bag", "a.mcap"])
def recorded(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return write(tmp_path / request.param, drive())


def camera(begin: int, end: int) -> list[tuple[int, int]]:
    return [(at, at - BEHIND) for at in range(begin, end, 100 * MS)]


def test_times_and_stamps_of_what_was_played_in_a_half_open_time(recorded: Path) -> None:
    lab = Lab(recorded, ["/camera", "/speed"])
    # Of numbers there is no header, and the other camera is not played.
    assert lab.stamps(19 * SECOND, 21 * SECOND) == {"/camera": camera(19 * SECOND, 21 * SECOND)}
    assert lab.stamps(19 * SECOND, 19 * SECOND + 1) == {
        "/camera": camera(19 * SECOND, 19 * SECOND + 1)
    }
    assert lab.stamps(19 * SECOND + 1, 19 * SECOND + 2) == {}
    # Nor is what was recorded before the lead-in.
    early = lab.stamps(14 * SECOND, 16 * SECOND)
    assert early == {"/camera": camera(15 * SECOND, 16 * SECOND)}
    everything = Lab(recorded, []).stamps(19 * SECOND, 20 * SECOND)
    assert {topic: len(each) for topic, each in everything.items()} == {"/camera": 10, "/other": 10}


def read_of(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """The ranges that are read from now on."""
    asked: list[tuple[int, int]] = []
    pieces = OpenFile.pieces

    def noted(file: OpenFile, ranges: list[tuple[int, int]], most: int) -> Any:
        asked.extend(ranges)
        return pieces(file, ranges, most)

    monkeypatch.setattr(OpenFile, "pieces", noted)
    return asked


def test_few_chunks_are_read_and_once(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lab = Lab(recorded, ["/camera"])
    asked = source_of(lab.spec).input_stamps(lab.case(), lab.storage)
    assert asked is not None
    read = read_of(monkeypatch)
    assert len(asked(19 * SECOND, 21 * SECOND)["/camera"]) == 20
    near = [
        (each.offset, each.end - each.offset)
        for each in chunks_of(recorded, 19 * SECOND, 21 * SECOND)
    ]
    assert 0 < len(near) < len(chunks_of(recorded, 0, 1 << 62)) / 10
    chunks = {each.offset for each in chunks_of(recorded, 0, 1 << 62)}
    assert [each for each in read if each[0] in chunks] == near
    count = len(read)
    assert len(asked(19 * SECOND, 21 * SECOND)["/camera"]) == 20
    assert len(read) == count


BOUNDS = [
    "_MOST_INPUTS", "_MOST_REQUESTS", "_MOST_CHUNK_BYTES", "_MOST_CHUNKS", "_MOST_HEAD_BYTES",
    "_MOST_CONNECTIONS", "_MOST_FILES",
]  # fmt: skip


@pytest.mark.parametrize("bound", BOUNDS)
def test_beyond_a_bound_nothing_is_known(
    recorded: Path, monkeypatch: pytest.MonkeyPatch, bound: str
) -> None:
    lab = Lab(recorded, ["/camera"])
    case = lab.case()

    if bound == "_MOST_REQUESTS":
        monkeypatch.setattr(input_stamps, "REQUEST_BYTES", 100)
    begin, end = 19 * SECOND, 21 * SECOND

    def known(most: int) -> bool:
        monkeypatch.setattr(input_stamps, bound, most)
        return bool(stamps_in(case, ["/camera"], lab.storage, begin, end))

    chunks = chunks_of(recorded, begin, end)
    sizes = [chunk.end - chunk.offset for chunk in chunks]
    least = {
        "_MOST_INPUTS": sum(each.counts[min(each.counts)] for each in chunks),
        "_MOST_REQUESTS": sum(-(-size // 100) for size in sizes),
        # Those of MCAP are compressed here, and of 1,542 bytes without that.
        "_MOST_CHUNK_BYTES": max(*sizes, 1542 if recorded.suffix == ".mcap" else 0),
        "_MOST_CHUNKS": len(chunks),
        "_MOST_HEAD_BYTES": sum(size for _, size in tail_of(recorded).declarations),
        "_MOST_CONNECTIONS": 3,
        "_MOST_FILES": 1,
    }[bound]
    assert (known(least), known(least - 1)) == (True, False)


def tail_of(path: Path) -> BagTail:
    data = path.read_bytes()
    return read_tail(lambda offset, size: data[offset : offset + size], len(data))


def chunks_of(path: Path, begin: int, end: int) -> list[Chunk]:
    """Those that reach into a time."""
    chunks = tail_of(path).chunks
    return [chunk for chunk in chunks if chunk.end_time >= begin and chunk.start_time < end]


def test_an_index_that_states_less_than_there_is_makes_no_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "a.bag", drive())
    lab = Lab(path, ["/camera"])
    case = lab.case()
    begin, end = 19 * SECOND, 21 * SECOND
    data = bytearray(path.read_bytes())
    (number,) = (each.id for each in tail_of(path).connections if each.topic == "/camera")
    last = max(chunk.end for chunk in tail_of(path).chunks)
    for count in {chunk.counts.get(number, 0) for chunk in chunks_of(path, begin, end)} - {0, 1}:
        there, less = (struct.pack("<II", number, each) for each in (count, 1))
        data[last:] = data[last:].replace(there, less)
    path.write_bytes(bytes(data))
    chunks = chunks_of(path, begin, end)
    stated = sum(chunk.counts.get(number, 0) for chunk in chunks)
    assert stated == len(chunks) < 20
    case = replace(case, bag_version=lab.storage.open(case.bag).version)
    for most, known in ((20, True), (19, False)):
        monkeypatch.setattr(input_stamps, "_MOST_INPUTS", most)
        assert bool(stamps_in(case, ["/camera"], lab.storage, begin, end)) == known


@pytest.mark.parametrize("topics", [["/camera"], []])
def test_definitions_of_what_was_not_played_then_are_not_read(
    topics: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = STORE.types["std_msgs/msg/String"]("x")
    entries = [*drive(), ("/once", 39 * SECOND, text)]
    path = write(tmp_path / "a.mcap", sorted(entries, key=lambda each: each[1]))
    read: list[str] = []

    def noted(connection: Any) -> Any:
        read.append(connection.topic)
        return first_stamp_reader(connection)

    monkeypatch.setattr(input_stamps, "first_stamp_reader", noted)
    Lab(path, topics).stamps(19 * SECOND, 21 * SECOND)
    # Both cameras have one type, which is read once.
    assert read == (topics or ["/camera", "/speed"])


def test_the_bounds_are_of_all_files_of_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lab, case = two_files(tmp_path)
    begin, end = 19 * SECOND, 21 * SECOND
    monkeypatch.setattr(input_stamps, "REQUEST_BYTES", 100)
    files = [
        input_stamps._File(lab.storage.open(part.bag), ["/camera"], begin, end)
        for part in case.parts
    ]
    assert all(file.requests and file.inputs for file in files)
    for bound, least in (
        ("_MOST_REQUESTS", sum(file.requests for file in files)),
        ("_MOST_INPUTS", sum(file.inputs for file in files)),
    ):
        before = getattr(input_stamps, bound)
        for most in (least, least - 1):
            monkeypatch.setattr(input_stamps, bound, most)
            found = stamps_in(case, ["/camera"], lab.storage, begin, end)
            assert bool(found) == (most == least)
        monkeypatch.setattr(input_stamps, bound, before)


def test_what_the_files_of_a_folder_declare_is_bounded_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of those of them that have inputs in that time."""
    lab, case = two_files(tmp_path)
    heads = [
        sum(size for _, size in tail_of(tmp_path / "drive" / f"drive_{n}.mcap").declarations)
        for n in range(2)
    ]
    # From 20 s on the second one is read.
    for begin, least in ((19 * SECOND, sum(heads)), (20 * SECOND, heads[1])):
        for most in (least, least - 1):
            monkeypatch.setattr(input_stamps, "_MOST_HEAD_BYTES", most)
            found = stamps_in(case, ["/camera"], lab.storage, begin, 21 * SECOND)
            assert bool(found) == (most == least)


def test_a_file_of_a_folder_that_has_changed_is_an_error_of_storage(tmp_path: Path) -> None:
    lab, case = two_files(tmp_path)
    file = tmp_path / "drive" / "drive_1.mcap"
    file.write_bytes(file.read_bytes() + b"x")
    with pytest.raises(StorageError):
        stamps_in(case, ["/camera"], lab.storage, 19 * SECOND, 21 * SECOND)


def two_files(tmp_path: Path, form: Form = Form("mcap")) -> tuple["Lab", Case]:  # noqa: B008
    """A folder of two files that have the camera's inputs, and a case of both."""
    entries = [each for each in drive() if each[0] == "/camera"]
    halves = [entries[:100], entries[100:]]
    kind = "geometry_msgs/msg/PoseStamped"
    files = [[Message(t, at, bytes(40), type=kind) for t, at, _ in half] for half in halves]
    assert folder(tmp_path / "drive", form, files).exists()
    if form == Form("mcap"):
        for n, half in enumerate(halves):
            write(tmp_path / "drive" / f"drive_{n}.mcap", half)
    lab = Lab(tmp_path / "drive.mcap", ["/camera"])
    source = lab.spec.source.model_copy(update={"bags": ["pvc://recordings/drive"]})
    spec = lab.spec.model_copy(update={"source": source})
    (case,) = (each for each in plan(spec, lab.storage).cases if len(each.parts) == 2)
    return lab, case


def test_a_topic_that_is_recorded_without_its_slash_is_known_by_the_graph_s_name(
    tmp_path: Path,
) -> None:
    entries = [(topic.lstrip("/"), at, message) for topic, at, message in drive()]
    found = Lab(write(tmp_path / "a.bag", entries), ["/camera"]).stamps(19 * SECOND, 20 * SECOND)
    assert {topic: len(each) for topic, each in found.items()} == {"/camera": 10}


@pytest.mark.parametrize(("at", "known"), [(19.5, False), (35.0, True)])
def test_of_a_damaged_chunk_nothing_is_known_and_another_s_damage_is_none(
    recorded: Path, at: float, known: bool
) -> None:
    lab = Lab(recorded, ["/camera"])
    case = lab.case()
    data = bytearray(recorded.read_bytes())
    (chunk,) = chunks_of(recorded, round(at * SECOND), round(at * SECOND) + 1)
    for place in range(chunk.offset + 60, chunk.end - 200):
        data[place] ^= 0xFF
    recorded.write_bytes(bytes(data))
    version = lab.storage.open(case.bag).version
    found = lab.stamps(19 * SECOND, 21 * SECOND, replace(case, bag_version=version))
    assert bool(found) == known


def test_a_file_that_has_changed_is_an_error_of_storage(recorded: Path) -> None:
    lab = Lab(recorded, ["/camera"])
    case = lab.case()
    recorded.write_bytes(recorded.read_bytes() + b"x")
    with pytest.raises(StorageError):
        lab.stamps(19 * SECOND, 21 * SECOND, case)
    # And one that is none any more says nothing.
    recorded.write_bytes(b"x" * 5000)
    version = lab.storage.open(case.bag).version
    assert lab.stamps(19 * SECOND, 21 * SECOND, replace(case, bag_version=version)) == {}


def test_a_chunk_that_is_small_until_it_is_unpacked_is_too_large(tmp_path: Path) -> None:
    entries = drive()
    text = STORE.types["std_msgs/msg/String"]("x" * (17 << 20))
    entries.append(("/text", 20 * SECOND, text))
    path = tmp_path / "a.mcap"
    write(path, sorted(entries, key=lambda each: each[1]))
    lab = Lab(path, ["/camera", "/text"])
    assert path.stat().st_size < 1 << 20
    assert lab.stamps(19 * SECOND, 21 * SECOND) == {}
    assert lab.stamps(16 * SECOND, 18 * SECOND) != {}


def test_of_a_topic_whose_publishers_have_two_types_both_have_a_header(tmp_path: Path) -> None:
    also = [("/camera", at + 3 * MS, number(1.0)) for _, at, _ in drive()[:9]]
    path = write(tmp_path / "a.mcap", sorted([*drive(), *also], key=lambda each: each[1]))
    found = Lab(path, ["/camera", "/other"]).stamps(19 * SECOND, 21 * SECOND)
    assert {topic: len(each) for topic, each in found.items()} == {"/other": 20}


def test_a_topic_with_and_without_its_slash_is_one(tmp_path: Path) -> None:
    """Of which a publisher has messages without a header."""
    also = [("camera", at + 3 * MS, number(1.0)) for _, at, _ in drive()[:9]]
    path = write(tmp_path / "a.mcap", sorted([*drive(), *also], key=lambda each: each[1]))
    assert Lab(path, ["/camera"]).stamps(19 * SECOND, 21 * SECOND) == {}


def test_of_a_type_that_begins_with_something_else_nothing_is_decoded(tmp_path: Path) -> None:
    """A decoder takes seconds to make of a few hundred characters, and of a small message that is
    an array in front of its header it makes a gigabyte of values.
    """
    line = "=" * 80
    rest = f"\n{line}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id"
    rest += f"\n{line}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    stamp = struct.pack("<iIII", 19, 0, 1, 0)
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, _CHUNK_BYTES)
        writer.start(profile="ros2", library="tests")
        for topic, first, data in (("/a", "", stamp), ("/b", "int32 x\n", bytes(4) + stamp)):
            text = f"{first}std_msgs/Header header{rest}"
            schema = writer.register_schema(f"odd/{topic[1]}", "ros2msg", text.encode())
            channel = writer.register_channel(topic, "cdr", schema)
            for at in range(10 * SECOND, 40 * SECOND, SECOND):
                writer.add_message(channel, at, b"\0\1\0\0" + data, at)
        writer.finish()
    found = Lab(path, []).stamps(19 * SECOND, 21 * SECOND)
    assert found == {"/a": [(19 * SECOND, 19 * SECOND), (20 * SECOND, 19 * SECOND)]}


def test_where_no_one_counts_the_messages_of_channels_nothing_is_known(tmp_path: Path) -> None:
    """A chunk may have more topics than its index names."""
    lab = Lab(write(tmp_path / "a.mcap", drive(), counted=False), ["/camera"])
    assert lab.stamps(19 * SECOND, 21 * SECOND) == {}


@pytest.mark.parametrize("form", [Form("mcap"), Form("sqlite3", "", 4), Form("mcap", "FILE", 5)])
def test_of_a_folder_s_files_each_is_read_where_its_chunks_can_be(
    form: Form, tmp_path: Path
) -> None:
    lab, case = two_files(tmp_path, form)
    begin, end = 19 * SECOND, 21 * SECOND
    found = stamps_in(case, ["/camera"], lab.storage, begin, end)
    known = form == Form("mcap")
    assert found == ({"/camera": camera(begin, end)} if known else {})


def judged(lab: Lab, answered: Entries) -> Judgement:
    """By the lab's criteria, of a stack with these answers."""
    case = lab.case()
    seconds = [(topic, at / SECOND, message) for topic, at, message in answered]
    made = bag(seconds) if lab.path.suffix == ".bag" else mcap(seconds)
    recording = Recording(lambda: made, case.window.start, None)
    attempt = Attempt(case, lab.spec, source_of(lab.spec), lab.storage, "pvc://results/r", "x")
    return judged_by_criteria(Judgement("passed"), attempt, recording, RESULT)[0]


def answers(late: int) -> Entries:
    """To all inputs but those of the last 0.3 s, each after so long."""
    inputs = range(15 * SECOND, 30 * SECOND - BEHIND, 100 * MS)
    found = [("/p", at + late, stamped(at / SECOND, 0.0, 0.0)) for at in inputs]
    return [each for each in found if each[1] >= 20 * SECOND]


PRESENCE = {"name": "all", "presence": {"topic": "/p", "min": 100}}


def test_a_case_whose_stack_died_early_passes_no_more(recorded: Path) -> None:
    lab = Lab(recorded, ["/other"], evaluate=[PRESENCE], record={"topics": ["/p"]})
    found = judged(lab, answers(BEHIND))
    assert (found.outcome, found.reason) == ("invalid", "NotEnoughEvidence")
    assert found.message.startswith("all: by the stamps of the inputs on /other no more than 97 of")
    # By a camera that is recorded so late that is all of them.
    late = Lab(recorded, ["/camera"], evaluate=[PRESENCE], record={"topics": ["/p"]})
    assert judged(late, answers(BEHIND)).outcome == "passed"


def test_storage_that_fails_then_is_no_finding(
    recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lab = Lab(recorded, ["/other"], evaluate=[PRESENCE], record={"topics": ["/p"]})
    lab.case()

    def fails(*_: Any) -> Any:
        raise StorageError("s3://r/a.mcap can't be read: 503 Slow Down")

    monkeypatch.setattr(input_stamps, "_File", fails)
    with pytest.raises(StorageError):
        raise AssertionError(judged(lab, answers(BEHIND)))


def test_whatever_else_goes_wrong_then_the_finding_stands(
    recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> Any:
        raise RuntimeError

    monkeypatch.setattr(input_stamps, "_File", fails)
    lab = Lab(recorded, ["/other"], evaluate=[PRESENCE], record={"topics": ["/p"]})
    assert judged(lab, answers(BEHIND)).outcome == "passed"


def test_sources_without_a_recording_of_one_s_own_know_no_stamps() -> None:
    assert JobSource.input_stamps(source_of(make_spec()), Any, Any) is None  # type: ignore[arg-type]
