"""Reading a bag's tail: what a planner must know, and every way in which a file can be wrong."""

import itertools
import struct
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bagpipe.plan.bag_tail import BagError, BagTail, message_times, read_tail
from tests.recording import fetch
from tests.unit.bagpipe.bags import Recorded, steady, write_bag


def tail_of(data: bytes) -> BagTail:
    return read_tail(lambda offset, length: data[offset : offset + length], len(data))


@pytest.fixture(scope="module")
def two_topics(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    messages = [*steady("/scan", 200, 10_000_000), Recorded("map", 2_500_000_000, "m", True)]
    folder = tmp_path_factory.mktemp("bags")
    messages.sort(key=lambda message: message.time)
    return write_bag(folder / "two.bag", messages, chunk_bytes=2048).read_bytes()


def test_counts_times_and_connections(two_topics: bytes) -> None:
    tail = tail_of(two_topics)
    assert [(c.topic, c.in_force) for c in tail.connections] == [("/scan", 0), ("/map", 1)]
    assert sum(sum(chunk.counts.values()) for chunk in tail.chunks) == 201
    assert len(tail.chunks) > 3
    assert tail.chunks[0].start_time == 1_000_000_000
    assert max(chunk.end_time for chunk in tail.chunks) == 2_990_000_000


def test_chunks_cover_the_file_up_to_the_index(two_topics: bytes) -> None:
    tail = tail_of(two_topics)
    for chunk, following in itertools.pairwise(tail.chunks):
        assert chunk.end == following.offset
    assert tail.chunks[-1].end == tail.connections[0].offset


def test_reads_only_the_head_and_the_tail(two_topics: bytes) -> None:
    read: list[tuple[int, int]] = []

    def ranged(offset: int, length: int) -> bytes:
        read.append((offset, length))
        return two_topics[offset : offset + length]

    tail = read_tail(ranged, len(two_topics))
    assert len(read) == 2
    assert read[1][0] == tail.chunks[-1].end


def test_the_real_pr2_recording() -> None:
    tail = tail_of(fetch().read_bytes())
    assert [c.topic for c in tail.connections] == ["/joint_states"]
    assert [chunk.counts[0] for chunk in tail.chunks] == [365, 365, 365, 365, 138]


@pytest.mark.parametrize(
    ("data", "reason", "words"),
    [
        (b"", "BagCut", "0 bytes"),
        (b"PK\x03\x04 not a bag at all", "BagUnreadable", "expected b'#ROSBAG V2.0"),
        (b"#ROSBAG V1.2\n", "BagUnreadable", "bag 2.0"),
        (b"#ROSBAG V2.0\n", "BagUnreadable", "no file header record at byte 13"),
        (b"#ROSBAG V2.0\n\xff\xff\xff\xff", "BagCut", "needs 4294967295 bytes"),
    ],
)
def test_what_is_no_bag_is_refused(data: bytes, reason: str, words: str) -> None:
    with pytest.raises(BagError, match=words) as refused:
        tail_of(data)
    assert refused.value.reason == reason


def test_a_bag_cut_anywhere_is_refused(two_topics: bytes) -> None:
    for length in range(0, len(two_topics), 37):
        with pytest.raises(BagError) as refused:
            tail_of(two_topics[:length])
        assert refused.value.reason in {"BagCut", "BagUnreadable"}
    with pytest.raises(BagError, match=rf"ends at byte {len(two_topics) // 2}") as cut:
        tail_of(two_topics[: len(two_topics) // 2])
    assert cut.value.reason == "BagCut"


def test_the_error_of_a_bag_without_an_index_names_reindex(two_topics: bytes) -> None:
    at = two_topics.index(b"index_pos=") + len(b"index_pos=")
    unindexed = two_topics[:at] + struct.pack("<Q", 0) + two_topics[at + 8 :]
    with pytest.raises(BagError, match="`bagpipe bag reindex BAG --to NEW` writes it") as refused:
        tail_of(unindexed)
    assert refused.value.reason == "BagNotIndexed"


def test_a_bag_without_messages_is_empty(tmp_path: Path) -> None:
    with pytest.raises(BagError) as refused:
        tail_of(write_bag(tmp_path / "none.bag", []).read_bytes())
    assert refused.value.reason == "BagEmpty"


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_damage_is_an_error_and_never_another_exception(
    two_topics: bytes, data: st.DataObject
) -> None:
    damaged = bytearray(two_topics)
    tail_at = tail_of(two_topics).chunks[-1].end
    for _ in range(data.draw(st.integers(1, 4))):
        region = data.draw(st.sampled_from([(0, 200), (tail_at, len(damaged))]))
        damaged[data.draw(st.integers(region[0], region[1] - 1))] = data.draw(st.integers(0, 255))
    try:
        tail = tail_of(bytes(damaged))
    except BagError as error:
        assert error.reason.startswith("Bag")
    else:
        assert all(0 < chunk.offset < chunk.end <= len(damaged) for chunk in tail.chunks)


def test_the_index_behind_a_chunk_has_the_times_of_its_messages(two_topics: bytes) -> None:
    tail = tail_of(two_topics)
    chunk = tail.chunks[0]
    times = message_times(lambda at, length: two_topics[at : at + length], chunk)
    assert {connection: len(found) for connection, found in times.items()} == chunk.counts
    assert min(map(min, times.values())) == chunk.start_time
    assert max(map(max, times.values())) == chunk.end_time


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_a_damaged_index_behind_a_chunk_is_an_error_or_within_the_chunk(
    two_topics: bytes, data: st.DataObject
) -> None:
    chunk = tail_of(two_topics).chunks[0]
    damaged = bytearray(two_topics)
    for _ in range(data.draw(st.integers(1, 4))):
        regions = [(chunk.offset, chunk.offset + 80), (chunk.end - 300, chunk.end)]
        region = data.draw(st.sampled_from(regions))
        damaged[data.draw(st.integers(region[0], region[1] - 1))] = data.draw(st.integers(0, 255))
    try:
        times = message_times(lambda at, length: bytes(damaged[at : at + length]), chunk)
    except BagError as error:
        assert error.reason.startswith("Bag")
    else:
        assert all(chunk.start_time <= t <= chunk.end_time for each in times.values() for t in each)
