"""Cutting: each message counts once, warm-up and latched state come along, reads stay few."""

import itertools

from hypothesis import given, settings
from hypothesis import strategies as st

from bagpipe.plan.bag_tail import BagTail, Chunk, Connection, read_tail
from bagpipe.plan.fragments import cut
from tests.recording import fetch

SECOND = 1_000_000_000


def connection(identity: int, topic: str, latching: bool = False) -> Connection:
    return Connection(identity, topic, "std_msgs/String", "/recorded", latching, 0, 10)


def tail_with(chunks: list[tuple[float, float, dict[int, int]]], *topics: Connection) -> BagTail:
    """A tail of chunks (start s, end s, counts), each of 1,000 bytes."""
    made = [
        Chunk(1000 * (n + 1), 1000 * (n + 2), int(start * SECOND), int(end * SECOND), counts)
        for n, (start, end, counts) in enumerate(chunks)
    ]
    return BagTail(1000 * (len(chunks) + 2), list(topics), made)


SCAN = connection(0, "/scan")


def test_the_real_pr2_recording_gives_four_fragments_of_four_seconds() -> None:
    data = fetch().read_bytes()
    tail = read_tail(lambda offset, length: data[offset : offset + length], len(data))
    fragments = cut(tail, ["/joint_states"], 4 * SECOND, SECOND)
    lengths = [round((f.window.end - f.window.start) / SECOND, 2) for f in fragments]
    assert lengths == [3.69, 3.65, 4.66, 4.0]
    assert [f.window.start - f.window.lead_in_start for f in fragments] == [0, *[SECOND] * 3]


@settings(max_examples=200, deadline=None)
@given(
    gaps=st.lists(st.integers(0, 3 * SECOND), min_size=1, max_size=40),
    length=st.integers(SECOND // 10, 20 * SECOND),
    warm_up=st.integers(0, 2 * SECOND),
)
def test_windows_are_adjacent_and_their_ranges_hold_their_chunks(
    gaps: list[int], length: int, warm_up: int
) -> None:
    chunks, at = [], 0
    for number, gap in enumerate(gaps):
        chunks.append(Chunk(1000 * (number + 1), 1000 * (number + 2), at, at + gap, {0: 1}))
        at += gap
    fragments = cut(BagTail(10**6, [SCAN], chunks), ["/scan"], length, warm_up)
    assert fragments[0].window.start == 0
    assert fragments[-1].window.end == at + 1
    for before, after in itertools.pairwise(fragments):
        assert before.window.end == after.window.start
    for fragment in fragments:
        window = fragment.window
        assert window.lead_in_start <= window.start < window.end
        covered = {byte for o, n in fragment.ranges for byte in range(o, o + n, 1000)}
        for chunk in chunks:
            if chunk.end_time >= window.lead_in_start and chunk.start_time < window.end:
                assert chunk.offset in covered


def test_cuts_move_to_a_near_chunk_boundary_and_no_further() -> None:
    tail = tail_with([(0, 3.6, {0: 9}), (3.7, 6.4, {0: 9}), (6.5, 12, {0: 9})], SCAN)
    starts = [f.window.start / SECOND for f in cut(tail, [], 4 * SECOND, 0)]
    assert starts == [0, 3.7, 8.0]


def test_a_short_remainder_joins_the_last_fragment() -> None:
    tail = tail_with([(0, 4.5, {0: 9})], SCAN)
    assert len(cut(tail, [], 4 * SECOND, 0)) == 1


def test_latched_state_before_the_window_comes_along() -> None:
    chunks = [(0.0, 1.0, {0: 5, 1: 1}), (1.5, 7.9, {0: 5}), (8.0, 12.0, {0: 5})]
    tail = tail_with(chunks, SCAN, connection(1, "/map", latching=True))
    last = cut(tail, [], 4 * SECOND, 0)[-1]
    assert last.window.start == 8 * SECOND
    assert last.ranges == [(1000, 1000), (3000, 1000)]


def test_of_overlapping_chunks_all_that_may_hold_the_newest_latched_message_come_along() -> None:
    chunks = [(0.0, 5.0, {1: 1}), (1.0, 2.0, {1: 1}), (8.0, 12.0, {0: 5})]
    tail = tail_with(chunks, SCAN, connection(1, "/map", latching=True))
    assert cut(tail, [], 4 * SECOND, 0)[-1].ranges == [(1000, 3000)]


def test_chunks_without_the_topics_are_not_read() -> None:
    camera = connection(1, "/camera")
    chunks = [(0.0, 1.0, {1: 5}), (1.0, 2.0, {0: 5}), (2.0, 3.0, {1: 5}), (3.0, 4.0, {0: 1})]
    (only,) = cut(tail_with(chunks, SCAN, camera), ["/scan"], 60 * SECOND, 0)
    assert only.ranges == [(2000, 1000), (4000, 1000)]
    assert only.messages == 6
    assert only.window.start == SECOND


def test_no_chunk_with_the_topics_gives_no_fragment() -> None:
    assert cut(tail_with([(0, 1, {0: 1})], SCAN), ["/other"], SECOND, 0) == []


def test_adjacent_chunks_are_one_read() -> None:
    chunks = [(float(n), n + 0.9, {0: 5}) for n in range(10)]
    (only,) = cut(tail_with(chunks, SCAN), [], 60 * SECOND, 0)
    assert only.ranges == [(1000, 10_000)]
