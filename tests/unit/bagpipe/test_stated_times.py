"""A chunk index that states less time than its chunk has messages of loses none in silence."""

import struct
from pathlib import Path

import pytest

from bagpipe.plan.bag_tail import BagError, Chunk
from bagpipe.plan.stated_times import compared, stated_by
from bagpipe.source.bags.opening import opened
from bagpipe.source.bags.stream import fragment_file
from bagpipe.source.bags.truth import chunks_with
from bagpipe.wire.session import SessionError
from tests.rosbag2_folders import Form, drive, folder
from tests.unit.bagpipe.mcap_records import HEAD, channel, mcap
from tests.unit.bagpipe.test_mcap_planning import REINDEX, reindexed
from tests.unit.bagpipe.test_rosbag2_planning import STORAGE, planned, source, stream

SECOND = 1_000_000_000
# Two chunks over the same ten seconds, so that the statistics know of none that is left out.
TIMES = [SECOND * number for number in range(1, 11)]
CHUNKS = [{1: TIMES}, {1: [time + 1 for time in TIMES]}]


def written(at: Path, last: int) -> Path:
    """The first chunk's index states that its last message lies at `last`."""
    data = mcap(CHUNKS, [channel(1, "/a", "cdr")])
    honest = struct.pack("<QQQ", TIMES[0], TIMES[-1], len(HEAD))
    assert data.count(honest) == 1
    at.write_bytes(data.replace(honest, struct.pack("<QQQ", TIMES[0], last, len(HEAD))))
    return at


def test_a_fragment_with_a_chunk_that_states_other_times_ends_as_errored(tmp_path: Path) -> None:
    made = planned(written(tmp_path / "a.mcap", TIMES[-1]), source())
    sound = [b"".join(fragment_file(case, STORAGE).pieces()) for case in made.cases]
    assert len(sound) == 5
    assert all(len(each) > 500 for each in sound)
    made = planned(written(tmp_path / "b.mcap", TIMES[2]), source())
    assert made.unplanned == []
    first, *_, last = sorted(made.cases, key=lambda case: case.window.start)
    with pytest.raises(
        SessionError, match=r"b.mcap: a chunk states other times, or has"
    ) as refused:
        list(fragment_file(first, STORAGE).pieces())
    assert refused.value.reason == "BagUnreadable"
    assert REINDEX in str(refused.value)
    assert b"".join(fragment_file(last, STORAGE).pieces())
    with pytest.raises(BagError, match="a chunk states other times"):
        chunks_with({"/a"}, first, STORAGE)


def test_a_recording_that_states_other_times_is_whole_once_it_is_reindexed(tmp_path: Path) -> None:
    crooked = written(tmp_path / "b.mcap", TIMES[2])
    (tmp_path / "a.mcap").write_bytes(reindexed(crooked.read_bytes(), tmp_path))
    chunks = opened((tmp_path / "a.mcap").as_uri(), STORAGE).tail.chunks
    assert sum(sum(chunk.counts.values()) for chunk in chunks) == 2 * len(TIMES)
    made = planned(tmp_path / "a.mcap", source())
    assert made.unplanned == []
    assert all(b"".join(fragment_file(case, STORAGE).pieces()) for case in made.cases)


def test_parts_of_folders_are_compared_too(tmp_path: Path) -> None:
    metadata = folder(tmp_path / "drive", Form("mcap"), [drive()])
    (case,) = planned(metadata, source(length="1h")).cases
    assert stream(case, tmp_path / "sound.mcap")
    (file,) = tmp_path.glob("drive/*.mcap")
    chunks = opened(file.as_uri(), STORAGE).tail.chunks
    chunk = next(chunk for chunk in chunks if chunk.start_time < chunk.end_time)
    honest = struct.pack("<QQQ", chunk.start_time, chunk.end_time, chunk.offset)
    data = file.read_bytes()
    assert data.count(honest) == 1
    # The footer's CRC-32 of the summary, which what wrote the lie would have made of it.
    crooked = bytearray(data.replace(honest, honest[:8] + honest[:8] + honest[16:]))
    crooked[-12:-8] = bytes(4)
    file.write_bytes(crooked)
    (case,) = planned(metadata, source(length="1h")).cases
    with pytest.raises(SessionError, match="a chunk states other times"):
        stream(case, tmp_path / "crooked.mcap")


@pytest.mark.parametrize("size", [1, 7, 9, 25, 1000])
def test_pieces_of_any_size_state_the_same(size: int, tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", TIMES[-1])
    chunks = opened(path.as_uri(), STORAGE).tail.chunks
    data = path.read_bytes()[: chunks[-1].end]
    pieces = [data[at : at + size] for at in range(0, len(data), size)]
    assert b"".join(compared(pieces, stated_by(chunks))) == data
    with pytest.raises(BagError):
        list(compared(pieces, stated_by(chunks[:1])))


def test_chunks_of_bags_state_nothing_to_compare_with() -> None:
    assert stated_by([Chunk(1, 9, 2, 3, {1: 1})]) == ""
