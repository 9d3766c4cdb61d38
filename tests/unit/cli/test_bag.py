"""`bagpipe bag`: what is in bags, parts of them, several as one, and what is wrong with them."""

import json
import struct
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

import bagpipe
from bagpipe import MemoryBag
from bagpipe.cli.__main__ import main
from bagpipe.cli.bag_reading import BagFile
from bagpipe.storage.local import LocalBackend
from tests.unit.bagpipe.bags import Recorded, steady, write_bag

SECOND = 1_000_000_000


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Ten seconds of /scan and /imu at 10 Hz, and a latched map, in many small chunks."""
    messages = [Recorded("/map", SECOND, "the map", latching=True)]
    messages += steady("/scan", 100, SECOND // 10, SECOND) + steady("/imu", 50, SECOND // 5, SECOND)
    messages.sort(key=lambda message: message.time)
    return write_bag(tmp_path / "drive.bag", messages, chunk_bytes=1024)


def run(*arguments: str | Path) -> tuple[int, str]:
    ended = CliRunner().invoke(main, ["bag", *(str(argument) for argument in arguments)])
    assert ended.exception is None or isinstance(ended.exception, SystemExit), ended.exception
    return ended.exit_code, ended.output


def as_json(*arguments: str | Path) -> Any:
    status, text = run(*arguments, "--output", "json")
    assert status == 0, text
    return json.loads(text)


def unindexed(bag: Path) -> Path:
    """A copy whose recorder died: the index is cut off and the header names none."""
    data = bag.read_bytes()
    at = data.index(b"index_pos=") + len(b"index_pos=")
    (index,) = struct.unpack_from("<Q", data, at)
    target = bag.with_name("died.bag")
    target.write_bytes((data[:at] + struct.pack("<Q", 0) + data[at + 8 :])[:index])
    return target


def encrypted(bag: Path) -> Path:
    """A copy whose header says that it is."""
    data = bag.read_bytes()
    (length,) = struct.unpack_from("<I", data, 13)
    field = b"encryptor=rosbag/AesCbcEncryptor"
    header = data[17 : 17 + length] + struct.pack("<I", len(field)) + field
    target = bag.with_name("secret.bag")
    target.write_bytes(data[:13] + struct.pack("<I", len(header)) + header + data[17 + length :])
    return target


def test_info_of_an_indexed_bag(bag: Path, tmp_path: Path) -> None:
    found = as_json("info", bag)
    assert (found["bytes"], found["messages"]) == (bag.stat().st_size, 151)
    assert (found["start"], found["end"], found["seconds"]) == (SECOND, 10_900_000_000, 9.9)
    assert (found["index"], found["damage"], found["advice"]) == ("whole", None, None)
    assert found["compressions"] == ["none"]
    assert found["topics"] == [
        {"topic": "/imu", "type": "std_msgs/String", "messages": 50},
        {"topic": "/map", "type": "std_msgs/String", "messages": 1},
        {"topic": "/scan", "type": "std_msgs/String", "messages": 100},
    ]
    by_claim = as_json("info", "pvc://fleet/drive.bag", "--volume", f"fleet={tmp_path}")
    assert by_claim == found | {"bag": "pvc://fleet/drive.bag"}
    status, text = run("info", bag)
    assert (status, "/scan" in text, "1.000000000 to 10.900000000" in text) == (0, True, True)
    assert yaml.safe_load(run("info", bag, "--output", "yaml")[1]) == found


def test_info_reads_only_the_tail_and_the_chunks_heads(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = []
    real = LocalBackend.read

    def counted(self: LocalBackend, path: str, offset: int, length: int, version: str) -> bytes:
        read.append(length)
        return real(self, path, offset, length, version)

    monkeypatch.setattr(LocalBackend, "read", counted)
    chunks = as_json("info", bag)["chunks"]
    assert chunks > 5
    # Its first 16 bytes say what it is.
    assert read[0] == 16
    assert len(read) == 3 + chunks
    assert read[3:] == [256] * chunks


def test_info_agrees_with_what_all_of_the_bag_says(bag: Path) -> None:
    indexed, read = as_json("info", bag), as_json("info", unindexed(bag))
    same = ("messages", "start", "end", "seconds", "topics", "compressions")
    assert {key: read[key] for key in same} == {key: indexed[key] for key in same}
    assert (read["index"], read["damage"]) == ("missing", None)
    assert "`bagpipe bag reindex BAG --to NEW`" in read["advice"]


def test_a_part_has_its_window_its_topics_and_what_is_latched(bag: Path, tmp_path: Path) -> None:
    part = tmp_path / "part.bag"
    words = ("slice", bag, "--start", "2.05", "--end", "4", "--to", part)
    assert as_json(*words, "--topic", "/scan", "--topic", "/map")["messages"] == 20
    made = MemoryBag.open(part)
    assert made.topics == ["/map", "/scan"]
    times = [time for connection, time, _ in made.messages() if connection.topic == "/scan"]
    assert (times[0], times[-1], len(times)) == (3_100_000_000, 4_900_000_000, 19)
    assert [time for connection, time, _ in made.messages(["/map"])] == [3_050_000_000]
    assert as_json("info", part)["index"] == "whole"


def test_a_part_reads_only_the_chunks_that_it_needs(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = MemoryBag.open(bag).slice(2 * SECOND, 3 * SECOND)
    monkeypatch.setattr("bagpipe.cli.bag_reading.BagFile.whole", None)
    as_json("slice", bag, "--start", "1", "--end", "2", "--to", tmp_path / "part.bag")
    assert (tmp_path / "part.bag").read_bytes() == whole.to_bytes()


def test_an_unindexed_bag_is_cut_from_all_of_it(bag: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "1.bag", tmp_path / "2.bag"
    for source, target in ((bag, first), (unindexed(bag), second)):
        as_json("slice", source, "--end", "2", "--topic", "/imu", "--to", target)
    assert first.read_bytes() == second.read_bytes()


def test_two_parts_are_the_bag_again(bag: Path, tmp_path: Path) -> None:
    parts = tmp_path / "a.bag", tmp_path / "b.bag"
    as_json("slice", bag, "--end", "5", "--topic", "/scan", "--to", parts[0])
    as_json("slice", bag, "--start", "5", "--topic", "/scan", "--to", parts[1])
    found = as_json("merge", *parts, "--compression", "lz4", "--to", f"file://{tmp_path}/c.bag")
    assert (found["messages"], found["start"]) == (100, SECOND)
    merged = MemoryBag.open(tmp_path / "c.bag")
    whole = MemoryBag.open(bag).messages(["/scan"])
    assert [(t, bytes(raw)) for _, t, raw in merged.messages()] == [
        (t, bytes(raw)) for _, t, raw in whole
    ]
    assert merged.compressions == ["lz4"]


def test_sound_damaged_and_unreadable_bags_are_distinguished(bag: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.bag"
    cut.write_bytes(bag.read_bytes()[:-3000])
    status, text = run("check", bag)
    assert (status, text) == (0, f"sound  {bag}, 151 whole messages\n")
    status, text = run("check", bag, cut, unindexed(bag), "--output", "json")
    found = {Path(each["bag"]).name: each for each in json.loads(text)}
    assert status == 1
    states = {name: each["state"] for name, each in found.items()}
    assert states == {"drive.bag": "sound", "cut.bag": "damaged", "died.bag": "damaged"}
    assert "copy it again" in found["cut.bag"]["problems"][-1]
    assert found["died.bag"]["problems"][-1].startswith("its index is missing: a job refuses it")
    status, text = run("check", cut, encrypted(bag))
    assert (status, "unreadable" in text) == (2, True)


def test_damage_is_reported_and_parts_of_it_are_refused(bag: Path, tmp_path: Path) -> None:
    data = bytearray(unindexed(bag).read_bytes())
    del data[-700:]
    broken = tmp_path / "broken.bag"
    broken.write_bytes(data)
    status, text = run("info", broken)
    assert (status, "damaged     at byte " in text, " lost" in text) == (0, True, True)
    for words in (("slice", broken), ("merge", bag, broken)):
        status, text = run(*words, "--to", tmp_path / "new.bag")
        assert (status, "reindex" in text) == (2, True), text
    assert not (tmp_path / "new.bag").exists()


@pytest.mark.parametrize("verb", ["info", "slice", "merge", "check"])
def test_what_is_no_bag_of_ours_says_why_and_ends_with_2(
    bag: Path, tmp_path: Path, verb: str
) -> None:
    nothing, text_file = tmp_path / "empty.bag", tmp_path / "text.bag"
    nothing.touch()
    text_file.write_text("no bag at all, but long enough for a header" * 200)
    to = [] if verb in {"info", "check"} else ["--to", str(tmp_path / "new.bag")]
    for file, sentence in (
        (encrypted(bag), 'the bag is encrypted with "rosbag/AesCbcEncryptor"'),
        (nothing, "empty.bag: "),
        (text_file, "text.bag: "),
        (tmp_path / "no.bag", "no.bag can't be read"),
    ):
        status, text = run(verb, file, *to)
        assert (status, sentence in text.replace("\n", " ")) == (2, True), text
        assert "Traceback" not in text
    status, text = run(verb, "pvc://fleet/a.bag", *to)
    assert (status, "give --volume fleet=FOLDER" in text) == (2, True)


def test_wrong_words_are_refused(bag: Path, tmp_path: Path) -> None:
    new = tmp_path / "new.bag"
    for words, sentence in (
        (("slice", bag, "--to", bag), "is there already: choose another name"),
        (("slice", bag, "--to", new, "--topic", "/x"), "has no topic /x; it has /imu, /map, /scan"),
        (
            ("slice", bag, "--to", new, "--start", "3", "--end", "3"),
            "--start must lie before --end",
        ),
        (
            ("slice", bag, "--to", new, "--start", "1000"),
            "drive.bag lasts 9.9 s: --start 1000 lies behind its last message",
        ),
        (
            ("slice", bag, "--to", new, "--start", "9.95", "--end", "1000"),
            "drive.bag lasts 9.9 s: --start 9.95 lies behind",
        ),
        (
            ("slice", unindexed(bag), "--to", new, "--start", "1234567.89"),
            "died.bag lasts 9.9 s: --start 1234567.89 lies behind",
        ),
        (
            ("slice", bag, "--to", "pvc://rec/x.bag"),
            "rec is not on this machine: give --volume rec=",
        ),
        (
            ("merge", bag, "--to", "pvc://rec/x.bag"),
            "rec is not on this machine: give --volume rec=",
        ),
        (("slice", bag, "--to", new, "--end", "1e3"), "1e3 is no number of seconds"),
        (("check", bag, "--memory-budget", "4 gigs"), "write bytes, or a number with KiB"),
        (("merge", bag, "--to", new, "--memory-budget", "1KiB"), "are more than --memory-budget"),
        (("slice", bag, "--to", new, "--memory-budget", "1KiB"), "cut a shorter part"),
    ):
        status, text = run(*words)
        assert (status, sentence in " ".join(text.split())) == (2, True), text
    assert not new.exists()


def test_a_new_bag_goes_into_a_claim_that_has_a_folder(bag: Path, tmp_path: Path) -> None:
    volume = ("--volume", f"rec={tmp_path}")
    found = as_json("slice", bag, "--end", "1", "--to", "pvc://rec/part.bag", *volume)
    assert found["bytes"] == (tmp_path / "part.bag").stat().st_size


def test_what_can_t_be_written_is_refused_before_anything_is_read(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(BagFile, "part", None)
    monkeypatch.setattr(BagFile, "whole", None)
    for verb in ("slice", "merge"):
        assert "is there already" in run(verb, bag, "--to", bag)[1]


def record(fields: list[bytes], data: bytes = b"") -> bytes:
    header = b"".join(struct.pack("<I", len(field)) + field for field in fields)
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def test_a_bag_of_format_1_2_is_read_and_a_job_s_refusal_foretold(tmp_path: Path) -> None:
    kind = [b"topic=/a", b"md5=992ce8a1687cec8c8bd883ec73ca41d1", b"type=std_msgs/String"]
    old = tmp_path / "old.bag"
    old.write_bytes(
        b"#ROSBAG V1.2\n"
        + record([b"op=\x03", b"index_pos=" + struct.pack("<Q", 0)])
        + record([b"op=\x01", *kind, b"def=string data\n"])
        + record(
            [b"op=\x02", *kind, b"sec=" + struct.pack("<I", 5), b"nsec=" + struct.pack("<I", 1)],
            b"\x01\x00\x00\x00x",
        )
    )
    found = as_json("info", old)
    assert (found["messages"], found["start"], found["index"]) == (1, 5_000_000_001, "none")
    assert found["advice"].startswith("format 1.2, which a job refuses")
    assert run("check", old) == (0, f"sound  {old}, 1 whole messages\n")


def test_an_empty_bag_is_no_error(tmp_path: Path) -> None:
    empty = tmp_path / "empty.bag"
    empty.write_bytes(MemoryBag.writer().finish().view())
    found = as_json("info", empty)
    assert (found["messages"], found["start"], found["seconds"]) == (0, None, None)
    assert run("info", empty)[0] == 0


def test_without_the_native_module_it_says_what_is_missing(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert bagpipe.MemoryBag is MemoryBag

    def missing(_name: str) -> None:
        raise ModuleNotFoundError

    monkeypatch.setattr("importlib.import_module", missing)
    for verb in ("info", "check"):
        status, text = run(verb, bag)
        assert (status, "needs the native module bagpipe_bag" in text) == (2, True)
