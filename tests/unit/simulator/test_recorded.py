"""Recorded topics beside a simulator: what is due when, and what a job may ask for."""

import itertools
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pydantic import ValidationError

from bagpipe.encodings import ROS1
from bagpipe.plan.case import Case
from bagpipe.simulator.model import START
from bagpipe.source.planning import plan
from bagpipe.source.simulator.beside import RecordedTopics, _publications
from bagpipe.source.simulator.drive import Drive
from bagpipe.spec import SimulationJobSpec, claims
from bagpipe.storage import Storage
from bagpipe.wire.session import SessionError
from tests.unit.bagpipe.bags import Recorded, steady, write_bag
from tests.unit.simulator.test_job import EXAMPLE, STEP, job

SECOND = 1_000_000_000
BAG = "pvc://recordings/a.bag"


def recorded(*pieces: dict[str, Any], **change: Any) -> SimulationJobSpec:
    return job(change | {"matrix": None}, recorded=list(pieces), actors=[])


def cases_of(spec: SimulationJobSpec, folder: Path) -> list[Case]:
    made = plan(spec, Storage({"recordings": str(folder)}))
    assert made.unplanned == []
    return made.cases


def due(case: Case, folder: Path, *moments: float) -> list[list[str]]:
    """The texts that are due at these seconds of the drive."""
    topics = RecordedTopics(case, Storage({"recordings": str(folder)}), ROS1)
    found = [topics.due(START + round(moment * SECOND)) for moment in moments]
    return [[f"{topic} {data[4:].decode()}" for topic, data in messages] for messages in found]


def test_a_message_is_due_in_the_first_moment_that_is_not_before_it(tmp_path: Path) -> None:
    messages = [
        Recorded("/map", 10 * SECOND, "room", latching=True),
        Recorded("/a", 12 * SECOND, "0"),
        Recorded("/a", 12 * SECOND + 100_000_000, "1"),
        Recorded("/a", 12 * SECOND + 100_000_001, "2"),
        Recorded("/b", 12 * SECOND + 150_000_000, "3"),
        Recorded("/other", 12 * SECOND + 150_000_000, "not asked for"),
        Recorded("/a", 30 * SECOND, "behind the drive"),
    ]
    write_bag(tmp_path / "a.bag", messages, chunk_bytes=20)
    spec = recorded({"bag": BAG, "from": "2s", "topics": ["/a", "/b", "/map"]})
    (case,) = cases_of(spec, tmp_path)
    assert due(case, tmp_path, 0, 0.1, 0.2, 0.3, 9.9) == [
        ["/map room", "/a 0"], ["/a 1"], ["/a 2", "/b 3"], [], [],
    ]  # fmt: skip


def test_several_recordings_are_one_stream(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/a", 5, 200_000_000))
    # Recordings may lack the leading slash.
    write_bag(tmp_path / "b.bag", steady("b", 5, 200_000_000, 77 * SECOND + 100_000_000))
    pieces = [{"bag": BAG, "topics": ["/a"]},
              {"bag": "pvc://recordings/b.bag", "topics": ["/b"], "from": "200ms"}]  # fmt: skip
    (case,) = cases_of(recorded(*pieces), tmp_path)
    assert due(case, tmp_path, 0.25, 1.0) == [
        ["/a 00000000", "/b 00000001", "/a 00000001", "/b 00000002"],
        ["/a 00000002", "/b 00000003", "/a 00000003", "/b 00000004", "/a 00000004"],
    ]  # fmt: skip
    assert (case.id, case.bag, len(case.parts)) == ("drive", "simulator", 2)
    assert {part.at for part in case.parts} == {START}


def test_the_world_sends_recorded_messages_first_and_names_their_topics(
    tmp_path: Path,
) -> None:
    write_bag(tmp_path / "a.bag", steady("/a", 5, 100_000_000))
    spec = recorded({"bag": BAG, "topics": ["/a"]}, record={"topics": ["/cmd"]})
    (case,) = cases_of(spec, tmp_path)
    drive = Drive(case, spec, spec.source.own, Storage({"recordings": str(tmp_path)}))
    described = {each["topic"]: each["recorded"] for each in drive.described["publications"]}
    assert described == {
        "/ego/collision": True, "/scene": True, "/obstacles": True, "/ego/odom": True, "/a": False,
    }  # fmt: skip
    names = [each["topic"] for each in drive.described["publications"]]
    step = drive.step({"messages": []})
    assert step is not None
    assert [names[place] for place, _ in step["messages"]] == [
        "/a", "/ego/collision", "/scene", "/obstacles", "/ego/odom",
    ]  # fmt: skip
    also = spec.model_copy(update={"record": spec.record.model_copy(update={"topics": ["/.*"]})}) \
        if spec.record else spec  # fmt: skip
    drive = Drive(case, also, spec.source.own, Storage({"recordings": str(tmp_path)}))
    assert {each["recorded"] for each in drive.described["publications"]} == {True}


def connection(definition: str, md5sum: str = "") -> SimpleNamespace:
    return SimpleNamespace(
        topic="/speed", type="p/msg/Speed", md5sum=md5sum, definition=definition, latching=False,
        schema_encoding="ros2idl" if "struct" in definition else "ros2msg",
    )  # fmt: skip


def test_one_name_of_two_definitions_is_two_types_in_ros_2() -> None:
    words = (
        "/speed was recorded as p/msg/Speed with field 1 of p/Speed: float64 metres and as"
        " p/msg/Speed with field 1 of p/Speed: int32 feet: leave it out"
    )
    with pytest.raises(SessionError, match=words):
        _publications([connection("float64 metres\n"), connection("int32 feet\nstring unit\n")])
    alike = [connection("float64 metres # m\n"), connection("uint8 A=1\nfloat64 metres\n")]
    assert len(_publications(alike)) == 1
    assert len(_publications([connection("int8 a\n", "1"), connection("bool b\n", "1")])) == 1
    with pytest.raises(SessionError, match="as p/msg/Speed with MD5 sum 1 and as p/msg/Speed with"):
        _publications([connection("int8 a\n", "1"), connection("int8 a\n", "2")])


@pytest.mark.parametrize("between", ["", " \n", "module p {\n  struct Speed { long feet; };\n};\n"])
def test_a_definition_that_is_missing_hides_no_other_type(between: str) -> None:
    parts = [connection(each) for each in ("int32 feet\n", between, "float64 metres\n")]
    for order in itertools.permutations(parts):
        with pytest.raises(SessionError, match="/speed was recorded as"):
            _publications(list(order))
    for alike in itertools.permutations(parts[:2]):
        assert [each.definition for each in _publications(list(alike))] == ["int32 feet\n"]
    assert [each.definition for each in _publications([parts[1]])] == [between]


def test_values_of_the_matrix_choose_the_recording(tmp_path: Path) -> None:
    for name in ("dusk", "noon"):
        write_bag(tmp_path / f"{name}.bag", steady("/a", 5, SECOND))
    spec = job(
        {"matrix": {"variables": {"light": ["dusk", "noon"]}}},
        actors=[], recorded=[{"bag": "pvc://recordings/{{ light }}.bag", "topics": ["/a"]}],
    )  # fmt: skip
    found = {case.id: case.parts[0].bag for case in cases_of(spec, tmp_path)}
    assert found == {
        "drive-s0": "pvc://recordings/dusk.bag", "drive-s1": "pvc://recordings/noon.bag",
    }  # fmt: skip
    assert claims(spec) == {"recordings": True, "results": False}


def test_a_topic_that_the_recording_lacks_is_named(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/a", 5, SECOND))
    spec = recorded({"bag": BAG, "topics": ["/a", "/b"]})
    made = plan(spec, Storage({"recordings": str(tmp_path)}))
    (fault,) = made.unplanned
    assert (made.cases, fault.id, fault.reason) == ([], "drive", "NoMatchingTopics")
    assert "the topics /b are not in the bag; it has /a" in fault.message


def test_one_topic_of_two_types_is_refused(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/a", 5, SECOND))
    (case,) = cases_of(recorded({"bag": BAG, "topics": ["/a"]}), tmp_path)
    topics = RecordedTopics(case, Storage({"recordings": str(tmp_path)}), ROS1)
    assert [(each.topic, each.type) for each in topics.publications] == [("/a", "std_msgs/String")]
    data = (tmp_path / "a.bag").read_bytes()
    # The same length, so that everything else stays where it is.
    (tmp_path / "b.bag").write_bytes(data.replace(b"std_msgs/String", b"std_msgs/Strung"))
    pieces = [{"bag": BAG, "topics": ["/a"]}, {"bag": "pvc://recordings/b.bag", "topics": ["/b"]}]
    with pytest.raises(SessionError, match="was recorded as std_msgs/String and as std_msgs/Stru"):
        two_types(pieces, tmp_path)


def two_types(pieces: list[dict[str, Any]], folder: Path) -> None:
    """As if the second piece, too, had been asked for /a: the spec would refuse it."""
    pieces[1]["topics"] = ["/a"]
    cases = [cases_of(recorded(piece), folder)[0] for piece in pieces]
    cases[0].parts.extend(cases[1].parts)
    RecordedTopics(cases[0], Storage({"recordings": str(folder)}), ROS1)


@pytest.mark.parametrize(
    ("pieces", "words"),
    [
        ([{"bag": BAG, "topics": []}], "at least 1 item"),
        ([{"bag": BAG, "topics": ["/obstacles"]}], "which the simulator or the stack says"),
        ([{"bag": BAG, "topics": ["/cmd"]}], "rename the simulator's own"),
        ([{"bag": BAG, "topics": ["/clock"]}], "has /clock"),
        ([{"bag": BAG, "topics": ["/a"]}, {"bag": BAG, "topics": ["/a"]}], "or an entry before"),
        ([{"bag": "pvc://a/*.bag", "topics": ["/a"]}], "a piece is of one bag"),
    ],
)
def test_refusals_say_what_to_write(pieces: list[dict[str, Any]], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        recorded(*pieces)


def test_a_recorded_topic_may_be_a_step_s_trigger() -> None:
    playback = {"mode": "lockstep", "steps": [STEP, STEP | {"trigger": "/camera"}]}
    spec = recorded({"bag": BAG, "topics": ["/camera"]}, playback=playback)
    assert len(spec.playback.steps) == 2
    with pytest.raises(ValidationError, match="/camera is no topic of the simulator"):
        job({"playback": playback})
    assert EXAMPLE["playback"]["mode"] == "lockstep"
