"""How long progress waits: not at all where the API server has time, never beyond its bound."""

from contextlib import ExitStack
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe_operator.cluster.fence import PROGRESS_AT_ONCE, WRITES_AT_ONCE
from bagpipe_operator.runtime.write_pace import (
    BUSY_SECONDS,
    HALF_LIFE_SECONDS,
    QUIET_SECONDS,
    WritePace,
    interval,
)
from tests.unit.operator.builders import Clock

LONGEST = 30.0
JOBS = ("a", "b", "c")
# A job's visit or somebody else's write: who, after which pause, and how long a write then takes.
STEPS = st.lists(
    st.tuples(st.sampled_from(JOBS), st.floats(0, 5), st.floats(0, 12), st.booleans()),
    max_size=60,
)


class Paced:
    """A pace, and a clock that a write moves."""

    def __init__(self, longest: float = LONGEST) -> None:
        self.clock = Clock()
        self.pace = WritePace(longest, self.clock.monotonic)

    def write(self, uid: str, seconds: float, urgent: bool = True) -> None:
        with self.pace.writing(uid, urgent):
            self.clock.advance(seconds)

    def make_busy(self, seconds: float = 1.0) -> None:
        for _ in range(60):
            self.write("another", seconds)


@pytest.mark.parametrize(
    ("latency", "seconds"),
    [(0.0, 0.0), (0.02, 0.0), (0.1, 0.0), (0.35, 15.0), (0.6, 30.0), (9.0, 30.0)],
)
def test_the_slower_writes_are_the_longer_progress_waits(latency: float, seconds: float) -> None:
    assert interval(latency, LONGEST) == pytest.approx(seconds)


@given(st.lists(st.floats(0, 20), min_size=2).map(sorted), st.floats(0.1, 120))
def test_the_interval_grows_with_latency_and_has_its_bound(
    latencies: list[float], longest: float
) -> None:
    found = [interval(latency, longest) for latency in latencies]
    assert all(one <= other for one, other in pairwise(found))
    assert all(0 <= each <= longest for each in found)


@given(STEPS)
def test_with_low_latency_nothing_ever_waits(steps: list[tuple[str, float, float, bool]]) -> None:
    paced = Paced()
    for uid, pause, seconds, urgent in steps:
        paced.clock.advance(pause)
        assert not paced.pace.puts_off(uid)
        paced.write(uid, QUIET_SECONDS * seconds / 12, urgent)
        assert paced.pace.interval() == 0


@given(STEPS)
def test_progress_waits_no_longer_than_the_bound(
    steps: list[tuple[str, float, float, bool]],
) -> None:
    """Whatever writes take: who has waited since the last write or the first question is let go."""
    paced, since = Paced(), dict[str, float]()
    for uid, pause, seconds, urgent in steps:
        paced.clock.advance(pause)
        now = paced.clock.seconds
        waited = now - since.setdefault(uid, now)
        if paced.pace.puts_off(uid):
            assert waited < LONGEST
        else:
            assert waited >= paced.pace.interval() or waited >= LONGEST
            paced.write(uid, seconds, urgent)
            since[uid] = paced.clock.seconds
        paced.write("another", seconds)  # which makes it no busier than its latency


def test_a_busy_api_server_is_given_time_and_asked_again_when_it_has_rested() -> None:
    paced = Paced()
    paced.write("a", 0.02)
    paced.make_busy()
    assert paced.pace.interval() == LONGEST
    paced.write("a", 1.0)
    assert paced.pace.puts_off("a")
    paced.clock.advance(LONGEST - 0.01)
    for _ in range(10):
        paced.write("another", 1.0)
    assert not paced.pace.puts_off("a")  # its time has come, busy or not
    paced.write("a", 1.0)
    paced.clock.advance(4 * HALF_LIFE_SECONDS)  # nothing was written
    assert paced.pace.interval() == 0
    assert not paced.pace.puts_off("a")


def test_what_it_took_is_forgotten_by_half_in_five_seconds() -> None:
    paced = Paced()
    paced.make_busy(BUSY_SECONDS)
    before = paced.pace.interval()
    paced.clock.advance(HALF_LIFE_SECONDS)
    latency = QUIET_SECONDS + before / LONGEST * (BUSY_SECONDS - QUIET_SECONDS)
    assert paced.pace.interval() == pytest.approx(interval(latency / 2, LONGEST))


def test_sixteen_writes_are_remembered_and_five_seconds_halve_them() -> None:
    paced = Paced()
    for _ in range(8):
        paced.write("another", 1.0)
    latency = 1 - (15 / 16) ** 8
    assert paced.pace.interval() == pytest.approx(30.0 * (latency - 0.1) / 0.5)
    paced.clock.advance(5.0)
    assert paced.pace.interval() == pytest.approx(30.0 * (latency / 2 - 0.1) / 0.5)


@pytest.mark.parametrize("seconds", [1.2, 10.0, 60.0])
def test_one_write_without_an_answer_makes_nobody_wait(seconds: float) -> None:
    paced = Paced()
    for _ in range(20):
        paced.write("a", 0.02)
    with pytest.raises(TimeoutError), paced.pace.writing("a", urgent=True):
        paced.clock.advance(seconds)
        raise TimeoutError
    assert paced.pace.interval() == 0
    for _ in range(3):
        paced.write("another", seconds)
    assert paced.pace.interval() > 0  # several do


def test_a_write_that_failed_was_not_made() -> None:
    paced = Paced()
    paced.write("a", 1.0, urgent=False)
    paced.make_busy()
    assert not paced.pace.puts_off("a")  # sixty seconds on
    with pytest.raises(TimeoutError), paced.pace.writing("a", urgent=False):
        raise TimeoutError
    assert not paced.pace.puts_off("a")


def test_a_busy_operator_that_is_new_writes_no_herd() -> None:
    paced = Paced()
    paced.make_busy()
    assert all(paced.pace.puts_off(uid) for uid in JOBS)
    paced.clock.advance(LONGEST)
    paced.make_busy()
    assert not any(paced.pace.puts_off(uid) for uid in JOBS)


def test_where_writes_of_progress_have_no_place_no_worker_waits_for_one() -> None:
    paced = Paced()
    paced.write("a", 0.02)
    paced.make_busy(0.4)  # which took 24 seconds, and asks for 17
    assert not paced.pace.puts_off("a")
    under_way = [paced.pace.writing(str(n), urgent=False) for n in range(PROGRESS_AT_ONCE)]
    for each in under_way:
        assert not paced.pace.puts_off("a")
        each.__enter__()
    assert paced.pace.puts_off("a")
    under_way.pop().__exit__(None, None, None)
    assert not paced.pace.puts_off("a")
    assert PROGRESS_AT_ONCE < WRITES_AT_ONCE


@pytest.mark.parametrize("under_way", [PROGRESS_AT_ONCE, PROGRESS_AT_ONCE + 1])
def test_where_no_place_is_free_it_waits_as_soon_as_the_api_server_is_busy_at_all(
    under_way: int,
) -> None:
    paced = Paced()
    with ExitStack() as writes:
        for number in range(under_way):
            writes.enter_context(paced.pace.writing(str(number), urgent=False))
        assert not paced.pace.puts_off("a")
        while not paced.pace.interval():
            paced.write("another", 0.11)
        assert paced.pace.interval() < 0.1
        paced.clock.advance(0.1)
        assert paced.pace.interval() == 0
        paced.write("another", 0.2)
        assert 0 < paced.pace.interval() < 1
        assert paced.pace.puts_off("a")


def test_who_waited_longest_is_let_go_also_where_no_place_is_free() -> None:
    paced = Paced()
    paced.write("a", 0.02)
    with ExitStack() as under_way:
        for number in range(PROGRESS_AT_ONCE):
            under_way.enter_context(paced.pace.writing(str(number), urgent=False))
        paced.make_busy(0.5)  # thirty seconds
        assert not paced.pace.puts_off("a")
        paced.write("a", 0.02)
        paced.make_busy(0.49)
        assert paced.pace.puts_off("a")


def test_a_job_that_is_forgotten_begins_again_and_leaves_nothing() -> None:
    paced = Paced()
    paced.make_busy()
    for number in range(1000):
        paced.pace.puts_off(f"job-{number}")
        paced.pace.forget(f"job-{number}")
    paced.pace.forget("another")
    assert paced.pace._waits_since == {}
