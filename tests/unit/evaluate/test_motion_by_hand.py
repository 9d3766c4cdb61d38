"""What a distance and a time to a collision are made of, each part worked out by hand."""

import math
from typing import Any

import pytest

from bagpipe.evaluate import motion
from bagpipe.evaluate.evidence import Evidence, Sample
from bagpipe.evaluate.finding import Finding, NoEvidenceError
from bagpipe.evaluate.model import Separation
from bagpipe.evaluate.motion import Met, Pair
from bagpipe.evaluate.speeds import origins
from bagpipe.evaluate.way import Point, Way
from tests.unit.evaluate.recordings import STORE, evidence, header, number, poses, stamped

HERE = (0.0, 0.0)
NAN = math.nan


def ns(seconds: float) -> int:
    return round(seconds * 1e9)


def separation(**wanted: Any) -> Separation:
    given = {"ego": "/ego", "obstacles": "/cars", "minCoverage": 0} | wanted
    return Separation.model_validate(given)


def window(inputs: list[float] | None = None) -> Evidence:
    """From 10 to 20 s."""
    asked = None if inputs is None else (lambda: [ns(at) for at in inputs])
    return evidence([], inputs=asked)


def pair(at: float, obstacle: Point, velocity: Point | None = None, ego: Point = HERE) -> Pair:
    return ns(at), ego, obstacle, velocity


@pytest.mark.parametrize(
    ("ego", "obstacle", "velocity", "reach", "seconds"),
    [
        (HERE, (10, 0), (-2, 0), 1, 4.5),
        (HERE, (10, 0), (-3, 0), 1, 3.0),
        (HERE, (10, 0), (-0.04, 0), 1, 225.0),
        (HERE, (0, -10), (0, 3), 1, 3.0),
        ((3, 4), (3, 16), (0, -2), 2, 5.0),
        ((4, 3), (16, 3), (-2, 0), 2, 5.0),
        ((1, 2), (7, 10), (-3, -4), 1, 1.8),
        (HERE, (10, 0.6), (-2, 0), 1, 4.6),
        (HERE, (10, 1), (-2, 0), 1, 5.0),
        (HERE, (10, 1.001), (-2, 0), 1, math.inf),
        (HERE, (10, 0), (2, 0), 1, math.inf),
        (HERE, (10, 0), (0, 3), 1, math.inf),
        (HERE, (10, 0), (0, 0), 1, math.inf),
        (HERE, (10, 0), None, 1, None),
        (HERE, (1, 0), None, 1, 0.0),
        (HERE, (0.5, 0.5), (9, 9), 1, 0.0),
        (HERE, (1.001, 0), None, 1, None),
        (HERE, (2.5, 0), None, 3, 0.0),
        (HERE, (3.5, 0), None, 3, None),
        (HERE, (5, 12), (-5, -12), 6.5, 0.5),
    ],
)
def test_two_circles_meet_after_so_many_seconds(
    ego: Point, obstacle: Point, velocity: Point | None, reach: float, seconds: float | None
) -> None:
    found = motion._time_to_collision(ego, obstacle, velocity, reach)
    assert found == (None if seconds is None else pytest.approx(seconds))


def test_the_least_distance_of_all_pairs_is_reported_with_its_time() -> None:
    pairs = [pair(11, (8, 9), ego=(5, 5)), pair(12, (0, 4)), pair(13.25, (3, -5.5), ego=(3, 0.5))]
    for least, outcome, bound in (
        (4, "passed", ""),
        (4.5, "failed", ", and may be at least 4.5 m"),
    ):
        found = motion._least("c", separation(minDistance=least), window(), pairs)
        assert found.outcome == outcome
        assert (found.name, found.kind, found.figure, found.unit) == ("c", "separation", 4, "m")
        assert (found.limit, found.direction) == (f"at least {least:g} m", "higher")
        assert found.message == f"4 m at 2.000 s{bound}"


def test_the_least_time_of_all_pairs_with_a_speed_is_reported_with_its_time() -> None:
    pairs = [pair(11, (9, 0)), pair(12.5, (12, 0), (-2, 0)), pair(13, (20, 0), (-2, 0))]
    wanted = separation(minTimeToCollision=5, radius=0.75)
    found = motion._least("c", wanted, window(), pairs)
    assert found == Finding(
        "c", "separation", "passed", 5.25, "s", "at least 5 s", "higher",
        "5.25 s to a collision at 2.500 s",
    )  # fmt: skip
    # Of two at one time to a collision the first.
    twice = motion._least("c", wanted, window(), [pair(15, (12, 0), (-2, 0)), *pairs])
    assert twice.message == "5.25 s to a collision at 2.500 s"


def test_of_two_bounds_both_figures_are_kept_and_the_broken_one_is_reported() -> None:
    pairs = [pair(11, (10, 0), (-2, 0))]
    for distance, time, unit in ((10, 4.5, "s"), (10.5, 4.5, "m"), (10, 5, "s"), (10.5, 5, "m")):
        wanted = separation(minDistance=distance, minTimeToCollision=time, radius=0.5)
        found = motion._least("c", wanted, window(), pairs)
        assert found.unit == unit
        assert [(each.figure, each.unit) for each in found.figures] == [(10, "m"), (4.5, "s")]
        assert found.outcome == ("passed" if (distance, time) == (10, 4.5) else "failed")


def test_without_a_pair_or_a_speed_there_is_no_evidence() -> None:
    both = separation(minDistance=9, minTimeToCollision=1, radius=0.5, maxAge="500ms")
    with pytest.raises(NoEvidenceError) as none:
        motion._least("c", both, window(), [])
    assert str(none.value) == (
        "no obstacle was ever on /cars while a pose on /ego was at most 500ms old"
    )
    with pytest.raises(NoEvidenceError) as slow:
        motion._least("c", both, window(), [pair(11, (9, 0))])
    assert str(slow.value) == (
        "no obstacle on /cars was seen at two times, so that none has a speed"
    )
    with pytest.raises(NoEvidenceError):
        only = separation(minTimeToCollision=1, radius=0.5)
        motion._least("c", only, window(), [pair(11, (9, 0))])
    # What is too near is so, however fast it was.
    near = motion._least("c", both, window(), [pair(11, (8.75, 0))])
    assert (near.outcome, near.figure, near.figures) == ("failed", 8.75, ())


def test_what_is_too_near_whatever_its_speed_is() -> None:
    assert motion._too_near(separation(minDistance=3, radius=2)) == 3
    assert motion._too_near(separation(minDistance=0.5, radius=2)) == 0.5
    assert motion._too_near(separation(minTimeToCollision=1, radius=2)) == 4
    assert motion._too_near(separation(minTimeToCollision=1, radius=0.25)) == 0.5
    assert motion._too_near(separation(minDistance=3, minTimeToCollision=1, radius=2)) == 4
    assert motion._too_near(separation(minDistance=5, minTimeToCollision=1, radius=2)) == 5


def test_an_obstacle_that_would_have_been_too_near_makes_a_pass_invalid() -> None:
    passed = Finding("c", "separation", "passed", 9.0, "m", message="9 m at 1.000 s")
    wanted, feared = separation(minDistance=3), [(ns(12), 8.0), (ns(13.5), 2.5), (ns(14), 2.75)]
    found = motion._feared(passed, wanted, window(), feared)
    assert (found.outcome, found.figure) == ("invalid", 9.0)
    assert found.message == (
        "between two messages that have it, or after the last one, an obstacle may have been 2.5 m"
        " away at 3.500 s, and no message on /cars shows where it was then: publish them more"
        " often, or until they are passed; 9 m at 1.000 s"
    )
    # What is just so far away is no nearer than it may be.
    assert motion._feared(passed, separation(minDistance=2.5), window(), feared) is passed
    assert motion._feared(passed, wanted, window(), []) is passed
    failed = Finding("c", "separation", "failed", 1.0, "m")
    assert motion._feared(failed, wanted, window(), feared) is failed


def met(**given: Any) -> Met:
    nothing: dict[str, Any] = {"course": [], "obstacles": [], "pairs": [], "sure": [], "feared": []}
    return Met(**(nothing | {"share": 1.0, "clock": "header", "besides": ""} | given))


@pytest.mark.parametrize("point", [(1.0, NAN), (NAN, 1.0)])
def test_the_first_place_that_is_no_number_is_named_the_ego_s_before_an_obstacle_s(
    point: Point,
) -> None:
    fine, odd = (ns(11), (1.0, 2.0)), (ns(12.5), point)
    assert motion._odd("c", met(course=[fine], obstacles=[fine]), window()) is None
    for more, what in (({"course": [fine, odd]}, "the ego's"), ({}, "an obstacle's")):
        found = motion._odd("c", met(obstacles=[fine, odd], **more), window())
        assert found is not None
        assert (found.outcome, found.kind) == ("failed", "separation")
        assert found.message.startswith(f"{what} pose is no finite number but nan at 2.500 s")


def test_the_nearest_of_each_time_is_drawn_from_what_was_measured() -> None:
    pairs = [
        pair(12, (5, 0)), pair(11, (0, 7)), pair(11, (4, 3), ego=(1, -1)), pair(11, (9, 9)),
        pair(12, (0, -4)), pair(12, (4, 0)),
    ]  # fmt: skip
    wanted, given = separation(minDistance=1), window()
    given.keep(wanted, met(pairs=pairs))
    assert motion.nearest(wanted, given) == [
        (ns(11), (1, -1), (4, 3)), (ns(12), HERE, (0, -4)),
    ]  # fmt: skip
    assert motion.closest(wanted, given) == [(ns(11), 5.0), (ns(12), 4.0)]


def test_an_obstacle_s_speed_is_what_the_ego_sees_of_it_since_the_scene_before() -> None:
    scenes: list[tuple[int, Point, list[Point]]] = [
        (ns(5), (1, 2), [(10, 4), (20, 0)]),
        (ns(7), (3, 7), [(9, 8)]),
        (ns(7), (3, 7), [(8, 8)]),
        (ns(8), (3, 7), [(8, 9), (1, 1)]),
        (ns(9), (75, 7), [(8, 9)]),  # 72 m in a second: it has not driven there
        (ns(10), (145.5, 7), [(8, 9)]),
        (ns(11), (145.5, 7), []),
        (ns(12), (145.5, 7), [(8, 9), (1, 1)]),
    ]
    places = [(time, points) for time, _, points in scenes]
    assert motion._paired(scenes, list(origins(places, ns(1)))) == [
        (ns(5), (1, 2), (10, 4), None),
        (ns(5), (1, 2), (20, 0), None),
        (ns(7), (3, 7), (9, 8), (-1.5, -0.5)),
        (ns(7), (3, 7), (8, 8), None),
        (ns(8), (3, 7), (8, 9), (0, 1)),
        (ns(8), (3, 7), (1, 1), None),
        (ns(9), (75, 7), (8, 9), None),
        (ns(10), (145.5, 7), (8, 9), (-70.5, 0)),
        (ns(12), (145.5, 7), (8, 9), None),
        (ns(12), (145.5, 7), (1, 1), None),
    ]


def test_stretches_that_touch_are_one() -> None:
    assert motion._joined([(5, 7), (1, 2), (2, 3), (6, 6), (10, 12), (5, 8), (9, 9)]) == [
        (1, 3), (5, 8), (9, 9), (10, 12),
    ]  # fmt: skip
    assert motion._joined([(1, 9), (2, 3)]) == [(1, 9)]
    assert motion._joined([]) == []


@pytest.mark.parametrize(
    ("times", "stretches"),
    [
        ([], [(14, 20)]),
        ([10], [(14, 20)]),
        ([9.5], [(14, 20)]),
        ([12, 15], [(19, 20)]),
        ([12, 16], []),
        ([12, 16.25], [(16, 16.25)]),
        ([11, 20, 21], [(15, 20)]),
    ],
)
def test_a_message_is_too_old_four_seconds_after_it_or_after_the_window_began(
    times: list[float], stretches: list[tuple[float, float]]
) -> None:
    found = motion._too_old([ns(at) for at in times], ns(4), window())
    assert found == [(ns(begin), ns(end)) for begin, end in stretches]


def share(
    poses_at: list[float],
    scenes_at: list[float],
    lost: list[tuple[float, float]],
    inputs: list[float] | None = None,
    least: float = 0.0,
) -> float:
    """Where a message says something for two seconds."""
    course = [(ns(at), HERE) for at in poses_at]
    scenes: list[tuple[int, Point, list[Point]]] = [(ns(at), HERE, []) for at in scenes_at]
    wanted = separation(minDistance=1, maxAge="2s", minCoverage=least)
    stretches = [(ns(begin), ns(end)) for begin, end in lost]
    return motion._share(course, scenes, stretches, wanted, window(inputs))


def test_the_share_is_without_what_is_too_old_and_without_what_is_lost() -> None:
    always = [10.0, 12, 14, 16, 18]
    assert share(always, always, []) == 1
    assert share([10, 12], always, []) == pytest.approx(0.4)
    assert share(always, [12, 14], []) == pytest.approx(0.6)
    # Both at once, and each by itself.
    assert share([10, 12, 16, 18], [10, 12, 18], []) == pytest.approx(0.6)
    assert share(always, always, [(11, 12.5), (12, 13)]) == pytest.approx(0.8)
    assert share(always, always, [(8, 11), (7, 9), (9, 10)]) == pytest.approx(0.9)
    assert share(always, [], []) == 0
    assert share(always, [9.5, 20, 21], []) == 0
    assert share([], [10], []) == pytest.approx(0.2)


def test_a_share_that_is_too_small_is_of_the_time_in_which_inputs_came() -> None:
    """They came from 10 to 15 s, and nothing that is judged came behind 12 s."""
    inputs = [10 + step / 4 for step in range(21)]
    for enough in (0.3, 0.4):
        assert share([10.0, 12], [10.0, 12], [], inputs, enough) == pytest.approx(0.4)
    assert share([10.0, 12], [10.0, 12], [], inputs, 0.5) == pytest.approx(0.8)
    # Where it is not known when they came, it is all the time.
    assert share([10.0, 12], [10.0, 12], [], [], 0.5) == pytest.approx(0.4)
    assert share([10.0, 12], [10.0, 12], [], [10.0], 0.5) == 1


def test_a_scene_has_the_ego_s_pose_of_then_if_one_is_near_enough_in_time() -> None:
    course: list[tuple[int, Point]] = [(ns(11), (1, 0)), (ns(12.25), (3.5, 0)), (ns(15), (9, 0))]
    times = [10.0, 10.5, 11, 11.5, 12, 12.75, 13.25, 13.5, 14.5, 15, 16, 16.001]
    scenes: list[tuple[int, list[Point]]] = [(ns(at), [(at, at)]) for at in times]
    found = motion._with_ego(course, Way(course, ns(1)), scenes, ns(1))
    assert [(time / 1e9, x) for time, (x, _), _ in found] == [
        (10, 1), (10.5, 1), (11, 1), (11.5, 2), (12, 3), (12.75, 3.5), (13.25, 3.5), (15, 9),
        (16, 9),
    ]  # fmt: skip
    assert [points for _, _, points in found][:2] == [[(10, 10)], [(10.5, 10.5)]]


def test_a_message_s_time_is_its_stamp_where_both_have_some() -> None:
    given, sample = evidence([]), Sample(ns(17), None)

    def when() -> list[int]:
        return [motion._when(sample, stamped, given) for stamped in (True, False)]

    assert when() == [ns(17), ns(17)]
    sample.stamp = ns(15)
    assert when() == [ns(15), ns(17)]
    for bad in (0, ns(500)):
        sample.stamp = bad
        assert when() == [ns(17), ns(17)]


def test_where_things_are_is_read_off_their_messages() -> None:
    assert motion._ego_at(Sample(0, stamped(1, 3, 4)), "/ego") == (3, 4)
    assert motion._points(Sample(0, poses(1, (3, 4), (5, 6))), "/cars") == [(3, 4), (5, 6)]
    path = STORE.types["nav_msgs/msg/Path"](header(11), [stamped(11, 3, 4)])
    assert motion._points(Sample(0, path), "/cars") == [(3, 4)]
    with pytest.raises(NoEvidenceError, match="messages on /ego have no pose: record an Odometry"):
        motion._ego_at(Sample(0, number(1)), "/ego")
    with pytest.raises(NoEvidenceError, match="messages on /cars have no poses: record a PoseArr"):
        motion._points(Sample(0, number(1)), "/cars")


@pytest.mark.parametrize(("ego", "obstacle"), [((NAN, 0), HERE), (HERE, (0, NAN)), (HERE, HERE)])
def test_what_lies_between_messages_is_asked_only_of_places_that_are_numbers(
    ego: Point, obstacle: Point
) -> None:
    course = [(ns(11), ego), (ns(12), HERE)]
    scenes = [(ns(11), [obstacle]), (ns(12), [HERE])]
    found = motion._between(course, Way(course, ns(1)), scenes, ns(1), ns(12.5))
    assert [found.feared, found.unknown] == [[], []]
    # From the first message to the second, and behind the last pose nothing is known.
    nothing = math.isnan(ego[0] + obstacle[1])
    assert found.seen == ([] if nothing else [(ns(11), HERE, HERE), (ns(12), HERE, HERE)])


def measured(*cars: tuple[float, list[Point]], **wanted: Any) -> Finding:
    """Beside an ego that stands, of which there is a pose each second."""
    recorded = [("/ego", float(at), stamped(at, 0, 0)) for at in range(10, 20)]
    recorded += [("/cars", at, poses(at, *points)) for at, points in cars]
    return motion.separation("c", separation(**wanted), evidence(recorded))


def test_a_criterion_says_of_what_part_of_the_window_it_speaks() -> None:
    scenes = [(float(at), [(3.0, 4.0)]) for at in range(10, 15)]
    found = measured(*scenes, minDistance=5)
    assert (found.outcome, found.figure, found.coverage, found.clock) == (
        "passed", 5.0, 0.5, "header",
    )  # fmt: skip
    assert found.covered == "50% of the window, in which both are at most 1s old"
    few = measured(*scenes, minDistance=5, minCoverage=0.6)
    assert few.outcome == "invalid"
    assert "raise maxAge if they are published less often, or lower minCoverage" in few.message
    # What came too near did so, however little else was seen.
    near = measured(*scenes, minDistance=6, minCoverage=0.6)
    assert (near.outcome, near.instead) == ("failed", "invalid")
    assert measured(*scenes, minDistance=5, minCoverage=0.5).outcome == "passed"


def test_an_obstacle_that_was_lost_near_the_ego_before_it_had_a_speed_is_not_covered() -> None:
    scenes: list[tuple[float, list[Point]]] = [(10 + n / 2, [(99.0, 0.0)]) for n in range(20)]
    for far, coverage in ((3.0, 1.0), (2.75, 0.9)):
        scenes[4] = (12.0, [(99.0, 0.0), (far, 0.0)])
        found = measured(*scenes, minDistance=0.5, minTimeToCollision=0.001, radius=1.5)
        assert found.coverage == coverage
        lost = " and no obstacle was lost near the ego before it had a speed"
        assert found.covered.endswith(lost) == (coverage < 1)


def test_places_of_two_frames_are_no_distance_unless_somebody_says_that_they_are() -> None:
    scene = poses(11, (3, 4))
    scene.header.frame_id = "odom"
    given = evidence([("/ego", 11.0, stamped(11, 0, 0)), ("/cars", 11.0, scene)])
    with pytest.raises(NoEvidenceError, match="/ego is in the frame map and /cars in the frame od"):
        motion.separation("c", separation(minDistance=1), given)
    found = motion.separation("c", separation(minDistance=1, anyFrame=True), given)
    assert found.figure == 5


def test_what_is_measured_is_kept_with_all_places() -> None:
    wanted = separation(minDistance=1)
    given = evidence([
        ("/ego", 12.0, stamped(12, 1, 0)), ("/ego", 11.0, stamped(11, 0, 0)),
        ("/cars", 11.0, poses(11, (3, 4), (9, 0))), ("/cars", 12.0, poses(12)),
    ])  # fmt: skip
    motion.separation("c", wanted, given)
    kept: Met = given.kept(wanted)
    assert kept.course == [(ns(11), (0, 0)), (ns(12), (1, 0))]
    assert kept.obstacles == [(ns(11), (3, 4)), (ns(11), (9, 0))]
    assert kept.pairs[:2] == [pair(11, (3, 4)), pair(11, (9, 0))]
    assert kept.share == pytest.approx(0.3)
    assert kept.clock == "header"
