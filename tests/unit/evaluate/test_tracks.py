"""Obstacles that are followed from message to message, each worked out by hand."""

import pytest

from bagpipe.evaluate import tracks
from bagpipe.evaluate.tracks import Kind, Scene, Stretch, _Track
from bagpipe.evaluate.way import Point

STILL = (0.0, 0.0)


def ns(seconds: float) -> int:
    return round(seconds * 1e9)


def track(at: float, place: Point, speed: Point, followed: float, known: bool = True) -> _Track:
    """One that was seen at a time, whose speed is of so many seconds before it."""
    old = place[0] - speed[0] * followed, place[1] - speed[1] * followed
    first = ns(at) - ns(followed), old
    return _Track(ns(at), place, speed, known, (first, first))


def stretch(kind: Kind, begin: float, until: float, place: Point, speed: Point = STILL) -> Stretch:
    return Stretch(kind, ns(begin), ns(until), place, speed)


def followed(*scenes: tuple[float, list[Point]], age: float, end: float) -> list[Stretch]:
    given: list[Scene] = [(ns(at), places) for at, places in scenes]
    return list(tracks.stretches(given, ns(age), ns(end)))


def test_one_that_stands_is_there_from_its_first_message_until_its_last_one_is_too_old() -> None:
    place = (3.0, 4.0)
    scenes = [(at, [place]) for at in (5.0, 6.0, 7.0)]
    assert followed(*scenes, age=1, end=20) == [
        stretch("seen", 5, 6, place),
        stretch("seen", 6, 7, place),
        stretch("seen", 7, 8, place),
    ]
    assert followed(*scenes, age=1, end=7.5)[2] == stretch("seen", 7, 7.5, place)
    # Messages that are further apart than maxAge: it is the same, and nothing is known in between.
    assert followed(*scenes, age=0.25, end=20) == [
        stretch("seen", 5, 5.25, place),
        stretch("seen", 6, 6.25, place),
        stretch("seen", 7, 7.25, place),
    ]
    assert followed(age=1, end=20) == []


def test_of_one_that_moves_it_is_known_where_it_was_when_a_third_message_shows_its_speed() -> None:
    scenes = [(at, [(8 * at, -4 * at)]) for at in (0.0, 0.5, 1.0)]
    speed = (8.0, -4.0)
    assert followed(*scenes, age=1, end=1.75) == [
        stretch("unknown", 0, 0.5, (0, 0)),
        stretch("feared", 0.5, 1, (4, -2), speed),
        stretch("feared", 0, 0.5, (0, 0), speed),
        stretch("feared", 1, 1.75, (8, -4), speed),
    ]


def test_one_that_a_message_lacks_may_have_gone_on_or_be_the_one_that_comes_again() -> None:
    scenes = [(at, [(8 * at, 0.0)]) for at in (0.0, 0.5, 1.0)]
    again = followed(*scenes, (1.5, []), (2.0, [(16.5, 0.0)]), age=3, end=2.5)
    # It went 8.5 m in the last second, half a metre more than its speed promised.
    assert again[3:] == [
        stretch("feared", 1, 2, (8, 0), (8.5, 0)),
        stretch("feared", 1, 2, (8, 0), (8, 0)),
        stretch("feared", 2, 2.5, (16.5, 0), (8.5, 0)),
    ]
    # Where it is not seen again it is feared for maxAge, or until the window's end.
    for age, end, until in ((0.75, 9, 1.75), (3, 1.5, 1.5)):
        lost = followed(*scenes, (1.5, []), (2.0, []), age=age, end=end)
        assert lost[3:] == [stretch("feared", 1, until, (8, 0), (8, 0))]


def test_one_that_stood_and_is_lacked_by_the_last_message_is_feared_there() -> None:
    scenes = [(at, [(3.0, 4.0)]) for at in (0.0, 1.0)]
    assert followed(*scenes, (1.5, []), age=1, end=9) == [
        stretch("seen", 0, 1, (3, 4)),
        stretch("feared", 1, 2, (3, 4)),
    ]


def test_one_is_looked_for_as_long_as_it_is_not_too_old() -> None:
    scenes = [(at, [(3.0, 4.0)]) for at in (0.0, 1.0)]
    late = [*scenes, (1.5, []), (2.5, [(3.0, 4.0)])]
    assert followed(*late, age=1.5, end=9)[1] == stretch("seen", 1, 2.5, (3, 4))
    # Else another one is there, of which nothing more is known.
    assert followed(*late, age=1.25, end=9)[1:] == [
        stretch("feared", 1, 2.25, (3, 4)),
        stretch("unknown", 2.5, 3.75, (3, 4)),
    ]


def test_its_speed_is_of_half_a_second_at_least() -> None:
    seen = _Track(ns(0), (0.0, 0.0))
    marks = {}
    for at, x in ((0.25, 0.5), (0.5, 0.75), (0.75, 1.5), (1.0, 2.0), (1.25, 3.0)):
        seen = seen.seen_again(ns(at), (x, 0.0))
        marks[at] = [(time / 1e9, place[0]) for time, place in seen.marks]
        assert seen.known
    assert marks == {
        0.25: [(0, 0), (0, 0)],
        0.5: [(0, 0), (0.5, 0.75)],
        0.75: [(0, 0), (0.5, 0.75)],
        1.0: [(0.5, 0.75), (1.0, 2.0)],
        1.25: [(0.5, 0.75), (1.0, 2.0)],
    }
    assert seen.speed == (2.25 / 0.75, 0)
    assert seen.mark == (ns(1.25), (3.0, 0.0))
    nearly = _Track(ns(0), (0.0, 0.0)).seen_again(ns(0.499999999), (0.5, 0.0))
    assert [time for time, _ in nearly.marks] == [0, 0]


def test_a_speed_is_known_of_what_hardly_moved_or_is_where_its_speed_led() -> None:
    first = _Track(ns(5), (1.0, 2.0))
    assert first.seen_again(ns(5), (9.0, 9.0)) is first
    assert first.seen_again(ns(5.5), (1.5, 2.0)) == _Track(
        ns(5.5), (1.5, 2.0), (1.0, 0.0), True, (first.mark, (ns(5.5), (1.5, 2.0)))
    )
    moved = first.seen_again(ns(6), (4.0, -2.0))
    assert moved == _Track(
        ns(6), (4.0, -2.0), (3.0, -4.0), False, (first.mark, (ns(6), (4.0, -2.0)))
    )
    # It would be at (7, -6) a second later, and is another one more than 6 m from there.
    for off, known in ((0.0, True), (6.0, True), (6.001, False), (-6.0, True), (-6.001, False)):
        again = moved.seen_again(ns(7), (7.0 + off, -6.0))
        assert again.known == known, off
        assert again.marks[0] == moved.mark
    # Where it was is no other place, whatever its speed was.
    assert moved.seen_again(ns(6.125), (4.5, -2.0)).known
    fast = track(6, (4, -2), (50, 0), 1, known=False)
    assert fast.seen_again(ns(7), (4.0, -2.5)).known
    assert not fast.seen_again(ns(7), (4.0, -2.501)).known
    # One that is known stays so, and another one's marks begin again.
    assert track(6, (4, -2), (50, 0), 1).seen_again(ns(7), (4.0, -20.0)).known
    other = fast.seen_again(ns(6.25), (4.0, -20.0))
    assert other.marks == (fast.mark, fast.mark)
    assert other.speed == (0, -72)


@pytest.mark.parametrize(
    ("seconds", "known", "goes"),
    [(0.25, True, True), (0.249999999, True, False), (0.25, False, False), (2.0, True, True)],
)
def test_who_was_followed_for_a_quarter_of_a_second_is_known_to_go_on(
    seconds: float, known: bool, goes: bool
) -> None:
    seen = track(5, (1, 2), (3, 0), seconds, known)
    assert seen.goes == goes
    expected = stretch("feared", 5, 6, (1, 2), (3, 0)) if goes else stretch("unknown", 5, 6, (1, 2))
    assert seen.behind(ns(1), ns(9), ns(5)) == expected
    assert not _Track(ns(5), (1.0, 2.0)).goes


def test_where_one_would_be_is_no_further_than_its_speed_leads() -> None:
    long, short = track(5, (1, 2), (2, -4), 0.25), track(5, (1, 2), (2, -4), 0.125)
    assert [long.at(ns(at)) for at in (5, 8, 4)] == [(1, 2), (7, -10), (-1, 6)]
    assert track(5, (1, 2), (2, -4), 0.5).at(ns(8)) == (7, -10)
    # Twice as long as it was followed.
    assert [short.at(ns(at)) for at in (5.125, 5.25, 5.5, 4.75, 4.5)] == [
        (1.25, 1.5), (1.5, 1), (1.5, 1), (0.5, 3), (0.5, 3),
    ]  # fmt: skip
    assert _Track(ns(5), (1.0, 2.0)).at(ns(8)) == (1, 2)


def test_how_far_one_may_be_is_little_where_its_speed_is_known() -> None:
    long, short = track(5, (1, 2), (2, -4), 0.25), track(5, (1, 2), (2, -4), 0.125)
    # 1 m, and half of 10 m/s² for so long; else 0.5 m, and 70 m/s.
    assert [long.reach(ns(at)) for at in (5, 6, 7)] == [1, 6, 21]
    assert [short.reach(ns(at)) for at in (5.125, 5.25)] == [1.078125, 1.3125]
    assert short.reach(ns(5.250000001)) == pytest.approx(18.0)
    assert track(5, (1, 2), (2, -4), 0.25, known=False).reach(ns(7)) == 140.5
    assert _Track(ns(5), (1.0, 2.0)).reach(ns(5.5)) == 35.5


def test_which_stretches_lie_between_two_sightings() -> None:
    def between(one: _Track, again: _Track, age: float = 9.0, before: float = 5.0) -> list[Stretch]:
        return list(one.until_again(again, ns(age), ns(before)))

    one = track(5, (1, 2), (3, 4), 1)
    gone = track(7, (7, 10), (3, 4), 1)
    straight = stretch("feared", 5, 7, (1, 2), (3, 4))
    assert between(one, gone) == [straight]
    assert between(one, gone, age=1.5) == [stretch("feared", 5, 6.5, (1, 2), (3, 4))]
    # A message in between lacks it.
    assert between(one, gone, before=6) == [straight, straight]
    assert between(one, one, before=6) == []
    # Its speed was not known before, and is now.
    new = track(5, (1, 2), (2, 0), 1, known=False)
    came = stretch("feared", 4, 5, (-1, 2), (2, 0))
    assert between(new, gone) == [straight, came]
    assert between(new, gone, age=0.5)[1] == stretch("feared", 4, 4.5, (-1, 2), (2, 0))
    assert between(_Track(ns(5), (1.0, 2.0)), gone) == [straight]
    # Nor is it now.
    odd = track(7, (7, 10), (3, 4), 0.125)
    assert between(new, odd) == [stretch("unknown", 5, 7, (1, 2))]
    assert between(one, odd) == [straight]
    # Half a metre is no way.
    stood = track(7, (1.5, 2), (0.25, 0), 2)
    seen = stretch("seen", 5, 7, (1, 2), (0.25, 0))
    assert between(one, stood, before=6) == [seen]
    assert between(new, stood, before=6) == [seen]
    assert between(new, odd._replace(place=(1.5, 2.0)), before=6) == [seen]
    assert between(one, odd._replace(place=(1.5, 2.001))) == [straight]


def test_one_that_creeps_stands_for_half_a_metre() -> None:
    slow = track(5, (1, 2), (0.3, 0.4), 1)
    assert slow.behind(ns(1), ns(9), ns(5)).kind == "seen"
    assert slow.behind(ns(9), ns(6), ns(5)) == stretch("seen", 5, 6, (1, 2), (0.3, 0.4))
    assert slow.behind(ns(1.001), ns(9), ns(5)).kind == "feared"
    # A later message lacks it.
    assert slow.behind(ns(1), ns(9), ns(6)) == stretch("feared", 5, 6, (1, 2), (0.3, 0.4))


def test_a_double_is_where_the_other_one_was_seen_last() -> None:
    known = track(7, (10, 0), (3, 4), 1)
    # Two seconds before it was at (4, -8), or at most 21 m from there.
    for x, may_be in ((4.0, True), (25.0, True), (25.001, False), (-17.0, True), (-17.001, False)):
        assert known.may_be(_Track(ns(5), (x, -8.0))) == may_be, x
    unknown = known._replace(known=False)
    assert unknown.may_be(_Track(ns(5), (999.0, -8.0)))


def test_of_several_at_one_point_the_one_seen_last_goes_on_and_of_these_the_nearest() -> None:
    old = _Track(ns(4), (0.0, 0.0))
    far, near = _Track(ns(5), (0.3, 0.0)), _Track(ns(5), (0.0, 0.2))
    other = _Track(ns(3), (9.0, 0.0))
    points = [(0.0, 0.0), (9.0, 0.0)]
    for order in ([old, far, near], [near, far, old], [far, old, near]):
        found = tracks._owners([*order, other, old], [0, 0, 0, 1, None], ns(6), points)
        assert found == {0: near, 1: other}
    # Of two that are as near the one that is the last of the list.
    left, right = _Track(ns(5), (-0.3, 0.0)), _Track(ns(5), (0.3, 0.0))
    for order in ([left, right], [right, left]):
        assert tracks._owners(order, [0, 0], ns(6), points) == {0: order[-1]}


def matched(places: list[Point], points: list[Point], seconds: float = 1.0) -> list[int | None]:
    """Those that were seen once, so many seconds before."""
    return tracks._matched([_Track(ns(5), place) for place in places], ns(5 + seconds), points)


def test_who_is_at_a_point_is_it_also_where_others_are() -> None:
    places = [(0.0, 0.0), (0.0, 0.4), (9.0, 0.0)]
    points = [(20.0, 0.0), (0.0, 0.0), (0.0, 0.0), (9.0, 0.3), (9.0, 0.2)]
    assert matched(places, points, 0.01) == [1, 1, 4]
    assert matched(places, []) == [None] * 3
    assert matched([], points) == []


def test_who_is_at_no_point_may_be_at_any_in_reach_that_is_nobody_s() -> None:
    assert matched([(0.0, 0.0)], [(70.5, 0.0)]) == [0]
    assert matched([(0.0, 0.0)], [(70.501, 0.0)]) == [None]
    # One that is there has its point; who is nearest chooses first of the others.
    places = [(0.0, 0.0), (3.0, 0.0), (4.0, 0.0), (500.0, 0.0)]
    points = [(5.0, 0.0), (0.0, 0.2), (10.0, 0.0)]
    assert matched(places, points) == [1, 2, 0, None]
    # The one whose speed is known is near to where that leads.
    known = track(5, (0, 0), (10, 0), 1)
    assert tracks._matched([known], ns(6), [(17.0, 0.0), (4.5, 0.0)]) == [1]
    assert tracks._matched([known], ns(6), [(16.001, 0.0)]) == [None]


def test_of_many_that_want_one_point_each_round_chooses_for_one() -> None:
    points = [(float(x), 0.0) for x in range(1, 11)]
    assert matched([(0.0, 0.0)] * 10, points) == [*range(8), None, None]


def test_one_that_is_followed_at_the_place_of_a_double_is_one() -> None:
    """Two sensors list it, and one of them lacks it from the third message on."""
    twice, once = [(0.0, 0.0), (0.0, 0.1)], [(0.0, 0.0)]
    found = followed((0, twice), (0.5, twice), (1, once), age=1, end=1.5)
    assert [(each.kind, each.begin / 1e9, each.until / 1e9, each.place) for each in found] == [
        ("seen", 0, 0.5, (0, 0)), ("seen", 0, 0.5, (0, 0.1)),
        ("seen", 0.5, 1, (0, 0)), ("seen", 0.5, 1, (0, 0.1)), ("seen", 1, 1.5, (0, 0)),
    ]  # fmt: skip


def test_how_many_lost_ones_are_looked_for_grows_with_what_messages_have() -> None:
    def most(*counts: int) -> list[int]:
        return list(tracks._most_lost([(0, [STILL] * count) for count in counts]))

    assert most(0, 1, 4) == [100, 125, 183]
    assert most(197, 199, 198, 0) == [9950, 10000, 10000, 7525]
    assert most(198) == [10000]
    assert most(199) == [10000]


def test_of_too_many_lost_ones_those_that_were_lost_first_are_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tracks, "_LEAST_LOST", 2)
    monkeypatch.setattr(tracks, "_LOST_OF_EACH", 0)
    crowd = [(0.0, 0.0), (200.0, 0.0), (400.0, 0.0)]
    found = followed((0, crowd), (0.5, []), (1, crowd), age=2, end=3)
    assert found == [
        stretch("unknown", 0, 2, (0, 0)),
        stretch("seen", 0, 1, (200, 0)),
        stretch("seen", 0, 1, (400, 0)),
        stretch("unknown", 1, 3, (0, 0)),
        stretch("seen", 1, 3, (200, 0)),
        stretch("seen", 1, 3, (400, 0)),
    ]
