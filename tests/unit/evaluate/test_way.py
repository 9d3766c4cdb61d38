"""Where the ego is between its poses, by hand."""

import itertools

import pytest

from bagpipe.evaluate.way import Point, Way, between, drives

S = 1_000_000_000
# A second apart, and then three; 10 m along x and 4 back along y each second.
POSES = [(0, (0.0, 9.0)), (S, (10.0, 5.0)), (4 * S, (40.0, -7.0))]


@pytest.mark.parametrize(
    ("time", "place"),
    [
        (-1, None),
        (0, (0.0, 9.0)),
        (S // 4, (2.5, 8.0)),
        (S, (10.0, 5.0)),
        (2 * S, (20.0, 1.0)),
        (4 * S, (40.0, -7.0)),
        (4 * S + 1, None),
    ],
)
def test_it_is_on_the_straight_line_between_two_poses(time: int, place: Point | None) -> None:
    assert Way(POSES, age=2 * S).at(time) == place


def test_a_place_further_from_both_poses_than_their_age_is_not_known() -> None:
    # Three seconds between two poses: the middle is 1.5 s from each.
    known, unknown = Way(POSES, age=3 * S // 2), Way(POSES, age=3 * S // 2 - 1)
    assert (known.at(2 * S), unknown.at(2 * S)) == ((20.0, 1.0), None)
    assert (unknown.at(S // 2), unknown.at(4 * S)) == ((5.0, 7.0), (40.0, -7.0))
    assert Way([], age=S).at(0) is None


def test_of_two_poses_of_one_time_the_last_is_the_place_and_both_have_a_way() -> None:
    poses: list[tuple[int, Point]] = [(0, (0.0, 0.0)), (S, (1.0, 0.0)), (S, (1.0, 0.5))]
    assert Way(poses, age=S).at(S) == (1.0, 0.5)
    assert Way(poses, age=S).at(S // 2) == (0.5, 0.0)


@pytest.mark.parametrize(
    ("metres", "seconds", "may"),
    [
        (0.5, 0, True),
        (0.51, 0, False),
        (70.5, 1, True),
        (70.51, 1, False),
        (35.5, 0.5, True),
        (35.51, 0.5, False),
        (7000.5, 100, True),
        (7000.51, 100, False),
        # A thousandth of a second more or less decides.
        (700_000_000_000.5, 10_000_000_000, True),
        (700_000_000_030.5, 10_000_000_000, False),
    ],
)
def test_it_drives_at_most_70_m_each_second_and_half_a_metre(
    metres: float, seconds: float, may: bool
) -> None:
    begin, end = 5 * S, 5 * S + round(seconds * S)
    for there in [(3.0 + metres, 4.0), (3.0, 4.0 - metres)]:
        assert drives((begin, (3.0, 4.0)), (end, there)) == may


def test_a_jump_has_no_places_in_between() -> None:
    way = Way([(0, (0.0, 0.0)), (S, (71.0, 0.0)), (2 * S, (72.0, 0.0))], age=S)
    assert (way.at(S // 2), way.at(S), way.at(3 * S // 2)) == (None, (71.0, 0.0), (71.5, 0.0))
    there = (S, (71.0, 0.0))
    assert list(way.parts(0, 2 * S)) == [
        ((0, (0.0, 0.0)), (0, (0.0, 0.0))),
        (there, there),
        (there, (2 * S, (72.0, 0.0))),
    ]


def test_the_parts_of_a_time_begin_and_end_in_it() -> None:
    way = Way(POSES, age=2 * S)
    half, three = (S // 2, (5.0, 7.0)), (3 * S, (30.0, -3.0))
    assert list(way.parts(S // 2, 3 * S)) == [(half, (S, (10.0, 5.0))), ((S, (10.0, 5.0)), three)]
    # From a pose to a pose each is there once.
    assert list(way.parts(0, 4 * S)) == list(itertools.pairwise(POSES))
    # Within one part, and at one moment.
    assert list(way.parts(2 * S, 3 * S)) == [((2 * S, (20.0, 1.0)), three)]
    assert list(way.parts(3 * S, 3 * S)) == [(three, three)]


def test_where_one_place_alone_is_known_it_is_a_part_of_no_length() -> None:
    way = Way(POSES, age=2 * S)
    last = POSES[-1]
    assert list(way.parts(4 * S, 6 * S)) == [(last, last)]
    assert list(way.parts(-S, 0)) == [(POSES[0], POSES[0])]
    assert list(way.parts(5 * S, 6 * S)) == []
    middle = [(S, (10.0, 5.0))]
    assert list(Way(middle, age=S).parts(0, 2 * S)) == [(middle[0], middle[0])]


def test_between_two_points() -> None:
    assert between((1.0, 8.0), (5.0, 2.0), 0.25) == (2.0, 6.5)
