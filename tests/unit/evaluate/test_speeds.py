"""Where obstacles come from at their speeds, each worked out by hand."""

import pytest

from bagpipe.evaluate import speeds
from bagpipe.evaluate.speeds import Origin
from bagpipe.evaluate.tracks import Mark
from bagpipe.evaluate.way import Point

AWAY = (500.0, 0.0)


def ns(seconds: float) -> int:
    return round(seconds * 1e9)


def came(*scenes: tuple[float, list[Point]], age: float = 1) -> list[list[tuple[Origin, ...]]]:
    return list(speeds.origins([(ns(at), points) for at, points in scenes], ns(age)))


def origin(at: float, place: Point, *, sure: bool = True) -> tuple[Origin, ...]:
    return (Origin((ns(at), place), sure),)


def test_who_moves_comes_from_its_message_before() -> None:
    scenes = [(at, [(50 * at, 0.0)]) for at in (0.0, 0.1, 0.2, 0.3)]
    assert came(*scenes) == [
        [()], [origin(0, (0, 0))], [origin(0.1, (5, 0))], [origin(0.2, (10, 0))],
    ]  # fmt: skip


def test_until_its_next_message_is_where_its_speed_led_it_is_not_sure() -> None:
    assert came((0, [(0, 0)]), (0.1, [(5, 0)]))[1] == [origin(0, (0, 0), sure=False)]
    there = came((0, [(0, 0)]), (0.1, [(5, 0)]), (0.2, [(10, 0)]))
    assert there[1] == [origin(0, (0, 0))]
    elsewhere = came((0, [(0, 0)]), (0.1, [(5, 0)]), (0.2, [(5, 5)]))
    assert elsewhere[1] == [origin(0, (0, 0), sure=False)]
    assert elsewhere[2] == [origin(0.1, (5, 0), sure=False)]
    # What hardly moved is the same.
    assert came((0, [(0, 0)]), (0.1, [(0.5, 0)]))[1] == [origin(0, (0, 0))]


def test_messages_that_lie_near_to_each_other_in_time_give_a_speed_over_a_tenth_of_a_second() -> (
    None
):
    times = (0.0, 0.04, 0.08, 0.12, 0.16, 0.2, 0.24)
    found = came(*((at, [(at, 0.0)]) for at in times))
    since = [marks[0].mark[0] / 1e9 if marks else None for [marks] in found]
    assert since == [None, None, None, 0, 0, 0, 0.12]


def test_one_that_was_away_has_a_speed_if_it_had_one_before() -> None:
    moving = [(0.0, [(0.0, 0.0)]), (0.2, [(2.0, 0.0)]), (0.4, [(4.0, 0.0)]), (0.6, [AWAY])]
    assert came(*moving, (0.8, [(8.0, 0.0)]))[4] == [origin(0.4, (4, 0))]
    once = [(0.0, [(0.0, 0.0)]), (0.2, [AWAY])]
    assert came(*once, (0.4, [(4.0, 0.0)]))[2] == [()]
    assert came(*once, (0.4, [(0.5, 0.0)]))[2] == [origin(0, (0, 0))]
    # For no longer than what was seen says something.
    assert came(*moving, (0.8, [(8.0, 0.0)]), age=0.3)[4] == [()]


def test_the_order_of_a_list_says_nothing_where_places_do() -> None:
    one, other = (0.0, 0.0), (5.0, 0.0)
    turned = came((0, [one, other]), (0.1, [other, one]), (0.2, [one, other]), (0.3, [other, one]))
    assert turned[1:] == [
        [origin(0, other), origin(0, one)],
        [origin(0.1, one), origin(0.1, other)],
        [origin(0.2, other), origin(0.2, one)],
    ]


def test_where_each_is_where_another_one_was_both_their_places_and_their_list_may_be_right() -> (
    None
):
    column = [(at, [(20 * at + 20 * n, 0.0) for n in range(3)]) for at in (0.0, 1.0, 2.0)]
    listed = Origin((ns(0), (0.0, 0.0)), sure=False)
    stood = Origin((ns(0), (20.0, 0.0)), sure=False)
    assert came(*column)[1][0] == (stood, listed)
    # Of two lists, and where the third is elsewhere, that is not known.
    assert came(*column[:2])[1][0] == origin(0, (20, 0))
    assert came(*column[:2], (2.0, [AWAY, AWAY, AWAY]))[1][0] == origin(0, (20, 0))
    assert came(*column[:2], (2.0, [(40.0, 0.0)]))[1][0] == (stood, listed)


@pytest.mark.parametrize(
    ("one", "two", "three", "steady"),
    [
        ((0, (0, 0)), (1, (20, 0)), (2, (40, 0)), True),
        ((0, (0, 0)), (1, (20, 0)), (3, (60, 20)), True),
        ((0, (0, 0)), (1, (20, 0)), (2, (40, 6)), True),
        ((0, (0, 0)), (1, (20, 0)), (2, (40, 6.1)), False),
        ((0, (0, 0)), (1, (70, 0)), (2, (140, 0)), True),
        ((0, (0, 0)), (1, (90, 0)), (2, (180, 0)), True),
        ((0, (0, 0)), (0, (0, 0)), (1, (0, 0)), False),
        ((0, (0, 0)), (1, (0, 0)), (1, (0, 0)), False),
    ],
)
def test_one_goes_steadily_that_hardly_changes_its_speed(
    one: Mark, two: Mark, three: Mark, steady: bool
) -> None:
    marks = [(ns(at), place) for at, place in (one, two, three)]
    assert speeds._steady(*marks) == steady
