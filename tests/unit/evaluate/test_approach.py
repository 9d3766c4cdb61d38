"""The nearest of several obstacles that move, on a way of several straight parts."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe.evaluate import approach
from bagpipe.evaluate.approach import Unknown, approaches
from bagpipe.evaluate.way import Part, Point, Way

SECOND = 1_000_000_000
BEGIN = 5 * SECOND
# A place in metres and a speed in metres per second.
Obstacle = tuple[Point, Point]

numbers = st.integers(-20, 20).map(float)
points = st.tuples(numbers, numbers)


def way_of(places: list[Point], first: int = BEGIN) -> list[Part]:
    """A second for each straight part."""
    marks = [(first + at * SECOND, place) for at, place in enumerate(places)]
    return list(itertools.pairwise(marks))


def least(part: Part, obstacles: list[Obstacle]) -> float:
    """The least distance on a part, in metres, of 2,001 moments of it: no less than it is."""
    (start, old), (stop, new) = part
    share = np.linspace(0, 1, 2001)[:, None]
    ego = np.array(old) + share * (np.array(new) - np.array(old))
    seconds = (start - BEGIN + share * (stop - start)) / 1e9
    ways = [np.array(place) + seconds * np.array(speed) - ego for place, speed in obstacles]
    return min(float(np.hypot(*way.T).min()) for way in ways)


@given(
    st.lists(points, min_size=2, max_size=4),
    st.lists(st.tuples(points, points), min_size=1, max_size=4),
)
def test_no_moment_of_a_part_is_nearer_to_any_obstacle_than_the_nearest(
    places: list[Point], obstacles: list[Obstacle]
) -> None:
    parts = way_of(places)
    found = approach._nearest(BEGIN, parts, obstacles)
    for part, (time, ego, obstacle) in zip(parts, found, strict=True):
        (start, old), (stop, new) = part
        share = (time - start) / (stop - start)
        assert 0 <= share <= 1
        assert ego == pytest.approx(
            [a + share * (b - a) for a, b in zip(old, new, strict=True)], abs=1e-6
        )
        seconds = (time - BEGIN) / 1e9
        ends = [(x + a * seconds, y + b * seconds) for (x, y), (a, b) in obstacles]
        assert min(math.dist(end, obstacle) for end in ends) < 1e-6
        # A step of the 2,001 is 0.04 m at most.
        assert math.dist(ego, obstacle) == pytest.approx(least(part, obstacles), abs=0.02)


@pytest.mark.parametrize("at_once", [1, 3, 4, 1000])
def test_parts_that_are_looked_at_in_turn_give_the_same_and_have_a_bound(
    monkeypatch: pytest.MonkeyPatch, at_once: int
) -> None:
    obstacles: list[Obstacle] = [((float(at), 3.0), (-1.0, 0.5 * at)) for at in range(2)]
    parts = way_of([(float(at), 0.0) for at in range(8)])
    whole = approach._nearest(BEGIN, parts, obstacles)
    sizes = []
    closest = approach._closest

    def counted(begin: int, some: list[Part], places: Any, speeds: Any) -> Any:
        sizes.append(len(some))
        return closest(begin, some, places, speeds)

    monkeypatch.setattr(approach, "_AT_ONCE", at_once)
    monkeypatch.setattr(approach, "_closest", counted)
    assert approach._nearest(BEGIN, parts, obstacles) == whole
    assert sizes == {1: [1] * 7, 3: [1] * 7, 4: [2, 2, 2, 1], 1000: [7]}[at_once]


def test_what_is_too_far_for_a_number_is_no_nearer_than_what_is_not() -> None:
    huge = 1e308
    parts = way_of([(0.0, 0.0), (1.0, 0.0)])
    for obstacles in (
        [((huge, huge), (huge, huge)), ((9.0, 0.0), (0.0, 0.0))],
        [((-huge, huge), (huge, -huge)), ((9.0, 0.0), (0.0, 0.0))],
    ):
        [(time, ego, obstacle)] = approach._nearest(BEGIN, parts, obstacles)
        assert (time, ego, obstacle) == (BEGIN + SECOND, (1.0, 0.0), (9.0, 0.0))


def test_who_stands_beside_who_stands_is_as_near_from_the_first_moment_on() -> None:
    [(time, ego, obstacle)] = approach._nearest(
        BEGIN, way_of([(1.0, 2.0), (1.0, 2.0)]), [((4.0, 6.0), (0.0, 0.0))]
    )
    assert (time, ego, obstacle) == (BEGIN, (1.0, 2.0), (4.0, 6.0))


def test_of_obstacles_that_stand_on_the_ego_s_way_the_nearest_of_each_part_is_found() -> None:
    """They are seen at both ends of two seconds, in which the ego drives 20 m, past both."""
    poses = [(at * SECOND, (10.0 * at, 0.0)) for at in range(3)]
    obstacles = [(4.0, 3.0), (16.0, -2.0)]
    scenes = [(0, obstacles), (2 * SECOND, obstacles)]
    found = approaches(Way(poses, SECOND), scenes, 2 * SECOND, 2 * SECOND)
    near = [(time, math.dist(ego, obstacle), obstacle) for time, ego, obstacle in found.seen]
    assert near == [(400_000_000, 3.0, (4.0, 3.0)), (1_600_000_000, 2.0, (16.0, -2.0))]
    assert (found.feared, found.unknown) == ([], [])


def test_of_one_that_is_seen_once_it_is_known_how_near_the_ego_came_to_where_it_was() -> None:
    poses = [(at * SECOND, (10.0 * at, 0.0)) for at in range(3)]
    found = approaches(Way(poses, SECOND), [(0, [(13.0, 4.0)])], 2 * SECOND, 2 * SECOND)
    assert found.unknown == [Unknown(0, 2 * SECOND, 4.0)]
    assert (found.seen, found.feared) == ([], [])


def test_where_nothing_comes_behind_the_last_message_nothing_is_unknown() -> None:
    poses = [(at * SECOND, (10.0 * at, 0.0)) for at in range(3)]
    found = approaches(Way(poses, SECOND), [(SECOND, [(13.0, 4.0)])], 2 * SECOND, SECOND)
    assert (found.seen, found.feared, found.unknown) == ([], [], [])
