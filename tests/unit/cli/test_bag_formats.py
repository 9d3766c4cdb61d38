"""`bagpipe bag` over MCAP and folders of rosbag2: what goes in comes out, message by message."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

from bagpipe import MemoryBag
from bagpipe.cli.__main__ import main
from tests.mcap_of_bag import mcap_of
from tests.rosbag2_folders import FORMS, MS, START, Form, Message, drive, folder, read_mcap
from tests.unit.bagpipe.bags import Recorded, steady, write_bag

SECOND = 1000 * MS
DATA = next(
    (
        found
        for parent in Path(__file__).parents
        if (found := parent / "shared" / "data" / "rosbag2").exists()
    ),
    None,
)


def run(*arguments: str | Path) -> tuple[int, str]:
    ended = CliRunner().invoke(main, ["bag", *(str(argument) for argument in arguments)])
    assert ended.exception is None or isinstance(ended.exception, SystemExit), ended.exception
    return ended.exit_code, ended.output


def as_json(*arguments: str | Path) -> Any:
    status, text = run(*arguments, "--output", "json")
    assert status == 0, text
    return json.loads(text)


def complaint(*arguments: str | Path) -> str:
    status, text = run(*arguments)
    assert status == 2, text
    return text


def halves(messages: list[Message]) -> list[list[Message]]:
    return [messages[: len(messages) // 2], messages[len(messages) // 2 :]]


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_a_folder_comes_through_every_verb_as_it_was(form: Form, tmp_path: Path) -> None:
    messages = drive()
    place = folder(tmp_path / "drive", form, halves(messages)).parent
    found = as_json("info", place)
    assert (found["messages"], found["start"], found["damage"]) == (61, START, None)
    assert found["topics"][2] == {"topic": "/map", "type": "std_msgs/msg/String", "messages": 1}
    assert run("check", place)[0] == 0
    whole = tmp_path / "whole.mcap"
    made = as_json("convert", place, "--to", whole, "--compression", "zstd")
    assert (made["messages"], made["start"]) == (61, START)
    assert made["end"] == max(each.time for each in messages)
    assert read_mcap(whole) == messages
    for name, verb in (("again", "convert"), ("mended", "reindex")):
        target = tmp_path / f"{name}.mcap"
        as_json(verb, whole, "--to", target, "--compression", "lz4")
        assert read_mcap(target) == messages
        with target.open("rb") as stream:
            summary = make_reader(stream).get_summary()
        assert summary is not None
        assert {index.compression for index in summary.chunk_indexes} == {"lz4"}
    early, late, both = (tmp_path / f"{name}.mcap" for name in ("early", "late", "both"))
    as_json("slice", place, "--end", "3", "--to", early)
    as_json("slice", place, "--start", "3", "--topic", "/a", "--topic", "/b", "--to", late)
    as_json("merge", late, early, "--to", both)
    assert read_mcap(both) == messages
    assert run("check", both, whole, early)[0] == 0


def test_a_part_begins_with_what_was_latched(tmp_path: Path) -> None:
    for form in (Form("mcap"), Form("sqlite3")):
        place = folder(tmp_path / form.storage, form, halves(drive())).parent
        target = tmp_path / f"{form.storage}.mcap"
        made = as_json("slice", place, "--start", "2", "--end", "4", "--to", target)
        first, *rest = read_mcap(target)
        assert (first.topic, first.time) == ("/map", START + 2 * SECOND)
        window = (START + 2 * SECOND, START + 4 * SECOND)
        assert rest == [m for m in drive() if window[0] <= m.time < window[1]]
        assert made["messages"] == 1 + len(rest) == 21


def test_a_part_of_mcap_reads_only_the_chunks_that_it_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    metadata = folder(tmp_path / "drive", Form("mcap"), [drive(2000)])
    file = metadata.with_name("drive_0.mcap")
    asked = []
    from bagpipe.storage import Storage  # noqa: PLC0415  patched below

    real = Storage.pieces

    def pieces(self: Storage, uri: str, ranges: list[tuple[int, int]], *rest: Any) -> Any:
        asked.append(sum(length for _, length in ranges))
        return real(self, uri, ranges, *rest)

    monkeypatch.setattr(Storage, "pieces", pieces)
    target = tmp_path / "part.mcap"
    as_json("slice", file, "--start", "100", "--end", "101", "--to", target)
    assert len(read_mcap(target)) == 11
    assert len(asked) == 1
    assert asked[0] < file.stat().st_size / 10


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    messages = [*steady("/scan", 50, SECOND // 10, SECOND), Recorded("/map", SECOND, "m", True)]
    messages.sort(key=lambda message: message.time)
    return write_bag(tmp_path / "drive.bag", messages, chunk_bytes=1024)


def content(bag: Path) -> list[tuple[Any, ...]]:
    return [
        (c.topic, c.type, c.md5sum, c.definition, c.callerid, c.latching, time, bytes(raw))
        for c, time, raw in MemoryBag.open(bag).messages()
    ]


def test_a_bag_becomes_mcap_and_a_bag_again(bag: Path, tmp_path: Path) -> None:
    middle, back = tmp_path / "middle.mcap", tmp_path / "back.bag"
    as_json("convert", bag, "--to", middle, "--compression", "zstd")
    assert as_json("info", middle)["messages"] == 51
    as_json("convert", middle, "--to", back, "--compression", "bz2")
    assert content(back) == content(bag)
    assert len(content(bag)) == 51
    # As MCAP's own converter makes it.
    theirs = mcap_of(bag, tmp_path / "theirs.mcap", "lz4", 2048)
    as_json("convert", theirs, "--to", tmp_path / "theirs.bag")
    assert content(tmp_path / "theirs.bag") == content(bag)


def test_what_was_cut_is_mended(bag: Path, tmp_path: Path) -> None:
    place = folder(tmp_path / "drive", Form("mcap"), [drive()]).parent
    cut = place / "drive_0.mcap"
    cut.write_bytes(cut.read_bytes()[:2500])
    found = as_json("info", cut)
    assert found["index"] == "missing"
    assert "`bagpipe bag reindex`" in found["advice"]
    assert "bytes of a record" in found["damage"]["description"]
    status, text = run("check", cut)
    assert (status, "are lost" in text) == (1, True)
    assert "`bagpipe bag reindex` saves what is whole" in complaint(
        "slice", cut, "--to", tmp_path / "part.mcap"
    )
    made = as_json("reindex", cut, "--to", tmp_path / "whole.mcap")
    assert made["damage"] is not None
    kept = read_mcap(tmp_path / "whole.mcap")
    assert kept == drive()[: len(kept)]
    assert 0 < made["messages"] == len(kept) < 61
    assert run("check", tmp_path / "whole.mcap")[0] == 0
    data = bag.read_bytes()
    bag.write_bytes(data[: len(data) // 2])
    made = as_json("reindex", bag, "--to", tmp_path / "whole.bag")
    assert run("check", tmp_path / "whole.bag")[0] == 0
    assert 0 < made["messages"] < 51


def test_check_compares_a_folder_with_its_metadata(tmp_path: Path) -> None:
    metadata = folder(tmp_path / "drive", Form("sqlite3"), [drive()])
    metadata.write_text(metadata.read_text().replace("message_count: 61", "message_count: 62"))
    status, text = run("check", metadata.parent)
    assert status == 1
    assert "metadata.yaml counts 62 messages, and the files hold 61" in text.replace("\n", " ")


def test_what_can_t_be_is_refused_with_a_sentence(bag: Path, tmp_path: Path) -> None:
    place = folder(tmp_path / "drive", Form("sqlite3"), [drive()]).parent
    new = tmp_path / "new.bag"
    text = complaint("convert", place, "--to", new)
    assert "/map has messages in cdr, and a bag holds ROS 1's" in text
    assert str(place) in text
    assert "must end in .bag or .mcap" in complaint("convert", place, "--to", tmp_path / "a.db3")
    assert "makes them alike first" in complaint("merge", bag, place, "--to", new)
    assert "has no topic /c; it has /a, /b" in complaint(
        "slice", place, "--topic", "/c", "--to", tmp_path / "a.mcap"
    )
    assert "--start lies behind" in complaint(
        "slice", place, "--start", "99", "--to", tmp_path / "a.mcap"
    )
    assert "MCAP has no bz2" in complaint(
        "reindex", place, "--to", tmp_path / "a.mcap", "--compression", "bz2"
    )
    assert "--memory-budget allows more" in complaint("info", place, "--memory-budget", "1000")
    assert "it is a folder, not a file" in complaint("info", tmp_path)
    assert not new.exists()


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_a_folder_in_a_claim_is_copied_here(form: Form, tmp_path: Path) -> None:
    folder(tmp_path / "claim" / "drive", form, halves(drive()))
    volume = ("--volume", f"drives={tmp_path / 'claim'}")
    for where in ("pvc://drives/drive", "pvc://drives/drive/", "pvc://drives/drive/metadata.yaml"):
        assert as_json("info", where, *volume)["messages"] == 61
    text = complaint("info", "pvc://drives/drive", *volume, "--memory-budget", "1000")
    assert "--memory-budget" in text
    as_json("convert", "pvc://drives/drive", "--to", "pvc://drives/one.mcap", *volume)
    assert read_mcap(tmp_path / "claim" / "one.mcap") == drive()


COUNTS = {"talker": 20, "wbag": 6074, "convert_a": 150, "convert_b": 75}
OTHERS = {"cdr_test": 7, "bag_with_topics_and_service_events": 10}
REAL = [f"rosbag2_py/{s}/{n}" for n in COUNTS for s in ("mcap", "sqlite3")]
REAL += [f"rosbag2_tests/{s}/{n}" for n in OTHERS for s in ("mcap", "sqlite3")]


@pytest.mark.parametrize("name", REAL)
def test_real_recordings_come_through_equal(name: str, tmp_path: Path) -> None:
    if DATA is None:
        pytest.skip("the recordings of rosbag2's tests are not beside the checkout")
    place = shutil.copytree(DATA / name, tmp_path / "recording")
    count = (COUNTS | OTHERS)[Path(name).name]
    found = as_json("info", place)
    assert found["messages"] == count
    assert run("check", place)[0] == 0
    whole, again, back = (tmp_path / f"{each}.mcap" for each in ("whole", "again", "back"))
    as_json("convert", place, "--to", whole, "--compression", "zstd")
    as_json("convert", whole, "--to", again, "--compression", "lz4")
    everything = sorted(read_mcap(whole))
    assert len(everything) == count
    # MCAP's own library reads the files of MCAP themselves.
    if "/mcap/" in name:
        assert sorted(m for file in place.glob("*.mcap") for m in read_mcap(file)) == everything
    assert sorted(read_mcap(again)) == everything
    middle = (found["end"] - found["start"]) // 2
    at = f"{middle // SECOND}.{middle % SECOND:09d}"
    as_json("slice", place, "--end", at, "--to", tmp_path / "early.mcap")
    as_json("slice", place, "--start", at, "--to", tmp_path / "late.mcap")
    as_json("merge", tmp_path / "early.mcap", tmp_path / "late.mcap", "--to", back)
    parts = read_mcap(back)
    for message in everything:
        parts.remove(message)
    # Latched ones stand at the start of the later part as well.
    assert {message.time for message in parts} <= {found["start"] + middle}
