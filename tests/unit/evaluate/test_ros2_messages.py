"""Criteria find the same in a recording of ROS 2 as in one of ROS 1 that says the same."""

import io
import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from bagpipe import BagError, MemoryMcap
from bagpipe.evaluate.evidence import Evidence, Recording
from bagpipe.evaluate.finding import NoEvidenceError
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion, OwnEvaluator
from bagpipe.evaluate.own import own
from tests.unit.evaluate import recordings
from tests.unit.evaluate.drives import ALL, ERROR, INPUTS
from tests.unit.evaluate.recordings import SECOND, Entry, evidence, poses, stamped
from tests.unit.evaluate.recordings import STORE as ROS1
from tests.unit.evaluate.ros2_recordings import STORE, definition, mcap

# This module makes both itself.
pytestmark = pytest.mark.parametrize("form", ["ros1"], indirect=True)

CRITERIA: list[Any] = [
    *ALL,
    {"rate": {"topic": "/cars", "max": 50, "over": "worst"}},
    {"bounds": {"topic": "/pose", "field": "header.stamp", "min": 10.5, "max": 14.5}},
    {"bounds": {"topic": "/cars", "field": "poses[0].position.y", "max": 5}},
    {"expression": {"topic": "/pose", "holds": "msg.header.stamp - t < 12.0", "share": 0.5}},
    {"expression": {"topic": "/cars", "holds": "msg.poses.all(p, p.position.x > 0.0)"}},
    {"error": {**ERROR["error"], "recording": False, "metric": "rmse", "stampTolerance": "20ms"}},
    {"finalPose": {"topic": "/pose", "position": [14, 0], "maxDistance": 2, "yaw": 0.5,
                   "maxYawError": 0.1}},
    {"separation": {"ego": "/pose", "obstacles": "/cars", "minTimeToCollision": 3, "radius": 1}},
]  # fmt: skip
FOUND = [Criterion.model_validate({"name": f"c{n}"} | each) for n, each in enumerate(CRITERIA)]

places = st.floats(-20, 20, width=32) | st.sampled_from([math.nan, math.inf])
# Late, early, empty and impossible stamps.
stamps = st.floats(-0.5, 0.05) | st.just(0.0) | st.sampled_from([-1e6, 1000.0])
answers = st.tuples(st.floats(9, 17), stamps, places, places, st.floats(-4, 4), st.booleans())
courses = st.lists(answers, max_size=25)
crowds = st.lists(st.tuples(st.floats(9, 16), st.lists(st.tuples(places, places), max_size=3)),
                  max_size=8)  # fmt: skip


RIGHT = [(at + 0.01, -0.01, at, 0.0, 0.0, False) for at in INPUTS]
WRONG = [(at + 0.09, -0.09, at, 5.0, 0.0, False) for at in INPUTS[:-1]]
TRUTH = [(at, 0.0001, at, 0.0, 0.0, True) for at in INPUTS]
CROWD = [(at, [(at, 10.0)]) for at in INPUTS]


# Far off, half as often as it should, and hit.
SELDOM = [(at + 0.01, -0.01, 200.0, 0.0, 0.0, False) for at in INPUTS[::2]]
NEAR = [(at, [(200.0, 0.5)]) for at in INPUTS]


def drive(course: list[Any], crowd: list[Any]) -> list[Entry]:
    entries: list[Entry] = []
    for at, late, x, y, yaw, as_truth in course:
        stamp = 0.0 if late == 0 else max(0.0, at + late)
        entries.append(("/truth" if as_truth else "/pose", at, stamped(stamp, x, y, yaw)))
    return entries + [("/cars", at, poses(at, *points)) for at, points in crowd]


@pytest.mark.parametrize("schema", recordings.FORMS[1:])
def test_the_findings_are_the_same(schema: str, monkeypatch: pytest.MonkeyPatch) -> None:
    outcomes: set[tuple[str, str]] = set()

    @example(course=RIGHT, truth=TRUTH, crowd=CROWD, latched=False)
    @example(course=WRONG, truth=TRUTH, crowd=CROWD, latched=True)
    @example(course=SELDOM, truth=TRUTH, crowd=NEAR, latched=False)
    @example(course=[], truth=[], crowd=[], latched=False)
    @settings(max_examples=25, deadline=None)
    @given(course=courses, truth=courses, crowd=crowds, latched=st.booleans())
    def compared(course: list[Any], truth: list[Any], crowd: list[Any], latched: bool) -> None:
        entries = drive(course, crowd)
        source = [("/truth", at, message) for _, at, message in drive(truth, [])]
        rows = []
        for made_of in ("ros1", schema):
            monkeypatch.setattr(recordings, "form", made_of)
            latching = ("/cars",) if latched else ()
            judged = evaluate(FOUND, evidence(entries, source, end=15.0, latching=latching))
            rows.append([finding.as_row() for finding in judged])
        for ours, theirs in zip(*rows, strict=True):
            assert json.dumps(ours) == json.dumps(theirs)
            outcomes.add((ours["kind"], ours["outcome"]))

    compared()
    kinds = {criterion.kind for criterion in FOUND}
    for outcome in ("passed", "failed"):
        assert {kind for kind, found in outcomes if found == outcome} == kinds
    assert {kind for kind, found in outcomes if found == "invalid"} >= kinds - {"presence", "rate"}


def one(data: bytes, topic: str = "/pose") -> Any:
    (sample,) = Recording(lambda: data, 0, None).samples(topic)
    return sample


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("little_endian", [True, False])
def test_bytes_of_either_order_in_any_compression_are_read(
    little_endian: bool, compression: CompressionType
) -> None:
    message = stamped(12.25, 3.0, 4.0)
    data = mcap(
        [("/pose", 12.5, message)], little_endian=little_endian, compression=compression
    )  # fmt: skip
    sample = one(data)
    assert (sample.time, sample.stamp) == (12_500_000_000, 12_250_000_000)
    assert (sample.message.pose.position.x, sample.message.header.frame_id) == (3.0, "map")
    (received,) = Recording(lambda: data, 0, None).received("/pose")
    assert (received.stamp, received.connection.type) == (
        12_250_000_000,
        "geometry_msgs/msg/PoseStamped",
    )


def test_seconds_have_a_sign_in_ros_2_and_none_in_ros_1() -> None:
    before = STORE.types["builtin_interfaces/msg/Time"](-2, 500_000_000)
    header = STORE.types["std_msgs/msg/Header"](before, "map")
    entry = ("/pose", 5.0, header)
    (received,) = Recording(lambda: mcap([entry]), 0, None).received("/pose")
    # The type itself is the header, which begins with no header.
    assert received.stamp is None
    assert one(mcap([entry])).message.stamp.sec == -2
    pose = STORE.types["geometry_msgs/msg/PoseStamped"](header, recordings.pose(0, 0))
    data = mcap([("/pose", 5.0, pose)])
    assert one(data).stamp == -1_500_000_000
    (received,) = Recording(lambda: data, 0, None).received("/pose")
    assert received.stamp == -1_500_000_000
    bag = recordings.bag([("/pose", 5.0, stamped(2**31 + 1.5, 0, 0))])
    assert one(bag).stamp == (2**31 + 1) * SECOND + 500_000_000


def written(
    data: bytes,
    name: str = "a/msg/B",
    text: str = "int32 x",
    encoding: str = "cdr",
    schema: str = "ros2msg",
) -> Recording:
    """MCAP with one message on /a, whatever its bytes are."""
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start()
    number = writer.register_schema(name, schema, text.encode())
    writer.add_message(writer.register_channel("/a", encoding, number), 5, data, 5)
    writer.finish()
    return Recording(stream.getvalue, 0, None)


CDR = bytes([0, 1, 0, 0])


@pytest.mark.parametrize(
    ("data", "changed", "says"),
    [
        (CDR + b"\1\0", {}, "a message on /a at 0.000 s can't be read as a/msg/B"),
        (b"", {}, "can't be read as a/msg/B"),
        # What DDS-XTypes calls XCDR2.
        (bytes([0, 7, 0, 0]) + b"\1\0\0\0", {}, "Invalid or unsupported CDR encapsulation"),
        (CDR + b"\1\0\0\0" * 5, {}, "CDR message size mismatch"),
        (CDR, {"text": "int32 x\n---\nint32 y"}, "a/msg/B on /a is recorded with its service's"),
        (CDR, {"text": "no type"}, "the definition of a/msg/B on /a can't be read"),
        (CDR, {"text": "Missing m"}, "the definition of a/msg/B on /a can't be read"),
        (CDR, {"text": "B again"}, "can't be read"),
        (CDR, {"text": "module a {", "schema": "ros2idl"}, "the definition of a/msg/B on /a can't"),
        (
            CDR,
            {"text": "module z {}", "schema": "ros2idl"},
            "the definition of a/msg/B on /a can't",
        ),
        (b"{}", {"encoding": "json"}, "messages on /a are in json, and criteria read ros1 and cdr"),
        (b"{}", {"encoding": ""}, "messages on /a are in no known encoding"),
    ],
)
def test_what_can_t_be_read_is_no_evidence(data: bytes, changed: dict[str, str], says: str) -> None:
    recording = written(data, **changed)
    assert [each.stamp for each in recording.received("/a")] == [None]
    with pytest.raises(NoEvidenceError) as lacking:
        recording.samples("/a")
    assert says in str(lacking.value)


@pytest.mark.parametrize(
    ("head", "length", "stamp"),
    [((0, 1), 80, 12_250_000_000), ((0, 1), 11, None), ((0, 7), 80, None), ((1, 1), 80, None)],
)
def test_a_stamp_is_read_of_bytes_alone_that_can_have_one(
    head: tuple[int, int], length: int, stamp: int | None
) -> None:
    name = "geometry_msgs/msg/PoseStamped"
    header = STORE.types["std_msgs/msg/Header"](recordings.time(12.25), "map")
    message = STORE.types[name](header, recordings.pose(1, 2))
    data = bytes([*head]) + bytes(STORE.serialize_cdr(message, name))[2:length]
    (received,) = written(data, name, definition(name, "ros2msg")).received("/a")
    assert received.stamp == stamp


def test_messages_of_ros_1_in_mcap_are_read_as_such() -> None:
    message = ROS1.types["std_msgs/msg/Float64"](2.5)
    data = bytes(ROS1.serialize_ros1(message, "std_msgs/msg/Float64"))
    recording = written(data, "std_msgs/Float64", "float64 data", "ros1", "ros1msg")
    (sample,) = recording.samples("/a")
    assert sample.message.data == 2.5


def test_types_of_services_and_without_fields_are_read() -> None:
    event = "uint8 kind\nB_Request[] request\n" + "=" * 80 + "\nMSG: a/srv/B_Request\nint32 x\n"
    data = CDR + b"\2\0\0\0" + b"\1\0\0\0" + b"\7\0\0\0"
    (sample,) = written(data, "a/srv/B_Event", event).samples("/a")
    assert (sample.message.kind, sample.message.request[0].x) == (2, 7)
    assert len(written(CDR + b"\0", "a/msg/Empty", "").samples("/a")) == 1


@pytest.mark.parametrize("latched", [True, False])
def test_transient_local_topics_hold_until_their_next_message(latched: bool) -> None:
    entries = [("/map", 10.5, recordings.number(1.0))]
    data = mcap(entries, ("/map",) if latched else ())
    (received,) = Recording(lambda: data, 0, None).received("/map")
    assert received.connection.latching is latched


def test_what_a_message_is_does_not_change_with_its_receipt() -> None:
    same, other = stamped(12.0, 1, 2), stamped(12.0, 1, 3)
    data = mcap([("/pose", 12.1, same), ("/pose", 12.2, same), ("/pose", 12.3, other)])
    recording = Recording(lambda: data, 0, None)
    one_, again, third = (each.identity for each in recording.received("/pose"))
    assert one_ == again != third


def test_a_damaged_recording_is_no_evidence() -> None:
    data = mcap([("/pose", 11 + n / 10, stamped(11 + n / 10, n, 0)) for n in range(200)])
    recording = Recording(lambda: data[: len(data) // 2], 0, None)
    with pytest.raises(NoEvidenceError, match="the recording is damaged: expected "):
        recording.received("/pose")
    judged = evaluate(FOUND[:1], Evidence(recording, recording, 10 * SECOND, 15 * SECOND))
    assert [finding.outcome for finding in judged] == ["invalid"]


def test_an_own_evaluator_gets_messages_of_ros_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lane").mkdir()
    (tmp_path / "lane/evaluator.py").write_text(
        "def evaluate(case):\n"
        "    [(time, message)] = case.messages('/pose')\n"
        "    stamp = message.header.stamp.sec\n"
        "    return {'outcome': 'passed', 'figure': message.pose.position.x + stamp}\n"
    )
    monkeypatch.setattr(recordings, "form", "ros2msg")
    given_ = evidence([("/pose", 12.0, stamped(11.5, 3.0, 0.0))])
    assert given_.recorded.file()[0] == ".mcap"
    finding = own("lane", OwnEvaluator(config_map="lane", timeout="120s"), given_, tmp_path)
    assert (finding.outcome, finding.figure) == ("passed", 14.0)


def test_messages_are_views_that_outlive_the_file() -> None:
    opened = MemoryMcap(mcap([("/pose", 12.0, stamped(12.0, 1.0, 2.0))]))
    messages = opened.messages(["/pose"], 0, 13 * SECOND)
    assert messages.__length_hint__() == 1
    ((connection, time, raw),) = messages
    del opened, messages
    assert (connection.encoding, connection.schema_encoding, time) == (
        "cdr",
        "ros2msg",
        12 * SECOND,
    )
    assert isinstance(raw, memoryview)
    assert raw.readonly
    decoded: Any = STORE.deserialize_cdr(bytes(raw), connection.type)
    assert decoded.pose.position.y == 2.0


@pytest.mark.parametrize(
    ("topics", "start", "end", "count"),
    [(None, None, None, 4), (["/a"], None, None, 2), (["/none"], 0, None, 0),
     (None, 11 * SECOND, 12 * SECOND, 2), (None, 13 * SECOND, 12 * SECOND, 0)],
)  # fmt: skip
def test_messages_of_topics_and_of_a_window(
    topics: list[str] | None, start: int | None, end: int | None, count: int
) -> None:
    entries = [(topic, at, recordings.number(at)) for at in (11.0, 12.0) for topic in ("/a", "/b")]
    opened = MemoryMcap(mcap(entries))
    assert opened.topics == ["/a", "/b"]
    assert len(list(opened.messages(topics, start, end))) == count
    assert [each.topic for each in opened.connections] == ["/a", "/b"]


def test_its_memory_is_bounded_and_other_bytes_are_refused() -> None:
    data = mcap([("/a", 1.0, recordings.text("x" * 5000))], compression=CompressionType.ZSTD)
    assert len(list(MemoryMcap(data).messages())) == 1
    with pytest.raises(BagError, match="bytes of memory"):
        list(MemoryMcap(data, decompressed_bytes=1000).messages())
    with pytest.raises(BagError):
        MemoryMcap(b"#ROSBAG V2.0\n")
