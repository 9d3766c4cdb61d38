"""What is latched and in force at a fragment's start, as planner, worker and agent have it."""

import itertools
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from bagpipe.native import native
from bagpipe.plan.bag_tail import BagTail, Chunk, Connection
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Conditions, Crossing
from bagpipe.plan.in_force import Latched, Late, as_wanted
from bagpipe.source.bags.folder_stream import folder_file
from bagpipe.source.bags.late import late_of
from bagpipe.source.bags.planning import fragments
from bagpipe.source.bags.stream import fragment_file
from bagpipe.storage import Storage
from tests.rosbag2_folders import (
    FORMS,
    MS,
    START,
    TRANSIENT_LOCAL,
    VOLATILE,
    Form,
    Message,
    folder,
    read_mcap,
)
from tests.unit.bagpipe.jobs import make_spec

STORAGE = Storage({})
TRANSFORMS = "tf2_msgs/msg/TFMessage"
# Two publishers, one of which keeps two messages.
_THREE = TRANSIENT_LOCAL.replace("depth: 0", "depth: 2") + "\n" + TRANSIENT_LOCAL
QOS = {"/a": VOLATILE, "/map": TRANSIENT_LOCAL, "/deep": _THREE, "/tf_static": TRANSIENT_LOCAL}
IN_FORCE = {"/a": 0, "/map": 1, "/deep": 3, "/tf_static": 100}


def message(topic: str, at: int, number: int) -> Message:
    """`at` in ms; each has bytes of its own."""
    kind = TRANSFORMS if topic == "/tf_static" else "std_msgs/msg/String"
    data = b"\0\1\0\0" + number.to_bytes(4, "little") * 10
    return Message(topic, START + at * MS, data, QOS[topic], kind)


def recorded(courses: list[tuple[str, int]]) -> list[Message]:
    return [
        message(topic, at, number)
        for number, (topic, at) in enumerate(sorted(courses, key=lambda each: each[1]))
    ]


def planned(uri: Path, late: Mapping[str, Late], length: str = "1s") -> list[Case]:
    given = {"bags": ["pvc://none/a.bag"], "fragment": {"length": length, "warmUp": "0s"}}
    source = make_spec(source=given).source
    made = fragments([uri.as_uri()], source, "cdr", Crossing([("", Conditions())]), STORAGE, late)
    assert made.unplanned == []
    return made.cases


def stream(case: Case, late: Mapping[str, Late]) -> bytes:
    made = folder_file(case, STORAGE, late) if case.parts else fragment_file(case, STORAGE)
    return b"".join(made.pieces())


def expected(messages: list[Message], at: int, late: Mapping[str, Late]) -> list[Message]:
    """What a subscriber that joins at that time would get."""
    found = []
    for topic, recorded in IN_FORCE.items():
        most = late.get(topic, Late()).in_force(recorded)
        before = [each for each in messages if each.topic == topic and each.time < at]
        found += before[len(before) - most :] if most < len(before) else before
    return sorted(found, key=messages.index)


def sliced(file: Path, case: Case) -> bytes:
    """The agent's own slice of the case's window."""
    made: bytes
    made, _, _ = native("slice_recording", "this test")(
        file, case.window.start, case.window.end, None, compression="none", memory=1 << 30
    )
    return made


def test_several_static_transforms_in_one_channel_all_come_along(tmp_path: Path) -> None:
    """As rosbag2 records several static_transform_publishers: one channel, depths not known."""
    courses = [("/tf_static", at) for at in (0, 1, 2, 2600)]
    courses += [("/map", 3), ("/map", 500), *(("/a", at) for at in range(5, 4000, 50))]
    messages = recorded(courses)
    for number, form in enumerate(FORMS):
        at = tmp_path / f"drive{number}"
        cases = planned(folder(at, form, [messages[:30], messages[30:]]), {})
        assert len(cases) == 4
        for case in cases[1:]:
            (tmp_path / "case.mcap").write_bytes(stream(case, {}))
            found = read_mcap(tmp_path / "case.mcap")
            before = [each for each in found if each.time < case.window.start]
            assert [each for each in before if each.topic == "/tf_static"] == [
                each
                for each in messages
                if each.topic == "/tf_static" and each.time < case.window.start
            ]
            by_time = sorted(before, key=messages.index)
            # Chunks that travel as they are hold more: the player leaves that out.
            assert set(expected(messages, case.window.start, {})) <= set(by_time)


LATE = st.builds(
    Late, st.sampled_from([None, None, True, False]), st.sampled_from([None, None, 1, 2, 5])
)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    courses=st.lists(
        st.tuples(st.sampled_from(sorted(QOS)), st.integers(0, 4000)), min_size=2, max_size=80
    ),
    form=st.sampled_from(FORMS),
    split=st.integers(0, 80),
    late=st.dictionaries(st.sampled_from(sorted(QOS)), LATE, max_size=2),
)
@example(
    courses=[("/deep", at) for at in (1, 1, 2, 2, 3)] + [("/a", 3000)],
    form=Form("mcap"),
    split=3,
    late={},
)
def test_a_fragment_has_what_is_in_force_and_the_agent_s_slice_the_same(
    courses: list[tuple[str, int]], form: Form, split: int, late: dict[str, Late]
) -> None:
    messages = recorded([*courses, ("/a", 4000)])
    with TemporaryDirectory() as place:
        files = [messages[:split], messages[split:]]
        metadata = folder(Path(place, "drive"), form, [each for each in files if each])
        for case in planned(metadata, late):
            file = Path(place, "case.mcap")
            file.write_bytes(stream(case, late))
            found = read_mcap(file)
            start, end = case.window.start, case.window.end
            wanted = expected(messages, start, late)
            assert set(wanted) <= set(found)
            assert [each for each in found if start <= each.time < end] == [
                each for each in messages if start <= each.time < end
            ]
            if len(case.parts) > 1 or not is_as_stored(form):
                assert [each for each in found if each.time < start] == wanted
            if not late:
                assert read(sliced(file, case), place) == read(
                    sliced(Path(place, "drive"), case), place
                )


def is_as_stored(form: Form) -> bool:
    return form.storage == "mcap" and not form.mode


def read(data: bytes, place: str) -> list[Message]:
    path = Path(place, "sliced.mcap")
    path.write_bytes(data)
    return read_mcap(path)


def test_a_job_s_quality_of_service_decides() -> None:
    qos = {
        "/tf_static": {"depth": 1000},
        "/map": {"durability": "volatile"},
        "/a": {"durability": "transientLocal", "reliability": "reliable"},
        "/b": {"reliability": "bestEffort"},
    }
    stack = {"image": "a:1", "command": ["play"], "engine": "ros2", "ros2": {"qos": qos}}
    wanted = late_of(make_spec(stack=stack).stack)
    assert wanted == {"/tf_static": Late(None, 1000), "/map": Late(False), "/a": Late(True)}
    topics = [("/tf_static", 100), ("map", 1), ("/a", 0), ("/b", 2)]
    connections = [
        Connection(number, f"/{topic.strip('/')}", "", "", "cdr", in_force, "", 0, 0)
        for number, (topic, in_force) in enumerate(topics)
    ]
    found = as_wanted(BagTail(0, [], connections, []), wanted).connections
    assert [each.in_force for each in found] == [1000, 0, 1, 2]
    assert late_of(make_spec().stack) == {}


@pytest.mark.parametrize(
    ("latching", "depth", "recorded", "in_force"),
    [
        (None, None, 0, 0), (None, None, 3, 3), (None, 7, 3, 7), (None, 7, 0, 0),
        (False, 7, 3, 0), (True, None, 0, 1), (True, None, 3, 3), (True, 2, 3, 2),
    ],
)  # fmt: skip
def test_late_subscribers_get_what_the_agent_gives_them(
    latching: bool | None, depth: int | None, recorded: int, in_force: int
) -> None:
    """The same table is in the crate's test."""
    assert Late(latching, depth).in_force(recorded) == in_force


@given(
    chunks=st.lists(
        st.tuples(st.integers(0, 50), st.integers(0, 20), st.integers(0, 4)), min_size=1
    ),
    before=st.integers(0, 80),
    in_force=st.integers(1, 6),
    seed=st.randoms(use_true_random=False),
)
def test_the_chunks_hold_what_is_in_force_wherever_in_them_messages_lie(
    chunks: list[tuple[int, int, int]], before: int, in_force: int, seed: object
) -> None:
    made = [
        Chunk(number, number + 1, start, start + length, {7: count})
        for number, (start, length, count) in enumerate(chunks)
    ]
    publisher = Connection(7, "/map", "", "", "cdr", in_force, "", 0, 0)
    found = Latched(made, [publisher]).chunks_at(before)
    times = [
        sorted(seed.randint(chunk.start_time, chunk.end_time) for _ in range(chunk.counts[7]))  # type: ignore[attr-defined]
        for chunk in made
    ]
    earlier = sorted(
        (time, number) for number, each in enumerate(times) for time in each if time < before
    )
    needed = {number for _, number in itertools.islice(reversed(earlier), in_force)}
    # Of several that lie at the time of the oldest any will do only as the file has them, so all.
    if len(earlier) > in_force:
        oldest = earlier[-in_force][0]
        needed |= {number for time, number in earlier if time == oldest}
    assert needed <= {made.index(chunk) for chunk in found}
