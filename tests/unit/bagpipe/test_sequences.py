"""Pieces of recordings as one case: what is planned, and the bag that is made of them."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from bagpipe import MemoryBag
from bagpipe.encodings import ROS1
from bagpipe.engine.chosen import engine_of
from bagpipe.engine.ros1.by_hand import play_command
from bagpipe.matrix.faults import MatrixError
from bagpipe.plan.case import Case
from bagpipe.run.case_run import is_of, lost_row
from bagpipe.run.laptop import planned_case, write_fragment
from bagpipe.source.chosen import source_of
from bagpipe.source.planning import plan
from bagpipe.source.sequence.stream import sequence, sequence_file
from bagpipe.spec import SimulationJobSpec, claims
from bagpipe.storage import Storage
from bagpipe.wire.session import InputFile, SessionError
from tests.unit.bagpipe.bags import Recorded, steady, write_bag
from tests.unit.bagpipe.jobs import make_spec

SECOND = 1_000_000_000
STORE = get_typestore(Stores.ROS1_NOETIC)


def spec_of(*pieces: dict[str, Any], **changed: Any) -> SimulationJobSpec:
    written = [{"bag": f"pvc://recordings/{piece.pop('name', 'a')}.bag"} | piece
               for piece in pieces]  # fmt: skip
    source = {"sequence": written} | changed.pop("source", {})
    return make_spec(source=source, **changed)


def planned(folder: Path, *pieces: dict[str, Any], **changed: Any) -> list[Case]:
    made = plan(spec_of(*pieces, **changed), Storage({"recordings": str(folder)}))
    assert made.unplanned == []
    return made.cases


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """a.bag: ten seconds from second 1 on; b.bag: five from second 100 on; ten a second."""
    write_bag(tmp_path / "a.bag", steady("/scan", 100, SECOND // 10), chunk_bytes=500)
    late = steady("/scan", 50, SECOND // 10, 100 * SECOND)
    write_bag(tmp_path / "b.bag", late, chunk_bytes=500)
    return tmp_path


def sequence_bag(case: Case, storage: Storage) -> MemoryBag:
    return MemoryBag(sequence(case, storage, ROS1))


def texts(bag: MemoryBag) -> list[tuple[int, str]]:
    return [(time, bytes(raw[4:]).decode()) for _, time, raw in bag.messages()]


def test_parts_follow_each_other_in_the_first_one_s_time(folder: Path) -> None:
    (case,) = planned(
        folder,
        {"from": "2s", "to": "5s"},
        {"name": "b", "to": "1s", "times": 2, "pause": "250ms"},
        {"from": "500ms"},
        source={"fragment": {"warmUp": "1s"}},
    )
    assert (case.id, case.fragment, case.bag) == ("sequence", "sequence", "sequence")
    end = 11 * SECOND - SECOND // 10 + 1
    assert [(p.bag[-5:], p.window.start, p.window.end, p.at) for p in case.parts] == [
        ("a.bag", 3 * SECOND, 6 * SECOND, 3 * SECOND),
        ("b.bag", 100 * SECOND, 101 * SECOND, 6_250_000_000),
        ("b.bag", 100 * SECOND, 101 * SECOND, 7_500_000_000),
        ("a.bag", 1_500_000_000, end, 8_500_000_000),
    ]
    window = case.window
    assert (window.lead_in_start, window.start) == (2 * SECOND, 3 * SECOND)
    assert window.end == 8_500_000_000 + end - 1_500_000_000
    assert case.bytes == sum(part.bytes for part in case.parts) > 0


def test_the_bag_has_every_message_once_at_its_new_time(folder: Path) -> None:
    (case,) = planned(folder, {"from": "9s"}, {"name": "b", "to": "300ms", "times": 2})
    found = texts(sequence_bag(case, Storage({"recordings": str(folder)})))
    first = [(10 * SECOND + n * SECOND // 10, f"{90 + n:08d}") for n in range(10)]
    at = 10 * SECOND + 9 * SECOND // 10 + 1
    then = [(at + n * SECOND // 10, f"{n % 3:08d}") for n in range(6)]
    assert found == first + then
    assert case.window.end == at + 6 * SECOND // 10


def test_a_to_may_lie_behind_the_last_message(folder: Path) -> None:
    (case,) = planned(folder, {"name": "b", "from": "4.8s", "to": "10s"}, {"to": "100ms"})
    times = [t for t, _ in texts(sequence_bag(case, Storage({"recordings": str(folder)})))]
    assert times == [104_800_000_000, 104_900_000_000, 110 * SECOND]


def test_a_recording_may_lack_the_leading_slash(folder: Path) -> None:
    write_bag(folder / "c.bag", steady("scan", 10, SECOND // 10))
    (case,) = planned(folder, {"name": "c"}, {"name": "b", "to": "1s"})
    assert sequence_bag(case, Storage({"recordings": str(folder)})).message_count == 20


def test_the_stream_is_the_bag_in_pieces_of_a_frame(folder: Path) -> None:
    (case,) = planned(folder, {}, {"name": "b"})
    storage = Storage({"recordings": str(folder)})
    file = sequence_file(case, storage, "sequence", ROS1)
    data = b"".join(file.pieces())
    assert (file.size, file.ranges) == (len(data), [])
    assert MemoryBag(data).message_count == 150


def test_a_program_gets_the_sequence_as_one_bag(folder: Path) -> None:
    stack = {"image": "i", "command": ["c"], "engine": "exec"}
    spec = spec_of({"to": "1s"}, {"name": "b"}, stack=stack, record=None)
    storage = Storage({"recordings": str(folder)})
    (case,) = plan(spec, storage).cases
    file = engine_of("exec").input(source_of(spec), case, storage)
    assert isinstance(file, InputFile)
    assert file.name == "sequence.bag"
    assert MemoryBag(b"".join(file.pieces())).message_count == 60


def test_a_laptop_makes_the_sequence_of_a_row_again(folder: Path) -> None:
    pieces: list[dict[str, Any]] = [{"name": "{{ first }}", "to": "1s"}, {"name": "b"}]
    spec = spec_of(*pieces, matrix=MATRIX)
    storage = Storage({"recordings": str(folder)})
    for case in plan(spec, storage).cases:
        again = planned_case(lost_row(case, 1), spec, storage)
        assert again == case
    bag = write_fragment(again, source_of(spec), storage, folder / "fragment")
    assert bag.name == "fragment.bag"
    assert MemoryBag.open(bag).message_count == 60
    command = play_command(again, spec, source_of(spec).begin(again, storage, bag), bag)
    assert command[:5] == [
        "bagpipe-agent", "play", str(bag), "--start", "0.000000000",
    ]  # fmt: skip


def write_latched(path: Path, maps: list[tuple[int, str]], until: int) -> None:
    messages = [Recorded("/map", at * SECOND, text, latching=True) for at, text in maps]
    messages += steady("/scan", until, SECOND, SECOND // 2)
    write_bag(path, sorted(messages, key=lambda message: message.time), chunk_bytes=50)


def test_latched_messages_are_sent_again_only_where_they_differ(tmp_path: Path) -> None:
    write_latched(tmp_path / "a.bag", [(1, "one"), (4, "two")], 8)
    (case,) = planned(
        tmp_path,
        {"from": "2s", "to": "3s"},  # one is in force from before
        {"from": "3s", "to": "4s"},  # two comes
        {"from": "5s", "to": "6s"},  # two is in force, and was sent
        {"from": "2s", "to": "3s"},  # one again
    )
    bag = sequence_bag(case, Storage({"recordings": str(tmp_path)}))
    maps = [
        (time - case.window.start, bytes(raw[4:]).decode())
        for connection, time, raw in bag.messages(["/map"])
        if connection.latching
    ]
    # The first lies before the lead-in: it is latched, and counts as no message of the window.
    assert maps == [(-1, "one"), (SECOND + SECOND // 2, "two"), (3 * SECOND, "one")]


def test_stamps_move_with_their_messages(tmp_path: Path) -> None:
    kind = "std_msgs/msg/Header"
    with Writer(tmp_path / "a.bag") as writer:
        connection = writer.add_connection("/scan", kind, typestore=STORE)
        for n in range(4):
            stamp = STORE.types["builtin_interfaces/msg/Time"](10 + n, 5)
            message = STORE.types[kind](seq=n, stamp=stamp, frame_id="f")
            time = (10 + n) * SECOND + 7
            writer.write(connection, time, STORE.serialize_ros1(message, kind))
    (case,) = planned(tmp_path, {"from": "2s", "to": "4s"}, {"to": "2s"})
    bag = sequence_bag(case, Storage({"recordings": str(tmp_path)}))
    found: list[tuple[int, Any]]
    found = [(time, STORE.deserialize_ros1(bytes(raw), kind)) for _, time, raw in bag.messages()]
    assert [time for time, _ in found] == [n * SECOND + 7 for n in (12, 13, 14, 15)]
    assert [(m.stamp.sec, m.stamp.nanosec, m.seq) for _, m in found] == [
        (12, 5, 2), (13, 5, 3), (14, 5, 0), (15, 5, 1),
    ]  # fmt: skip


MATRIX = {"variables": {"first": ["a", "b"], "start": [0, 4]}}


def test_each_combination_puts_other_pieces_together(folder: Path) -> None:
    cases = planned(
        folder, {"name": "{{ first }}", "from": "{{ start }}s"}, {"name": "b"}, matrix=MATRIX
    )
    found = {case.id: [(p.bag[-5:], p.window.start // SECOND) for p in case.parts]
             for case in cases}  # fmt: skip
    assert found == {
        "sequence-s0": [("a.bag", 1), ("b.bag", 100)],
        "sequence-s1": [("a.bag", 5), ("b.bag", 100)],
        "sequence-s2": [("b.bag", 100), ("b.bag", 100)],
        "sequence-s3": [("b.bag", 104), ("b.bag", 100)],
    }
    assert len({case.bag_version for case in cases}) == 4
    assert {case.fragment for case in cases} == {"sequence"}


def test_a_combination_that_makes_no_piece_stops_the_plan(folder: Path) -> None:
    with pytest.raises(MatrixError, match=r"source.sequence\[0\].from: .*'aas'.*first = a"):
        planned(folder, {"from": "{{ first }}as"}, matrix=MATRIX)
    with pytest.raises(MatrixError, match=r"source.sequence\[0\].bag names {{ nobody }}, which"):
        planned(folder, {"name": "{{ nobody }}"}, matrix=MATRIX)
    with pytest.raises(MatrixError, match="ends at 3s, not behind its start at 4s"):
        planned(folder, {"from": "{{ start }}s", "to": "3s"}, matrix=MATRIX)


def test_a_missing_piece_is_reported_under_each_combination(folder: Path) -> None:
    """By one name for all, a quarantine of one would stand for all."""
    (folder / "cut.bag").write_bytes((folder / "a.bag").read_bytes()[:-100])
    for piece, reason, words in [
        ({"name": "nowhere"}, "BagUnreadable", "nowhere.bag"),
        ({"name": "cut"}, "BagCut", "the bag is cut"),
        ({"from": "11s"}, "NoMatchingTopics", "from 11s on has no message of the topics"),
    ]:
        spec = spec_of({"name": "{{ first }}"}, dict(piece), matrix=MATRIX)
        made = plan(spec, Storage({"recordings": str(folder)}))
        assert [each.id for each in made.unplanned] == [f"sequence-s{n}" for n in range(4)]
        assert {each.reason for each in made.unplanned} == {reason}
        assert made.cases == []
        assert all(words in each.message for each in made.unplanned)
    spec = spec_of({}, source={"topics": ["/other"]})
    (fault,) = plan(spec, Storage({"recordings": str(folder)})).unplanned
    assert "it has /scan" in fault.message or "and has /scan" in fault.message


def test_a_row_is_of_the_case_only_while_its_pieces_are_the_same(folder: Path) -> None:
    (case,) = planned(folder, {"to": "2s"}, {"name": "b"})
    row = lost_row(case, 1)
    assert is_of(row, case)
    assert [part["at"] for part in row["parts"]] == [SECOND, 3 * SECOND]
    for other in ({"to": "2s"}, {"name": "b", "from": "1s"}), ({"to": "2s"}, {"to": "2s"}):
        assert not is_of(row, planned(folder, *map(dict, other))[0])
    replaced = dataclasses.replace(case, bag_version="another")
    assert not is_of(row, replaced)


def test_a_bag_that_was_replaced_since_is_refused(folder: Path) -> None:
    (case,) = planned(folder, {"name": "b"})
    (folder / "b.bag").unlink()
    write_bag(folder / "b.bag", steady("/scan", 51, SECOND // 10))
    with pytest.raises(Exception, match="no longer the file that was planned"):
        sequence_bag(case, Storage({"recordings": str(folder)}))


def test_damage_inside_a_piece_is_an_error(folder: Path) -> None:
    (case,) = planned(folder, {"name": "b"})
    (part,) = case.parts
    cut = [(offset, length - 20) for offset, length in part.ranges]
    damaged = dataclasses.replace(case, parts=[dataclasses.replace(part, ranges=cut)])
    with pytest.raises(SessionError, match=r"b\.bag: ") as refused:
        sequence_bag(damaged, Storage({"recordings": str(folder)}))
    assert refused.value.reason == "BagUnreadable"


def test_the_volumes_of_pieces_are_mounted_for_reading() -> None:
    spec = make_spec(
        source={"sequence": [{"bag": "pvc://one/{{ a }}.bag"}, {"bag": "pvc://two/b.bag"}]},
        output={"uri": "pvc://two/out"},
    )
    assert claims(spec) == {"one": True, "two": False}


BAG = "pvc://recordings/a.bag"


@pytest.mark.parametrize(
    ("piece", "words"),
    [
        ({"bag": "pvc://a/*.bag"}, "has a wildcard, and a piece is of one bag"),
        ({"bag": "/a.bag"}, "has no known scheme"),
        ({"bag": BAG, "from": "3"}, "is not a duration: write for example 20s"),
        ({"bag": BAG, "from": "3s", "to": "3s"}, "ends at 3s, not behind its start at 3s"),
        ({"bag": BAG, "times": 0}, "greater than or equal to 1"),
    ],
)
def test_refusals_say_what_to_write(piece: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        make_spec(source={"sequence": [piece]})


def test_a_sequence_is_a_source_of_its_own() -> None:
    with pytest.raises(ValidationError, match=r"write one of source\.bags, source\.sequence"):
        make_spec(source={"sequence": [{"bag": BAG}], "bags": [BAG]})
