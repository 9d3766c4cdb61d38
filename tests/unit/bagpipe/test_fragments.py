"""Cutting: each message counts once, warm-up and latched state come along, reads stay few."""

import itertools
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bagpipe.plan.bag_tail import BagError, BagTail, Chunk, Connection, message_times, read_tail
from bagpipe.plan.by_time import ChunksByTime
from bagpipe.plan.fragments import FragmentPlan, Window, cut, cut_one
from tests.recording import fetch
from tests.unit.bagpipe.bags import Recorded, steady, write_bag

SECOND = 1_000_000_000


def connection(identity: int, topic: str, in_force: int = 0) -> Connection:
    return Connection(identity, topic, "std_msgs/String", "/recorded", "ros1", in_force, "", 0, 10)


def tail_with(chunks: list[tuple[float, float, dict[int, int]]], *topics: Connection) -> BagTail:
    """A tail of chunks (start s, end s, counts), each of 1,000 bytes."""
    made = [
        Chunk(1000 * (n + 1), 1000 * (n + 2), int(start * SECOND), int(end * SECOND), counts)
        for n, (start, end, counts) in enumerate(chunks)
    ]
    return BagTail(1000 * (len(chunks) + 2), [], list(topics), made)


SCAN = connection(0, "/scan")


def test_the_real_pr2_recording_gives_four_fragments_of_four_seconds() -> None:
    data = fetch().read_bytes()
    tail = read_tail(lambda offset, length: data[offset : offset + length], len(data))
    fragments = cut(tail, ["/joint_states"], 4 * SECOND, SECOND)
    lengths = [round((f.window.end - f.window.start) / SECOND, 2) for f in fragments]
    assert lengths == [3.69, 3.65, 4.66, 4.0]
    assert [f.window.start - f.window.lead_in_start for f in fragments] == [0, *[SECOND] * 3]


@settings(max_examples=300, deadline=None)
@given(
    spans=st.lists(st.tuples(st.integers(0, 60), st.integers(0, 60)), max_size=50),
    windows=st.lists(st.tuples(st.integers(-5, 130), st.integers(0, 40)), min_size=1, max_size=9),
)
def test_a_window_finds_the_chunks_that_reach_into_it_by_their_first_times(
    spans: list[tuple[int, int]], windows: list[tuple[int, int]]
) -> None:
    chunks = [Chunk(n, n + 1, at, at + lasts, {}) for n, (at, lasts) in enumerate(spans)]
    for start, length in windows:
        wanted = [c for c in chunks if c.start_time < start + length and c.end_time >= start]
        found = ChunksByTime(chunks).near(start, start + length)
        assert found == sorted(wanted, key=lambda chunk: chunk.start_time)


class Compared(int):
    """A time that counts how often such times are compared."""

    times = 0

    def __ge__(self, other: int) -> bool:
        Compared.times += 1
        return int(self) >= other

    def __lt__(self, other: int) -> bool:
        Compared.times += 1
        return int(self) < other


def test_a_chunk_that_spans_the_recording_costs_no_window_a_look_at_all_before_it() -> None:
    spans = [(0, 10_000), *((at, at + 1) for at in range(10_000))]
    by_time = ChunksByTime(Chunk(a, a + 1, a, Compared(b), {0: 1}) for a, b in spans)
    for start in range(0, 10_000, 100):
        assert 10 <= len(by_time.near(start, start + 10)) <= 13
    # A hundred windows of a dozen chunks, where all before them are half a million.
    assert Compared.times < 100 * 200


def test_chunks_that_all_span_the_recording_are_refused_where_they_make_too_many_pieces() -> None:
    spanning = tail_with([(0.0, 9_999.0, {0: 5})] * 2_000, SCAN)
    assert len(cut(spanning, ["/scan"], 1_000 * SECOND, 0)) == 10
    with pytest.raises(BagError, match="overlap"):
        cut(spanning, ["/scan"], SECOND, 0)


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
    fragments = cut(BagTail(10**6, [], [SCAN], chunks), ["/scan"], length, warm_up)
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


@pytest.mark.parametrize(
    ("boundaries", "cut_at"),
    [
        ([3 * SECOND], 3 * SECOND),
        ([3 * SECOND - 1], 4 * SECOND),
        ([5 * SECOND], 5 * SECOND),
        ([5 * SECOND + 1], 4 * SECOND),
        ([3_400_000_000, 4_500_000_000], 4_500_000_000),
        ([3_600_000_000, 4_500_000_000], 3_600_000_000),
        ([3_500_000_000, 4_500_000_000], 3_500_000_000),  # as near: the earlier one
        ([3_800_000_000, 4 * SECOND, 4_100_000_000], 4 * SECOND),
    ],
)
def test_a_cut_moves_by_a_quarter_of_the_length_at_most(boundaries: list[int], cut_at: int) -> None:
    times = [0, *boundaries, 8 * SECOND - 1]
    chunks = [
        Chunk(1000 * n, 1000 * n + 1000, start, end - 1, {0: 1})
        for n, (start, end) in enumerate(itertools.pairwise(times))
    ]
    first, second = cut(BagTail(10**6, [], [SCAN], chunks), [], 4 * SECOND, 0)
    assert (first.window.end, second.window.start) == (cut_at, cut_at)


@pytest.mark.parametrize(("end", "ends"), [(5 * SECOND, [4, 5]), (5 * SECOND - 1, [5])])
def test_a_remainder_of_a_quarter_of_the_length_is_a_fragment(end: int, ends: list[int]) -> None:
    tail = BagTail(10**6, [], [SCAN], [Chunk(1000, 2000, 0, end - 1, {0: 9})])
    fragments = cut(tail, [], 4 * SECOND, 0)
    assert [round(fragment.window.end / SECOND) for fragment in fragments] == ends


def test_a_window_of_one_s_own_has_what_it_touches_and_the_state_before_it() -> None:
    chunks = [
        (0.0, 1.0, {1: 1}),
        (1.0, 2.0, {2: 4}),  # another topic
        (2.0, 3.0, {0: 5}),  # ends before the lead-in
        (3.0, 4.0, {0: 6}),  # ends as the lead-in starts
        (4.5, 5.5, {0: 7, 2: 1}),
        (6.0, 7.0, {0: 8}),  # starts as the window ends
    ]
    map_, camera = connection(1, "/map", in_force=1), connection(2, "/camera")
    tail = tail_with(chunks, SCAN, map_, camera)
    window = Window(4 * SECOND, 5 * SECOND, 6 * SECOND)
    fragment = cut_one(tail, ["/scan", "/map"], window)
    assert fragment == FragmentPlan(window, [(1000, 1000), (4000, 2000)], 13, 0)
    everything = cut_one(tail, [], window)
    assert (everything.ranges, everything.messages) == ([(1000, 1000), (4000, 2000)], 14)
    nothing = cut_one(tail, ["/other"], window)
    assert (nothing.ranges, nothing.messages) == ([], 0)


def test_the_state_of_a_topic_that_is_not_wanted_stays_behind() -> None:
    chunks = [(0.0, 1.0, {1: 1}), (4.0, 5.0, {0: 5})]
    tail = tail_with(chunks, SCAN, connection(1, "/map", in_force=1))
    window = Window(4 * SECOND, 4 * SECOND, 9 * SECOND)
    assert cut_one(tail, ["/scan"], window).ranges == [(2000, 1000)]


def test_a_latched_message_of_the_lead_in_s_first_moment_replaces_none_before_it() -> None:
    """The chunk of the older one is needed: only what lies before the lead-in is certain."""
    for end, ranges in ((4.0, [(1000, 1000), (3000, 2000)]), (3.9, [(3000, 2000)])):
        chunks = [(0.0, 1.0, {1: 1}), (2.0, 2.5, {0: 1}), (3.0, end, {1: 1}), (4.5, 5.0, {0: 1})]
        tail = tail_with(chunks, SCAN, connection(1, "/map", in_force=1))
        window = Window(4 * SECOND, 4 * SECOND, 9 * SECOND)
        assert cut_one(tail, [], window).ranges == ranges


def test_a_short_remainder_joins_the_last_fragment() -> None:
    tail = tail_with([(0, 4.5, {0: 9})], SCAN)
    assert len(cut(tail, [], 4 * SECOND, 0)) == 1


# Promise: latched-in-force
def test_latched_state_before_the_window_comes_along() -> None:
    chunks = [(0.0, 1.0, {0: 5, 1: 1}), (1.5, 7.9, {0: 5}), (8.0, 12.0, {0: 5})]
    tail = tail_with(chunks, SCAN, connection(1, "/map", in_force=1))
    last = cut(tail, [], 4 * SECOND, 0)[-1]
    assert last.window.start == 8 * SECOND
    assert last.ranges == [(1000, 1000), (3000, 1000)]


def test_of_overlapping_chunks_all_that_may_hold_the_newest_latched_message_come_along() -> None:
    chunks = [(0.0, 5.0, {1: 1}), (1.0, 2.0, {1: 1}), (8.0, 12.0, {0: 5})]
    tail = tail_with(chunks, SCAN, connection(1, "/map", in_force=1))
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


def drive_with_gap(gap: float) -> list[tuple[float, float, dict[int, int]]]:
    """A minute, a gap and a minute, in chunks of a second that end before the gap."""
    starts = [*range(60), *(60 + gap + second for second in range(60))]
    return [(start, start + 0.9, {0: 10}) for start in starts]


# Promise: gap-is-no-fragment
def test_a_gap_gives_no_fragments_and_the_others_keep_their_numbers() -> None:
    fragments = cut(tail_with(drive_with_gap(600.0), SCAN), [], 60 * SECOND, 0)
    windows = [(f.number, f.window.start / SECOND, f.window.end / SECOND) for f in fragments]
    # The first cut moves to the last chunk before the gap.
    assert windows == [(0, 0, 59), (1, 59, 120), (11, 660, 719.900000001)]
    assert [f.messages for f in fragments] == [590, 10, 600]


@pytest.mark.parametrize(("gap", "numbers"), [(0, [0, 1]), (30, [0, 1, 2]), (60, [0, 1, 2])])
def test_a_gap_that_leaves_no_window_empty_changes_nothing(gap: int, numbers: list[int]) -> None:
    fragments = cut(tail_with(drive_with_gap(gap), SCAN), [], 60 * SECOND, 0)
    assert [fragment.number for fragment in fragments] == numbers


def test_behind_a_gap_warm_up_and_latched_state_are_those_of_the_recording() -> None:
    chunks = [(0.0, 1.0, {0: 5, 1: 1}), (1.5, 3.9, {0: 5}), (40.0, 44.0, {0: 5})]
    tail = tail_with(chunks, SCAN, connection(1, "/map", in_force=1))
    first, last = cut(tail, [], 4 * SECOND, 2 * SECOND)
    assert (first.number, first.window.start, first.messages) == (0, 0, 11)
    # Neither the lead-in behind the first fragment nor the map makes cases of the gap.
    assert last.number == 10
    assert last.window.lead_in_start == last.window.start - 2 * SECOND
    assert last.ranges == [(1000, 1000), (3000, 1000)]


def test_a_topic_that_pauses_while_others_go_on_has_a_gap() -> None:
    camera = connection(1, "/camera")
    chunks = [(float(n), n + 0.9, {1: 5} | ({} if 4 <= n < 12 else {0: 5})) for n in range(16)]
    tail = tail_with(chunks, SCAN, camera)
    assert [f.number for f in cut(tail, ["/scan"], 4 * SECOND, 0)] == [0, 1, 3]
    assert [f.number for f in cut(tail, [], 4 * SECOND, 0)] == [0, 1, 2, 3]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("gaps")


def cut_file(path: Path, topics: list[str], length: int, warm_up: int) -> list[FragmentPlan]:
    data = path.read_bytes()

    def read(offset: int, count: int) -> bytes:
        return data[offset : offset + count]

    return cut(read_tail(read, len(data)), topics, length, warm_up, partial(message_times, read))


# Promise: windows-half-open, gap-is-no-fragment
@settings(max_examples=60, deadline=None)
@given(
    gaps=st.lists(st.integers(0, 900 * SECOND), min_size=1, max_size=3),
    length=st.integers(5 * SECOND, 60 * SECOND),
    warm_up=st.integers(0, 10 * SECOND),
    chunk_bytes=st.sampled_from([200, 2000, 1 << 20]),
    latching=st.booleans(),
    others=st.booleans(),
)
def test_of_a_real_bag_with_gaps_every_fragment_has_messages_and_every_message_one(
    folder: Path,
    gaps: list[int],
    length: int,
    warm_up: int,
    chunk_bytes: int,
    latching: bool,
    others: bool,
) -> None:
    recorded = [Recorded("/map", 1, "the map", latching=True)] if latching else []
    begin = SECOND
    for gap in [*gaps, 0]:
        recorded += steady("/scan", 20, SECOND, begin)
        begin = recorded[-1].time + SECOND + gap
    times = [message.time for message in recorded]
    if others:
        recorded += steady("/camera", 60, (begin - SECOND) // 60)
        recorded.sort(key=lambda message: message.time)
    (folder / "gaps.bag").unlink(missing_ok=True)
    path = write_bag(folder / "gaps.bag", recorded, chunk_bytes)
    fragments = cut_file(path, ["/scan", "/map"], length, warm_up)
    windows = [fragment.window for fragment in fragments]
    inside = [sum(w.start <= time < w.end for time in times) for w in windows]
    assert all(inside)
    assert sum(inside) == len(times)
    numbers = [fragment.number for fragment in fragments]
    assert numbers == sorted(set(numbers))
    for (number, before), (following, after) in itertools.pairwise(
        zip(numbers, windows, strict=True)
    ):
        assert (before.end == after.start) == (following == number + 1)
        assert before.end <= after.start


def test_no_index_behind_a_chunk_is_read_where_the_tail_is_enough() -> None:
    def refused(offset: int, length: int) -> bytes:
        raise AssertionError(f"{length} bytes at {offset} were read")

    for gap in (0.0, 600.0):
        tail = tail_with(drive_with_gap(gap), SCAN, connection(1, "/camera"))
        assert cut(tail, ["/scan"], 60 * SECOND, 0, partial(message_times, refused))


@pytest.mark.parametrize(
    ("chunks", "numbers"),
    [
        # With other topics' messages: it begins and ends in the window, maybe just with it.
        ([(0.0, 3.0, {0: 1, 1: 1})], [0]),
        ([(0.0, 0.5, {0: 1}), (5.0, 7.0, {0: 1, 1: 1})], [0, 1]),
        # The same, of a window that begins before it.
        ([(0.0, 0.5, {0: 1}), (5.5, 7.0, {0: 1, 1: 1})], [0, 1]),
        # Of the topic alone: it begins in one window, and ends in the next.
        ([(0.0, 6.0, {0: 1})], [0, 1]),
    ],
)
def test_a_chunk_s_own_first_or_last_time_is_enough(
    chunks: list[tuple[float, float, dict[int, int]]], numbers: list[int]
) -> None:
    def refused(offset: int, length: int) -> bytes:
        raise AssertionError(f"{length} bytes at {offset} were read")

    tail = tail_with(chunks, SCAN, connection(1, "/camera"))
    assert [
        f.number for f in cut(tail, ["/scan"], 4 * SECOND, 0, partial(message_times, refused))
    ] == numbers


def test_of_a_chunk_with_some_of_the_topics_alone_no_index_is_read() -> None:
    def refused(offset: int, length: int) -> bytes:
        raise AssertionError(f"{length} bytes at {offset} were read")

    tail = tail_with([(0.0, 6.0, {0: 1})], SCAN, connection(1, "/camera"))
    assert len(cut(tail, [], 4 * SECOND, 0, partial(message_times, refused))) == 2


# Promise: windows-half-open
def test_a_message_at_a_window_s_end_is_the_next_one_s(tmp_path: Path) -> None:
    recorded = [
        Recorded("/camera", 10 * SECOND, "a"),
        Recorded("/scan", 14 * SECOND, "b" * 500),  # ends its chunk
        Recorded("/scan", 19 * SECOND, "c"),
    ]
    path = write_bag(tmp_path / "edge.bag", recorded, 300)
    fragments = cut_file(path, ["/scan"], 4 * SECOND, 0)
    assert [(f.number, f.window.start // SECOND) for f in fragments] == [(1, 14), (2, 19)]


def test_latched_state_that_may_be_of_after_the_window_s_begin_replaces_none() -> None:
    chunks = [(0.0, 1.0, {1: 1}), (2.0, 2.5, {0: 1}), (3.0, 6.0, {1: 1})]
    tail = tail_with(chunks, SCAN, connection(1, "/map", in_force=1))
    window = Window(5 * SECOND, 5 * SECOND, 9 * SECOND)
    assert cut_one(tail, [], window).ranges == [(1000, 1000), (3000, 1000)]


def test_latched_state_may_be_as_old_as_a_newer_chunk_s_first_message_and_never_younger() -> None:
    chunks = [(0.0, 5.0, {1: 1}), (5.0, 6.0, {1: 1}), (6.5, 7.0, {0: 1}), (9.5, 9.9, {1: 1})]
    tail = tail_with(chunks, SCAN, connection(1, "/map", in_force=1))
    assert cut_one(tail, [], Window(8 * SECOND, 8 * SECOND, 9 * SECOND)).ranges == [(1000, 2000)]


def test_a_chunk_without_its_own_index_keeps_its_windows(tmp_path: Path) -> None:
    recorded = [*steady("/scan", 5, SECOND), *steady("/scan", 5, SECOND, 60 * SECOND)]
    path = write_bag(tmp_path / "one.bag", recorded)
    assert [f.number for f in cut_file(path, [], 10 * SECOND, 0)] == [0, 5, 6]
    (chunk,) = read_tail(lambda at, n: path.read_bytes()[at : at + n], path.stat().st_size).chunks
    data = bytearray(path.read_bytes())
    # The seconds of the last message, which its index record ends with beside an offset.
    data[chunk.end - 12 : chunk.end - 8] = b"\xff" * 4
    path.write_bytes(data)
    assert [f.number for f in cut_file(path, [], 10 * SECOND, 0)] == [0, 1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize("length", [0, -1, -5 * SECOND])
@pytest.mark.parametrize("chunks", [1, 3])
def test_a_length_that_never_ends_is_refused(length: int, chunks: int) -> None:
    tail = tail_with([(n, n + 1, {0: 5}) for n in range(chunks)], SCAN)
    with pytest.raises(ValueError, match=f"a fragment lasts at least 1 ns, and not {length}"):
        cut(tail, [], length, 0)
    assert len(cut(tail, [], 10 * SECOND, 0)) == 1


def test_a_length_of_a_nanosecond_is_the_least() -> None:
    tail = BagTail(10**6, [], [SCAN], [Chunk(1000, 2000, 0, 2, {0: 3})])
    assert [(f.window.start, f.window.end) for f in cut(tail, [], 1, 0)] == [(0, 1), (1, 2), (2, 3)]


class CountedChunk(Chunk):
    """How often one is looked at."""

    looks = 0

    def __getattribute__(self, name: str) -> object:
        if name in {"end_time", "counts"}:
            CountedChunk.looks += 1
        return super().__getattribute__(name)


def test_no_window_looks_at_all_chunks() -> None:
    """Else a night of a camera, in hundred thousands of chunks, is planned for minutes."""
    for count in (100, 400):
        chunks: list[Chunk] = [
            CountedChunk(n * 100, n * 100 + 100, n * SECOND, (n + 1) * SECOND - 1, {0: 5, 1: 1})
            for n in range(count)
        ]
        CountedChunk.looks = 0
        tail = BagTail(count * 100, [], [SCAN, connection(1, "/tf_static", in_force=2)], chunks)
        fragments = cut(tail, [], SECOND, SECOND)
        assert len(fragments) == count
        assert fragments[-1].ranges == [((count - 4) * 100, 400)]
        assert CountedChunk.looks < 30 * count
