"""Recordings of each format through a program: the records that it gets have what was recorded."""

import json
import os
import sys
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import NonSeekingReader, make_reader

from bagpipe.binpiped.logic import Command, Deadlines
from bagpipe.binpiped.partition import PartitionRun
from bagpipe.binpiped.planning import Descriptor, fragments
from bagpipe.storage import Storage, StorageError
from tests.mcap_of_bag import COMPRESSIONS, mcap_of
from tests.rosbag2_folders import FORMS, MS, START, Form, Message, drive, folder
from tests.unit.bagpipe.bags import steady, write_bag

STORAGE = Storage({})
SECOND = 1000 * MS
# What a program of the user's would do: it reads a record by MCAP's own library.
PROGRAM = """
import io, json
from bagpipe import binpipe
from mcap.reader import NonSeekingReader
for record in binpipe.read():
    reader = NonSeekingReader(io.BytesIO(record.read()))
    found = [(c.topic, m.log_time, m.data.hex()) for _, c, m in reader.iter_messages()]
    binpipe.write(json.dumps(found).encode(), record.name, **record.fields)
"""


def content(descriptor: Descriptor) -> bytes:
    record = descriptor.open(STORAGE)
    pieces = list(record.pieces())
    assert max(map(len, pieces)) <= 1 << 20
    assert record.size == sum(map(len, pieces))
    return b"".join(pieces)


def rows(data: bytes) -> list[tuple[str, int, bytes]]:
    found = NonSeekingReader(BytesIO(data)).iter_messages()
    return [(channel.topic, message.log_time, message.data) for _, channel, message in found]


def within(descriptor: Descriptor, time: int) -> bool:
    start, end = descriptor.fields["start"], descriptor.fields["end"]
    assert isinstance(start, int)
    assert isinstance(end, int)
    return start <= time < end


def every(found: list[Descriptor]) -> list[tuple[str, int, bytes]]:
    """What the records have in their windows: a chunk may reach beyond one."""
    return sorted(row for one in found for row in rows(content(one)) if within(one, row[1]))


@pytest.mark.parametrize("compression", sorted(COMPRESSIONS))
def test_a_record_of_mcap_is_mcap_with_its_window(compression: str, tmp_path: Path) -> None:
    recorded = steady("/a", 100, SECOND // 10, SECOND) + steady("/b", 10, SECOND, SECOND)
    bag = write_bag(tmp_path / "a.bag", sorted(recorded, key=lambda m: m.time), chunk_bytes=2048)
    mcap = mcap_of(bag, tmp_path / "a.mcap", compression, 256)
    with mcap.open("rb") as stream:
        messages = make_reader(stream).iter_messages()
        whole = sorted((c.topic, m.log_time, m.data) for _, c, m in messages)
    found = fragments(STORAGE, [str(mcap)], 3, [])
    assert [one.name for one in found] == [f"{mcap.as_uri()}#{number}" for number in range(4)]
    assert every(found) == whole
    assert len(whole) == 110
    of_b = [row for row in every(fragments(STORAGE, [str(mcap)], 3, ["/b"])) if row[0] == "/b"]
    assert of_b == [row for row in whole if row[0] == "/b"]
    # It has the chunks of its window alone.
    assert max(len(rows(content(one))) for one in found) < 110 / 2


def halves(recorded: list[Message]) -> list[list[Message]]:
    return [recorded[:30], recorded[30:]]


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_a_record_of_a_folder_is_mcap_with_what_was_recorded_then(
    form: Form, tmp_path: Path
) -> None:
    recorded = sorted((m.topic, m.time, m.data) for m in drive())
    metadata = folder(tmp_path / "drive", form, halves(drive()))
    for named in (str(metadata.parent), f"{metadata.parent.as_uri()}/", f"{tmp_path}/*"):
        found = fragments(STORAGE, [named], 2, [])
        assert [one.name for one in found] == [f"{metadata.as_uri()}#{n}" for n in range(3)]
        assert every(found) == recorded
    # A folder is cut message by message, and what was latched before is in force.
    for one in found:
        before = [] if one.fields["start"] == START else [("/map", START)]
        there = [(topic, time) for topic, time, _ in rows(content(one)) if not within(one, time)]
        assert there == before
    of_a = every(fragments(STORAGE, [str(metadata.parent)], 2, ["/a"]))
    assert of_a == [row for row in recorded if row[0] == "/a"]


def test_files_of_a_folder_are_no_records_of_their_own(tmp_path: Path) -> None:
    metadata = folder(tmp_path / "drive", Form("mcap"), halves(drive()))
    every_file = [f"{metadata.parent}/*.mcap", str(metadata)]
    assert {one.uri for one in fragments(STORAGE, every_file, 2, [])} == {metadata.as_uri()}


def test_a_program_gets_records_of_each_format(tmp_path: Path) -> None:
    metadata = folder(tmp_path / "drive", Form("sqlite3", "", 4), halves(drive()))
    bag = write_bag(tmp_path / "a.bag", steady("/a", 50, SECOND // 10, SECOND), chunk_bytes=2048)
    mcap = mcap_of(bag, tmp_path / "a.mcap", "lz4", 2048)
    path = (("PYTHONPATH", os.pathsep.join(sys.path)),)
    logic = Command((sys.executable, "-c", PROGRAM), path)
    planned = fragments(STORAGE, [str(mcap), str(metadata.parent)], 2, [])
    records = list(PartitionRun(logic, Deadlines(), STORAGE).records(planned))
    assert [record.name for record in records] == [one.name for one in planned]
    answers: list[list[Any]] = [json.loads(record.data) for record in records]
    for one, record, answer in zip(planned, records, answers, strict=True):
        expected = [[topic, time, data.hex()] for topic, time, data in rows(content(one))]
        assert (record.fields, answer) == (one.fields, expected)
    assert len(records) == 6
    assert min(map(len, answers)) > 0


@pytest.mark.parametrize("changed", ["metadata", "file"])
def test_a_folder_that_was_replaced_since_it_was_planned_is_no_record(
    changed: str, tmp_path: Path
) -> None:
    metadata = folder(tmp_path / "drive", Form("mcap"), halves(drive()))
    found = fragments(STORAGE, [str(metadata)], 2, [])
    for file in metadata.parent.glob("*.mcap") if changed == "file" else [metadata]:
        file.write_bytes(file.read_bytes() + b"\n")
        os.utime(file, ns=(START, START))
    with pytest.raises(StorageError, match="is no longer the file that was planned"):
        content(found[0])


@pytest.mark.parametrize(
    ("text", "says"), [("rosbag2: 3", "metadata.yaml"), ("a: [", "metadata.yaml")]
)
def test_a_folder_that_is_none_is_refused_by_name(text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text(text)
    with pytest.raises(StorageError, match=says):
        fragments(STORAGE, [str(tmp_path)], 2, [])
