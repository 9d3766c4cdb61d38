"""Folders of rosbag2 are planned as one recording, and a case's stream has its messages."""

import itertools
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bagpipe.cli.bag_here import Elsewhere, recording_at
from bagpipe.encodings import CDR
from bagpipe.pieces import SequencePart
from bagpipe.plan.bag_tail import BagError, Chunk, read_tail
from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Conditions, Crossing
from bagpipe.plan.fragments import cut
from bagpipe.plan.made import Plan
from bagpipe.plan.parts import PartPlanner
from bagpipe.plan.rosbag2 import Rosbag2, without_members
from bagpipe.plan.rosbag2_metadata import read_metadata
from bagpipe.run.laptop import planned_case, write_fragment
from bagpipe.source.bags.expanding import recordings
from bagpipe.source.bags.folder_stream import (
    folder_file,
    folder_truth,
    times_of_folder,
)
from bagpipe.source.bags.planning import fragments
from bagpipe.source.chosen import source_of
from bagpipe.source.expanding import expanded
from bagpipe.source.part_reader import PartReader
from bagpipe.source.planning import plan
from bagpipe.source_spec import Source
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage, StorageError
from bagpipe.wire.session import SessionError
from tests.rosbag2_folders import FORMS, MS, START, Form, Message, drive, folder, read_mcap, text

STORAGE = Storage({})
SECOND = 1000 * MS
DATA = Path(__file__).parents[4] / "shared" / "data" / "rosbag2"
DATA = DATA if DATA.exists() else Path(__file__).parents[5] / "shared" / "data" / "rosbag2"


def source(topics: list[str] | None = None, length: str = "2s", warm_up: str = "0s") -> Source:
    given = {
        "bags": ["pvc://none/a.bag"],
        "topics": topics or [],
        "fragment": {"length": length, "warmUp": warm_up},
    }
    spec = {
        "stack": {"image": "app:1", "command": ["play"], "engine": "exec"},
        "source": given,
        "output": {"uri": "pvc://results/a"},
    }
    return SimulationJobSpec.model_validate(spec).source


def planned(metadata: Path, spec: Source, encoding: str | None = "cdr") -> Plan:
    return fragments(
        [metadata.as_uri()], spec, encoding, Crossing([("", Conditions())]), STORAGE, {}
    )


def stream(case: Case, to: Path) -> list[Message]:
    """The case's input, read by MCAP's own library."""
    made = folder_file(case, STORAGE, {})
    data = b"".join(made.pieces())
    assert len(data) == made.size
    to.write_bytes(data)
    return read_mcap(to)


def split(messages: list[Message], *at: int) -> list[list[Message]]:
    edges = [0, *at, len(messages)]
    return [messages[a:b] for a, b in itertools.pairwise(edges)]


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_fragments_over_several_files_hold_every_message_once(form: Form, tmp_path: Path) -> None:
    messages = drive()
    metadata = folder(tmp_path / "drive", form, split(messages, 17, 33, 50))
    made = planned(metadata, source())
    assert made.unplanned == []
    assert [case.id for case in made.cases] == ["drive-0000", "drive-0001", "drive-0002"]
    counted = []
    for case in made.cases:
        assert (case.bag, len(case.ranges)) == (metadata.as_uri(), 0)
        found = stream(case, tmp_path / "case.mcap")
        inside = [m for m in found if case.window.start <= m.time < case.window.end]
        before = {m.topic for m in found if m.time < case.window.start}
        expected = [m for m in messages if case.window.start <= m.time < case.window.end]
        assert inside == expected
        # What was latched before goes with it, wherever that was recorded.
        assert "/map" in before if case.window.start > START else not before
        counted += inside
    assert counted == messages
    assert sum(case.messages for case in made.cases) >= len(messages)


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_what_criteria_ask_of_a_folder(form: Form, tmp_path: Path) -> None:
    messages = drive()
    metadata = folder(tmp_path / "drive", form, split(messages, 30))
    case = planned(metadata, source(["/a"], warm_up="500ms")).cases[1]
    window = case.window
    assert window.lead_in_start == window.start - 500 * MS
    found = stream(case, tmp_path / "case.mcap")
    assert {m.topic for m in found if m.time >= window.lead_in_start} == {"/a"}
    inside = [m for m in messages if window.start <= m.time < window.end]
    times = times_of_folder(case, ["/a"], STORAGE)
    assert times == [m.time for m in inside if m.topic == "/a"]
    (tmp_path / "truth.mcap").write_bytes(folder_truth(case, {"/b"}, STORAGE))
    truth = [m for m in read_mcap(tmp_path / "truth.mcap") if window.start <= m.time < window.end]
    assert truth == [m for m in inside if m.topic == "/b"]


def test_a_fragment_of_one_file_travels_as_its_own_chunks(tmp_path: Path) -> None:
    messages = drive()[1:]
    metadata = folder(tmp_path / "drive", Form("mcap"), split(messages, 20, 40))
    made = planned(metadata, source())
    as_stored = [case for case in made.cases if len(case.parts) == 1]
    assert as_stored
    for case in as_stored:
        given = folder_file(case, STORAGE, {})
        stored = Path(case.parts[0].bag.removeprefix("file://")).read_bytes()
        data = b"".join(given.pieces())
        for at, offset, length in given.ranges:
            assert data[at : at + length] == stored[offset : offset + length]
        assert given.name == case.parts[0].bag


def test_files_count_their_channels_by_themselves(tmp_path: Path) -> None:
    # In the second file /b is the first channel.
    first = [Message("/a", START, b"1"), Message("/b", START + MS, b"2")]
    second = [Message("/b", START + 2 * MS, b"3"), Message("/a", START + 3 * MS, b"4")]
    metadata = folder(tmp_path / "drive", Form("mcap"), [first, second])
    (case,) = planned(metadata, source(length="60s")).cases
    assert len(case.parts) == 2
    assert stream(case, tmp_path / "case.mcap") == first + second


def test_a_gap_between_files_is_no_fragment(tmp_path: Path) -> None:
    late = [m._replace(time=m.time + 600 * SECOND) for m in drive(20)[1:]]
    metadata = folder(tmp_path / "drive", Form("sqlite3"), [drive(20), late])
    numbers = [case.id for case in planned(metadata, source()).cases]
    assert numbers == ["drive-0000", "drive-0300"]


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_a_window_without_a_message_of_the_topics_is_no_fragment(
    form: Form, tmp_path: Path
) -> None:
    # One chunk, and one stretch of SQLite, in which /b was recorded at the begin and the end alone.
    messages = [Message("/a", START + at * 50 * MS, text("a")) for at in range(200)]
    ends = (START + MS, messages[-1].time - MS)
    messages += [Message("/b", time, text("b")) for time in ends]
    messages.sort(key=lambda each: each.time)
    metadata = folder(tmp_path / "drive", form, [messages], chunk_bytes=1 << 20)
    found = [case.id for case in planned(metadata, source(["/b"])).cases]
    assert found == ["drive-0000", "drive-0004"]
    found = [case.id for case in planned(metadata, source(["/a"])).cases]
    assert found == [f"drive-000{number}" for number in range(5)]


@pytest.mark.parametrize("form", [Form("sqlite3"), Form("mcap", "FILE")], ids=str)
def test_where_the_times_of_a_folder_are_too_many_to_keep_each_window_is_a_fragment(
    form: Form, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages = [Message("/b", START, text("b"))]
    messages += [Message("/a", START + at * 50 * MS, text("a")) for at in range(200)]
    messages += [Message("/b", messages[-1].time, text("b"))]
    metadata = folder(tmp_path / "drive", form, [messages], chunk_bytes=1 << 20)
    monkeypatch.setattr("bagpipe.plan.rosbag2.MOST_TIMES", len(messages) - 1)
    assert len(planned(metadata, source(["/b"])).cases) == 5
    monkeypatch.setattr("bagpipe.plan.rosbag2.MOST_TIMES", len(messages))
    assert len(planned(metadata, source(["/b"])).cases) == 2
    # They are those of a folder, however many files it has.
    later = [m._replace(time=m.time + 60 * SECOND) for m in messages]
    metadata = folder(tmp_path / "both", form, [messages, later], chunk_bytes=1 << 20)
    found = [case.id for case in planned(metadata, source(["/b"])).cases]
    assert found == ["both-0000", "both-0004", *[f"both-00{n}" for n in range(30, 35)]]


@pytest.mark.parametrize("named", ["{}/", "{}/metadata.yaml", "{}", "{}*", "{}*/", "{}/*"])
def test_a_folder_is_one_recording_however_it_is_named(named: str, tmp_path: Path) -> None:
    metadata = folder(tmp_path / "drive", Form("mcap"), split(drive(), 30))
    pattern = named.format(metadata.parent.as_uri())
    assert recordings([pattern], STORAGE) == ([metadata.as_uri()], [])


def test_other_files_beside_a_folder_s_own_are_recordings(tmp_path: Path) -> None:
    metadata = folder(tmp_path / "drive", Form("mcap"), split(drive(), 30))
    other = metadata.with_name("other.mcap")
    shutil.copy(metadata.with_name("drive_0.mcap"), other)
    found, missing = recordings([f"{metadata.parent.as_uri()}/*"], STORAGE)
    assert (found, missing) == ([metadata.as_uri(), other.as_uri()], [])
    _, missing = recordings([(tmp_path / "none").as_uri()], STORAGE)
    assert [each.reason for each in missing] == ["BagMissing"]


def test_no_recording_is_compared_with_every_other_one() -> None:
    """A catalogue names each of thousands by itself."""
    compared = []

    class Uri(str):
        __slots__ = ()
        __hash__ = str.__hash__

        def __eq__(self, other: object) -> bool:
            compared.append(other)
            return super().__eq__(other)

    patterns = [f"s3://fleet/{n:04d}.bag" for n in range(500)]
    found, missing = expanded([*patterns, patterns[7]], STORAGE, "none", lambda p, _: [Uri(p)])
    assert (found, missing) == (patterns, [])
    assert len(compared) <= 1001


def test_a_link_to_a_folder_s_own_file_is_no_recording_either(tmp_path: Path) -> None:
    """latest/night_0.mcap, beside the folder of the night; the folder, by a link to it."""
    metadata = folder(tmp_path / "night", Form("mcap"), split(drive(), 30))
    [part, *_] = sorted(metadata.parent.glob("*.mcap"))
    (tmp_path / "latest").mkdir()
    (tmp_path / "latest" / part.name).symlink_to(part)
    (tmp_path / "again").symlink_to("night")
    other = tmp_path / "latest" / "other.mcap"
    other.touch()
    storage = Storage({"r": str(tmp_path)})
    for named in ("night", "again"):
        uris, _ = recordings([f"pvc://r/{named}/", "pvc://r/latest/*.mcap"], storage)
        assert uris == [f"pvc://r/{named}/metadata.yaml", "pvc://r/latest/other.mcap"]


def test_no_folder_is_compared_with_every_other_recording() -> None:
    """Thousands of them are named by one pattern."""
    asked = []

    class Uri(str):
        __slots__ = ()

        def startswith(self, *given: Any) -> bool:
            asked.append(self)
            return super().startswith(*given)

    uris = [Uri(f"s3://fleet/drive-{n:04d}/metadata.yaml") for n in range(500)]
    assert without_members(list(uris), STORAGE) == uris
    assert len(asked) <= 1000


def test_no_fragment_looks_at_all_chunks_of_a_folder(tmp_path: Path) -> None:
    class Chunks(list[Chunk]):
        def __iter__(self) -> Iterator[Chunk]:
            raise AssertionError("all chunks were looked at")

    metadata = folder(tmp_path / "drive", Form("mcap"), split(drive(), 30))
    found = Rosbag2(read_metadata(metadata.as_uri(), STORAGE), STORAGE)
    [fragment] = cut(found.tail, [], 3600 * SECOND, 0)
    whole = found.parts(fragment, [])
    found.tail = replace(found.tail, chunks=Chunks(found.tail.chunks))
    assert found.parts(fragment, []) == whole
    assert [part.messages for part in whole] == [30, len(drive()) - 30]


def refused(metadata: Path, encoding: str = "cdr") -> str:
    made = planned(metadata, source(), encoding)
    assert made.cases == []
    (only,) = made.unplanned
    assert only.bag == metadata.as_uri()
    return only.message


def test_what_can_t_be_planned_says_why(tmp_path: Path) -> None:
    def of(name: str, form: Form) -> Path:
        return folder(tmp_path / name, form, split(drive(), 30))

    metadata = of("ros1", Form("sqlite3"))
    text = refused(metadata, "ros1")
    assert "holds messages in cdr, and the stack would read them as ros1" in text
    (metadata.with_name("ros1_1.db3-wal")).write_bytes(b"more")
    assert "ros1_1.db3: beside it lies a write-ahead log" in refused(metadata)
    metadata = of("leaving", Form("mcap"))
    metadata.write_text(metadata.read_text().replace("leaving_1", "../leaving/leaving_1"))
    assert "the path of a file below the folder" in refused(metadata)
    metadata = of("long", Form("mcap"))
    metadata.write_text(metadata.read_text() + "#" * (10 << 20))
    assert "bytes, expected at most 4194304" in refused(metadata)
    metadata = of("bomb", Form("mcap"))
    bomb = "a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n"
    metadata.write_text(bomb + metadata.read_text())
    assert "expected no alias of YAML" in refused(metadata)
    metadata = of("cut", Form("mcap"))
    cut = metadata.with_name("cut_1.mcap")
    cut.write_bytes(cut.read_bytes()[:-5])
    assert "cut_1.mcap: the recording is cut" in refused(metadata)
    metadata = of("gone", Form("sqlite3"))
    metadata.with_name("gone_0.db3").unlink()
    assert "gone_0.db3" in refused(metadata)
    metadata = of("silent", Form("sqlite3"))
    made = planned(metadata, source(["/c"]))
    assert "none of the topics /c is in the bag; it has /a, /b, /map" in made.unplanned[0].message


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_a_file_of_no_bytes_is_refused_and_one_of_no_messages_is_not(
    form: Form, tmp_path: Path
) -> None:
    drive_files = split(drive(), 30)
    metadata = folder(tmp_path / "silent", form, [drive_files[0], [], drive_files[1]])
    made = planned(metadata, source(length="60s"))
    assert made.unplanned == []
    assert [(case.messages, len(case.parts)) for case in made.cases] == [(61, 2)]
    (middle,) = metadata.parent.glob("silent_1.*")
    middle.write_bytes(b"")
    text = refused(metadata)
    wrong = "the file is empty (0 bytes): copy it again"
    if form.storage == "sqlite3":
        wrong = "table"  # as SQLite takes no bytes for a database without one
    if form.mode == "FILE":
        wrong = "incomplete frame"
    assert f"{middle.name}: " in text
    assert wrong in text


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_the_metadata_s_encoding_is_the_one_that_counts(storage: str, tmp_path: Path) -> None:
    # As rosbag2 goes by it, whatever the file says.
    metadata = folder(tmp_path / "drive", Form(storage), split(drive(), 30))
    metadata.write_text(metadata.read_text().replace("format: cdr", "format: other"))
    assert "/map holds messages in other, and the stack" in refused(metadata)


def test_a_zstd_bomb_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bagpipe.plan.rosbag2_whole.MOST_WHOLE_BYTES", 100_000)
    assert planned(folder(tmp_path / "fits", Form("mcap", "FILE"), [drive()]), source()).cases
    large = [Message("/a", START + number, b"\0" * 50_000) for number in range(10)]
    for storage in ("mcap", "sqlite3"):
        metadata = folder(tmp_path / storage, Form(storage, "FILE"), [large])
        # The library compressed the chunks of MCAP already.
        if storage == "sqlite3":
            assert "the 100000 bytes of memory" in refused(metadata)
    metadata = folder(tmp_path / "plain", Form("sqlite3"), [large])
    assert "must be read whole, which is done up to 100,000" in refused(metadata)


def test_a_part_of_a_folder_alone_says_what_to_name(tmp_path: Path) -> None:
    metadata = folder(tmp_path / "drive", Form("sqlite3"), [drive()])
    file = metadata.with_name("drive_0.db3")
    assert "name the folder that it lies in" in refused(file)
    # Where no folder is taken, such as in a sequence.
    data = metadata.read_bytes()
    with pytest.raises(BagError, match="a folder of rosbag2, which is not taken here"):
        read_tail(lambda at, length: data[at : at + length], len(data))


def test_a_piece_of_messages_compressed_one_by_one_is_refused_until_it_is_converted(
    tmp_path: Path,
) -> None:
    messages = drive()
    metadata = folder(tmp_path / "packed", Form("mcap", "MESSAGE", 8), [messages])
    piece = SequencePart.model_validate({"bag": "pvc://drives/packed/packed_0.mcap"})
    storage = Storage({"drives": str(tmp_path)})
    (part,) = PartPlanner(storage, CDR).sequence([piece], [], 0)
    with pytest.raises(SessionError, match="/map were compressed one by one") as failed:
        list(PartReader(part, storage, CDR).messages())
    assert failed.value.reason == "BagUnreadable"
    assert "`bagpipe bag convert`, and name that" in str(failed.value)
    whole = recording_at(metadata.parent.as_uri(), STORAGE, 1 << 30)
    assert isinstance(whole, Elsewhere)
    made = whole.converted("made.mcap", "none")
    (tmp_path / "made.mcap").write_bytes(made.data)
    piece = SequencePart.model_validate({"bag": "pvc://drives/made.mcap"})
    (part,) = PartPlanner(storage, CDR).sequence([piece], [], 0)
    found = [each.recorded for each in PartReader(part, storage, CDR).messages()]
    assert found == [each.data for each in messages]


def test_a_file_that_changed_since_it_was_planned_is_refused(tmp_path: Path) -> None:
    for form in (Form("mcap"), Form("sqlite3")):
        metadata = folder(tmp_path / form.storage, form, split(drive(), 30))
        case = planned(metadata, source(length="60s")).cases[0]
        path = Path(case.parts[1].bag.removeprefix("file://"))
        path.write_bytes(path.read_bytes() + b"more")
        with pytest.raises(StorageError, match="no longer the file that was planned"):
            stream(case, tmp_path / "case.mcap")


def test_a_damaged_message_ends_the_case_and_not_the_worker(tmp_path: Path) -> None:
    metadata = folder(tmp_path / "drive", Form("sqlite3", "MESSAGE"), [drive()])
    text = metadata.read_text()
    plain = folder(tmp_path / "plain", Form("sqlite3"), [drive()])
    plain.write_text(text.replace("drive_0.db3", "plain_0.db3"))
    case = planned(plain, source()).cases[0]
    with pytest.raises(SessionError, match="a message as whole zstd data"):
        stream(case, tmp_path / "case.mcap")


def test_a_case_is_cut_again_to_be_replayed(tmp_path: Path) -> None:
    folder(tmp_path / "drive", Form("sqlite3"), split(drive(), 30))
    storage = Storage({"drives": str(tmp_path)})
    fields = {
        "source": {"bags": ["pvc://drives/drive"], "fragment": {"length": "2s"}},
        "stack": {"image": "stack", "engine": "exec", "command": ["run"]},
        "output": {"uri": "pvc://results/a"},
    }
    spec = SimulationJobSpec.model_validate(fields)
    case = plan(spec, storage).cases[1]
    assert case.bag == "pvc://drives/drive/metadata.yaml"
    window = case.window
    row = {
        "case": case.id,
        "bag": case.bag,
        "window": [window.lead_in_start, window.start, window.end],
        "variant": "",
        "values": {},
        "seed": 0,
        "round": 0,
    }
    again = planned_case(row, spec, storage)
    assert again == case
    written = write_fragment(again, source_of(spec), storage, tmp_path / "fragment")
    assert written.name == "fragment.mcap"
    inside = [m for m in read_mcap(written) if window.start <= m.time < window.end]
    assert inside == [m for m in drive() if window.start <= m.time < window.end]
    assert source_of(spec).begin(case, storage, written) == START


COUNTS = {
    "rosbag2_py/STORAGE/talker": 20,
    "rosbag2_py/STORAGE/wbag": 6074,
    "rosbag2_py/STORAGE/convert_a": 150,
    "rosbag2_py/STORAGE/convert_b": 75,
    "rosbag2_tests/STORAGE/cdr_test": 7,
    "rosbag2_tests/STORAGE/bag_with_topics_and_service_events": 10,
}


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("name", COUNTS)
def test_the_recordings_of_rosbag2_s_tests(name: str, storage: str, tmp_path: Path) -> None:
    if not DATA.exists():
        pytest.skip("the recordings of rosbag2's tests are not beside the checkout")
    metadata = DATA / name.replace("STORAGE", storage) / "metadata.yaml"
    made = planned(metadata.resolve(), source(length="5s"))
    assert made.unplanned == []
    found = [
        message
        for case in made.cases
        for message in stream(case, tmp_path / "case.mcap")
        if case.window.start <= message.time < case.window.end
    ]
    assert len(found) == COUNTS[name]


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_another_serialization_is_refused_with_topic_and_encoding(storage: str) -> None:
    if not DATA.exists():
        pytest.skip("the recordings of rosbag2's tests are not beside the checkout")
    text = refused((DATA / "rosbag2_tests" / storage / "wrong_rmw_test/metadata.yaml").resolve())
    assert "_topic holds messages in wrong_format" in text


def test_a_log_of_no_bytes_is_none(tmp_path: Path) -> None:
    metadata = folder(tmp_path / "drive", Form("sqlite3"), [drive()])
    (tmp_path / "drive/drive_0.db3-wal").touch()
    made = planned(metadata, source())
    assert made.unplanned == []
