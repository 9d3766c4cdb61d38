"""Answers and the truth brought together: which pairs there are, how far apart, and what strays."""

import math
from typing import Any

import numpy as np
import pytest

from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.finding import NoEvidenceError
from bagpipe.evaluate.matching import Matched, Pair, matched, usual_step
from bagpipe.evaluate.model import Error
from tests.unit.evaluate.recordings import STORE, evidence, number, stamped

SECOND = 1_000_000_000
X = ["pose.position.x"]


def ns(seconds: float) -> int:
    return round(seconds * SECOND)


def brought(given: Evidence, **wanted: Any) -> Matched:
    error = {"topic": "/pose", "truth": "/truth", "fields": X, "max": 1} | wanted
    return matched("c", Error.model_validate(error), given)


def answer(stamp: float, x: float, y: float = 0.0, late: float = 0.25) -> Any:
    return ("/pose", stamp + late, stamped(stamp, x, y))


def truth(*points: tuple[float, float]) -> list[Any]:
    """In the window, whatever the order of the stamps."""
    return [("/truth", 10.1 + n, stamped(at, x, 0.0)) for n, (at, x) in enumerate(points)]


def joints(*angles: float) -> Any:
    layout = STORE.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    return STORE.types["std_msgs/msg/Float64MultiArray"](layout, np.array(angles, dtype=float))


def pair(stamp: float, place: int, distance: float, late: float = 0.25) -> Pair:
    return Pair(ns(stamp + late), ns(stamp), place, pytest.approx(distance))  # type: ignore[arg-type]


STRAIGHT = truth((10, 0), (11, 10), (12, 20))


def test_an_answer_and_the_truth_at_the_nearest_stamp_are_a_pair() -> None:
    found = brought(evidence([*STRAIGHT, answer(10.02, 1), answer(10.97, 10.5), answer(10.98, 9)]))
    assert found.pairs == [pair(10.02, 0, 1), pair(10.97, 1, 0.5), pair(10.98, 1, 1)]
    assert (found.answers, found.truth_times) == (3, [ns(10), ns(11), ns(12)])
    # The last of the truth has no answer.
    assert (found.answered, found.clock, found.strays) == ([True, True, False], "header", [])


def test_the_truth_is_in_the_order_of_its_stamps_and_pairs_in_that_of_their_receipt() -> None:
    turned = truth((12, 20), (10, 0), (11, 10))
    entries = [answer(12, 20, late=0.1), answer(11, 13, late=1.5), answer(10, 4, late=2.9)]
    found = brought(evidence([*turned, *entries]))
    assert found.truth_times == [ns(10), ns(11), ns(12)]
    assert found.pairs == [pair(12, 2, 0, 0.1), pair(11, 1, 3, 1.5), pair(10, 0, 4, 2.9)]
    assert found.answered == [True, True, True]


@pytest.mark.parametrize(("tolerance", "pairs"), [("50ms", 2), ("49ms", 0)])
def test_the_tolerance_itself_is_near_enough_on_both_sides(tolerance: str, pairs: int) -> None:
    given = evidence([*STRAIGHT, answer(10.05, 0), answer(11.95, 20)])
    found = brought(given, stampTolerance=tolerance)
    assert len(found.pairs) == pairs
    assert found.answered == [pairs > 0, False, pairs > 0]


@pytest.mark.parametrize(
    ("at", "x", "strays"),
    [
        (10.5, 5.0, []),
        (10.5, 20.0, []),  # as far from the nearer one as they are from each other
        (10.5, 23.0, [(0, 3.0)]),  # as near to both in time: the earlier
        (10.501, 23.0, [(1, 3.0)]),
        (10.5, -12.0, [(0, 2.0)]),
        (10.5, 20.5, [(0, 0.5)]),
        (9.9, 99.0, []),  # before the truth, and behind it
        (12.1, 99.0, []),
    ],
)
def test_what_strays_from_both_neighbours_is_as_far_off_as_it_must_be(
    at: float, x: float, strays: list[tuple[int, float]]
) -> None:
    found = brought(evidence([*STRAIGHT, answer(at, x)]))
    assert found.pairs == []
    assert found.strays == [pair(at, place, distance) for place, distance in strays]


@pytest.mark.parametrize(("end", "strays"), [(15.0, 1), (15.001, 0)])
def test_in_a_gap_of_more_than_three_usual_steps_nothing_strays(end: float, strays: int) -> None:
    given = evidence([*truth((10, 0), (11, 0), (12, 0), (end, 0)), answer(13.5, 7)])
    assert len(brought(given).strays) == strays


def test_what_lies_in_a_gap_keeps_no_later_answer_from_its_pair() -> None:
    gap = truth((10, 0), (11, 0), (12, 0), (16, 0))
    found = brought(evidence([*gap, answer(13.5, 7), answer(16, 3), answer(11.5, 7, late=6)]))
    assert (found.pairs, found.strays) == ([pair(16, 3, 3)], [pair(11.5, 1, 7, late=6)])


def test_of_two_samples_their_own_step_is_usual() -> None:
    found = brought(evidence([*truth((10, 0), (11, 0)), answer(10.5, 7)]))
    assert found.strays == [pair(10.5, 0, 7)]


@pytest.mark.parametrize("apart", [0.0, 0.001, 0.02])
@pytest.mark.parametrize("times", [2, 3])
def test_a_truth_that_is_published_again_makes_no_gap_of_its_usual_step(
    times: int, apart: float
) -> None:
    again = [(10.0 + n + each * apart, 0.0) for n in range(4) for each in range(times)]
    found = brought(evidence([*truth(*again), answer(11.5, 7)]))
    assert [each.distance for each in found.strays] == [7.0]


@pytest.mark.parametrize("tolerance", ["1ms", "50ms", "1s"])
def test_a_fast_truth_that_is_away_for_long_has_been_anywhere(tolerance: str) -> None:
    """A loop through a tunnel: most of the time, or once, between many samples near together."""
    for away in (13.0, 18.0):
        fast = [(10 + n / 100, 0.0) for n in range(50)] + [(away, 0.0), (away + 0.01, 0.0)]
        sent = [("/truth", 10.1 + n / 100, stamped(*at, 0.0)) for n, at in enumerate(fast)]
        found = brought(evidence([*sent, answer(11.7, 50)]), stampTolerance=tolerance)
        assert found.strays == [], away


@pytest.mark.parametrize(
    ("times", "step"),
    [
        ([5], 0),
        ([5, 5], 0),
        ([0, 100], 100),
        ([0, 0, 100, 100, 200, 200], 100),
        ([0, 40, 80, 120, 160], 40),  # nearer together than the tolerance, and still no repeats
        ([0, 20, 40, 60, 500], 60),
    ],
)
def test_the_usual_step_is_one_between_samples_that_are_apart(times: list[int], step: int) -> None:
    assert usual_step(times, 50) == step


def from_zero(*stamps: float, topic: str = "/pose") -> list[Any]:
    """Ten messages a second apart from second 0 on, which say when they came."""
    given = [*stamps, *range(len(stamps), 10)]
    return [(topic, n + 0.3, stamped(at, n, 0.0)) for n, at in enumerate(given)]


def test_in_a_drive_from_second_zero_an_empty_stamp_is_that_time() -> None:
    right = from_zero(topic="/truth")
    found = brought(evidence([*right, *from_zero()], start=0, end=10), metric="max")
    assert [(each.at, each.truth, each.distance) for each in found.pairs[:2]] == [
        (0, 0, 0.0), (SECOND, 1, 0.0),
    ]  # fmt: skip
    # Nine answers with the first one's stamp are answers to the first input.
    still = evidence([*right, *from_zero(*[0.0] * 9)], start=0, end=10)
    assert [each.truth for each in brought(still).pairs] == [0] * 9 + [9]
    assert brought(still).pairs[8].distance == 8.0


@pytest.mark.parametrize("start", [0, 0.9, 1])
def test_where_every_stamp_is_empty_there_is_none(start: float) -> None:
    empty = [0.0] * 10
    answers = [("/pose", n + 0.3, number(n)) for n in range(10)]
    given = evidence([*from_zero(*empty, topic="/truth"), *answers], start=start, end=10)
    found = brought(given, fields=["data"], truthFields=X)
    assert {each.distance for each in found.pairs} == {0.0}
    assert len(found.pairs) == (10 if start == 0 else 9)
    with pytest.raises(NoEvidenceError, match=r"messages on /pose have an empty (header\.)?stamp"):
        brought(evidence([*from_zero(topic="/truth"), *from_zero(*empty)], start=start, end=10))


def test_stamps_that_can_t_be_are_believed_only_if_the_recording_has_such() -> None:
    wall = [("/pose", 10.5 + n, stamped(5_000.0 + n, n, 0)) for n in range(3)]
    right = [("/truth", 10.5 + n, stamped(10.0 + n, n, 0)) for n in range(3)]
    with pytest.raises(NoEvidenceError, match="3 of 3 messages on /pose are stamped later"):
        brought(evidence(wall, source=right), recording=True)
    played_before = [("/truth", 10.4 + n, stamped(5_000.0 + n, n, 0)) for n in range(3)]
    found = brought(evidence(wall, source=played_before), recording=True)
    assert ([each.distance for each in found.pairs], found.clock) == ([0.0] * 3, "header")
    with pytest.raises(NoEvidenceError, match="stamped later"):
        brought(evidence([*wall, *played_before]))


def test_a_truth_of_one_sample_has_nothing_between() -> None:
    found = brought(evidence([*truth((11, 0)), answer(11.01, 3), answer(10.5, 9), answer(12, 9)]))
    assert (found.pairs, found.strays) == ([pair(11.01, 0, 3)], [])


def test_distances_are_over_all_fields_and_of_angles_the_short_way() -> None:
    both = ["pose.position.x", "pose.position.y"]
    entries = [*STRAIGHT, answer(10, 3, 4), answer(11, 10 + 2 * math.pi - 0.3, 0.4)]
    assert [each.distance for each in brought(evidence(entries), fields=both).pairs] == [
        5.0, pytest.approx(math.hypot(2 * math.pi - 0.3, 0.4)),
    ]  # fmt: skip
    turned = [
        (topic, 11.0, joints(*at)) for topic, at in (("/pose", (16.0, 0.4)), ("/truth", (10, 0)))
    ]
    found = brought(evidence(turned), fields=["data[0]", "data[1]"], angle=True)
    assert found.pairs[0].distance == pytest.approx(math.hypot(math.tau - 6, 0.4))


def test_angles_that_are_further_apart_than_any_number_are_apart() -> None:
    far = [("/pose", 11.0, number(1e308)), ("/truth", 11.0, number(-1e308))]
    found = brought(evidence(far), fields=["data"], angle=True)
    assert found.pairs[0].distance == math.inf


def test_the_truth_may_have_fields_of_its_own_and_no_header() -> None:
    numbers = [("/truth", 10.0 + n, number(10.0 * n)) for n in range(3)]
    entries = [*numbers, answer(11, 12)]
    found = brought(evidence(entries), truthFields=["data"])
    assert found.pairs == [pair(11, 1, 2)]
    # A recorded one goes by its own times, too, from a bag of its own.
    source = evidence([answer(11, 12)], source=numbers)
    assert brought(source, recording=True, truthFields=["data"]).pairs == [pair(11, 1, 2)]


def test_answers_without_stamps_go_by_their_receipt_whatever_the_truth_s_stamps_are() -> None:
    for stamp in (10.0, 5_000.0):
        source = [("/truth", 10.0, stamped(stamp, 1, 0))]
        given = evidence([("/pose", 10.01, number(3.0))], source=source)
        found = brought(given, fields=["data"], truthFields=X, recording=True)
        assert found.clock == "receipt"


def test_an_answer_that_is_no_number_leaves_no_pairs_and_a_failure() -> None:
    found = brought(evidence([*STRAIGHT, answer(10, 0), answer(11, math.nan)]))
    assert (found.pairs, found.strays, found.answers) == ([], [], 2)
    assert found.odd is not None
    assert (found.odd.outcome, found.odd.kind) == ("failed", "error")
    assert "pose.position.x of /pose" in found.odd.message


def test_a_truth_that_is_no_number_compares_with_nothing() -> None:
    broken = [*truth((10, 0), (11, math.inf)), answer(10, 0)]
    with pytest.raises(NoEvidenceError, match=r"compared: the truth's pose.position.x of /truth"):
        brought(evidence(broken))
