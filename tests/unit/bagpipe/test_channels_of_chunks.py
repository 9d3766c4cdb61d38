"""A chunk index that names another channel than its chunk's messages have loses none in silence."""

import struct
from pathlib import Path

import pytest

from bagpipe.binpiped.planning import fragments
from bagpipe.pieces import SequencePart
from bagpipe.plan.bag_tail import BagError, BagTail, Chunk, message_times, read_tail
from bagpipe.plan.left_out import check_left_out
from bagpipe.plan.parts import PartError, PartPlanner
from bagpipe.source.bags.stream import fragment_file
from bagpipe.source.bags.truth import chunks_with
from bagpipe.storage import StorageError
from bagpipe.wire.session import SessionError
from tests.unit.bagpipe.mcap_records import channel, mcap
from tests.unit.bagpipe.test_mcap_planning import REINDEX, reindexed, tail_of
from tests.unit.bagpipe.test_rosbag2_planning import STORAGE, planned, source

SECOND = 1_000_000_000
CHANNELS = [channel(1, "/a", "cdr"), channel(2, "/b", "cdr")]
# /a for ten seconds, /b for five.
FIRST = [SECOND * number for number in range(1, 6)]
LAST = [SECOND * number for number in range(6, 11)]
NO_INDEX = "has no index of all its messages"


def entries(data: bytes) -> list[int]:
    """Where the entries of the chunk indexes begin: of each a channel and a place."""
    at, found = struct.unpack_from("<Q", data, len(data) - 28)[0], []
    while data[at] != 2:
        if data[at] == 8:
            found.append(at + 9 + 32 + 4)
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]
    return found


def written(at: Path, *, crooked: bool) -> Path:
    """The statistics don't count channels; the last chunk's index says that it has /b, not /a."""
    data = mcap([{1: FIRST, 2: FIRST}, {1: LAST}], CHANNELS)
    place = entries(data)[1]
    assert data[place : place + 2] == b"\1\0"
    at.write_bytes(data[:place] + b"\2\0" + data[place + 2 :] if crooked else data)
    return at


def test_a_chunk_that_is_left_out_for_its_channel_is_looked_at(tmp_path: Path) -> None:
    for topic in ("/a", "/b"):
        sound = planned(written(tmp_path / "a.mcap", crooked=False), source(topics=[topic]))
        assert sound.unplanned == []
        last = 10 if topic == "/a" else 5
        assert max(case.window.end for case in sound.cases) == last * SECOND + 1
    made = planned(written(tmp_path / "a.mcap", crooked=True), source(topics=["/a"]))
    assert made.cases == []
    assert NO_INDEX in made.unplanned[0].message


@pytest.mark.parametrize("topics", [["/a"], ["/b"], ["/a", "/b"], []])
def test_indexes_without_a_message_are_no_reason_to_refuse(
    topics: list[str], tmp_path: Path
) -> None:
    """Some writers leave one in each chunk for each channel that there is."""
    file = tmp_path / "a.mcap"
    more = [channel(number, f"/{number}", "cdr") for number in range(3, 9)]
    none: dict[int, list[int]] = {number: [] for number in range(3, 9)}
    file.write_bytes(mcap([{1: FIRST, 2: FIRST}, {1: [], 2: LAST, **none}], [*CHANNELS, *more]))
    made = planned(file, source(topics=topics))
    assert made.unplanned == []
    last = 5 if topics == ["/a"] else 10
    assert max(case.window.end for case in made.cases) == last * SECOND + 1
    data = file.read_bytes()
    chunk = read_tail(lambda at, length: data[at : at + length], len(data)).chunks[1]
    times = message_times(lambda at, length: data[at : at + length], chunk)
    assert times == {2: LAST}


def test_a_chunk_that_is_read_is_compared(tmp_path: Path) -> None:
    made = planned(written(tmp_path / "a.mcap", crooked=True), source(length="1h"))
    with pytest.raises(SessionError, match="or has messages of other channels, than the index in"):
        list(fragment_file(made.cases[0], STORAGE).pieces())
    made = planned(written(tmp_path / "a.mcap", crooked=False), source(length="1h"))
    assert b"".join(fragment_file(made.cases[0], STORAGE).pieces())


def test_a_truth_is_looked_for_in_all_chunks_of_the_window(tmp_path: Path) -> None:
    file = tmp_path / "a.mcap"
    (case,) = planned(written(file, crooked=True), source(length="1h")).cases
    with pytest.raises(BagError, match=NO_INDEX):
        chunks_with({"/a"}, case, STORAGE)


def test_pieces_and_records_of_topics_are_looked_for_too(tmp_path: Path) -> None:
    uri = written(tmp_path / "a.mcap", crooked=True).as_uri()
    piece = SequencePart.model_validate({"bag": uri})
    with pytest.raises(PartError, match=NO_INDEX):
        PartPlanner(STORAGE, "cdr").sequence([piece], ["/a"], 0)
    with pytest.raises(StorageError, match=NO_INDEX):
        fragments(STORAGE, [uri], 1.0, ["/a"])


def test_what_is_reindexed_counts_its_channels(tmp_path: Path) -> None:
    sound = written(tmp_path / "a.mcap", crooked=False)
    crooked = written(tmp_path / "b.mcap", crooked=True)
    for data in (sound.read_bytes(), crooked.read_bytes()):
        assert not tail_of(data).counted
        tail = tail_of(reindexed(data, tmp_path))
        assert tail.counted
        assert [chunk.counts for chunk in tail.chunks] == [{1: 10, 2: 5}]


def test_what_statistics_count_is_not_looked_at() -> None:
    chunks = [Chunk(at, at + 1, 0, 9, {1: 1}) for at in range(10_001)]
    looked: list[Chunk] = []
    check_left_out(BagTail(10**6, [], [], chunks), ["/a"], looked.append)
    uncounted = BagTail(10**6, [], [], chunks, counted=False)
    check_left_out(uncounted, [], looked.append)
    assert looked == []
    with pytest.raises(BagError, match="10,001 chunks would have to be looked at") as refused:
        check_left_out(uncounted, ["/a"], looked.append)
    assert refused.value.reason == "BagNotIndexed"
    assert f"with statistics {REINDEX}, or choose" in str(refused.value)
    check_left_out(BagTail(10**6, [], [], chunks[1:], counted=False), ["/a"], looked.append)
    assert looked == chunks[1:]
