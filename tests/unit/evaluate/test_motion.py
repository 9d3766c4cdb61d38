"""Distances and times to a collision, each worked out by hand."""

import math
import random
import re
from collections.abc import Callable
from typing import Any

import pytest
from scipy.spatial import KDTree

from bagpipe.evaluate import tracks
from bagpipe.evaluate.finding import Finding
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion, Separation
from bagpipe.evaluate.motion import closest, nearest, separation
from tests.unit.evaluate.recordings import STORE, evidence, header, number, poses, stamped

Point = tuple[float, float]
SECOND = 1_000_000_000
FAR = {"ego": "/ego", "obstacles": "/cars", "minCoverage": 0}
NOBODY_SAW = "between two messages that have it, or after the last one, an obstacle may have been"


def ego(at: float, x: float = 0.0, y: float = 0.0) -> Any:
    return ("/ego", at, stamped(at, x, y))


def cars(at: float, *points: Point) -> Any:
    return ("/cars", at, poses(at, *points))


def found(entries: list[Any], inputs: list[int] | None = None, **wanted: Any) -> Finding:
    """In a window from 10 to 20 s."""
    criterion = Criterion.model_validate({"name": "c", "separation": FAR | wanted})
    asked = None if inputs is None else (lambda: inputs)
    [finding] = evaluate([criterion], evidence(entries, inputs=asked))
    return finding


# Circles of half a metre each meet where their centres are a metre apart.
@pytest.mark.parametrize(
    ("ego_to", "car_from", "car_to", "seconds"),
    [
        ((0, 0), (12, 0), (10, 0), 4.5),
        ((0, 0), (-12, 0), (-10, 0), 4.5),
        ((0, 0), (0, 12), (0, 10), 4.5),
        ((0, 0), (12, 0.6), (10, 0.6), 4.6),  # it meets the ego 0.8 m before it is beside it
        ((0, 0), (12, 1), (10, 1), 5.0),  # it grazes the ego
        ((0, 0), (12, 1.01), (10, 1.01), math.inf),
        ((0, 0), (9, 12), (6, 8), 1.8),
        ((3, 4), (9, 12), (9, 12), 1.8),  # the ego drives, and the car stands
        ((1, 4), (9, 12), (7, 12), 1.8),  # both do
        ((0, 0), (10, 0), (12, 0), math.inf),
        ((0, 0), (10, 0), (10, 0), math.inf),
        ((2, 0), (10, 0), (12, 0), math.inf),
        ((0, 0), (10, 0), (1, 0), 0.0),
        ((0, 0), (1, 0), (1, 0), 0.0),  # they touch, and nothing moves
        ((0, 0), (0.5, 0), (1, 0), 0.0),  # nor does it matter that they part
        ((0, 0), (10, 4), (10, 0), math.inf),  # it is nearest now
        ((0, 0), (10, 0), (-0.3, 0.4), 0.0),
    ],
)
def test_circles_meet_at_the_speeds_of_the_last_second(
    ego_to: Point, car_from: Point, car_to: Point, seconds: float
) -> None:
    entries = [ego(10), ego(11, *ego_to), cars(10, car_from), cars(11, car_to)]
    finding = found(entries, minTimeToCollision=0.001, radius=0.5, maxAge="0.5s")
    assert finding.figure == pytest.approx(seconds)
    assert finding.outcome == ("passed" if seconds else "failed")


@pytest.mark.parametrize("origin", [(100, 0), (0, 40), (-30, 70)])
def test_where_the_origin_lies_changes_no_speed(origin: Point) -> None:
    """Both drive: what counts is where they are to each other."""

    def there(x: float, y: float) -> Point:
        return x + origin[0], y + origin[1]

    entries = [ego(10, *there(0, 0)), ego(11, *there(1, 4))]
    entries += [cars(10, there(9, 12)), cars(11, there(7, 12))]
    assert found(entries, minTimeToCollision=1, radius=0.5).figure == pytest.approx(1.8)


def test_the_soonest_collision_is_reported_with_its_time() -> None:
    entries = [ego(10), ego(12), ego(14)]
    entries += [cars(10, (20, 0)), cars(12, (10, 0)), cars(14, (8, 0))]
    finding = found(entries, minTimeToCollision=2, radius=0.5)
    assert (finding.outcome, finding.unit, finding.direction) == ("failed", "s", "higher")
    # 9 m at 5 m/s; later 7 m at 1 m/s.
    assert finding.message == "1.8 s to a collision at 2.000 s, and may be at least 2 s"


def test_a_speed_needs_an_earlier_place_of_the_same_car() -> None:
    entries = [ego(10), ego(11), cars(10, (12, 0)), cars(11, (10, 0), (3, 0))]
    assert found(entries, minTimeToCollision=1, radius=0.5).figure == 4.5


@pytest.mark.parametrize(
    "scenes",
    [
        [(11.1, 11.0, (12, 0))],
        # Two scenes of one time: nothing moves in no time.
        [(11.1, 11.0, (12, 0)), (11.2, 11.0, (10, 0))],
    ],
)
def test_where_no_speed_is_known_there_is_no_time_to_a_collision(scenes: list[Any]) -> None:
    entries = [ego(11), *(("/cars", at, poses(stamp, car)) for at, stamp, car in scenes)]
    finding = found(entries, minTimeToCollision=1, radius=0.5)
    assert (finding.outcome, finding.figure) == ("invalid", None)
    assert finding.message == "no obstacle on /cars was seen at two times, so that none has a speed"
    # Who stands in it needs no speed, and a distance is known without one.
    within = [*entries, ("/cars", 11.3, poses(11, (0.5, 0)))]
    assert found(within, minTimeToCollision=1, radius=0.5).figure == 0.0
    assert found(entries, minDistance=1).outcome == "passed"


def test_the_nearest_car_of_every_scene_is_its_distance() -> None:
    entries = [ego(10), ego(11, 1, 1), cars(10, (30, 40), (3, 4)), cars(11, (1, 9), (1, 6))]
    wanted = Separation.model_validate(FAR | {"minDistance": 1})
    given = evidence([*entries, cars(10.5)])
    assert closest(wanted, given) == [(10 * SECOND, 5.0), (11 * SECOND, 5.0)]
    finding = found([*entries, cars(11.5, (1, 5.5))], minDistance=5)
    assert finding.message == "4.5 m at 1.500 s, and may be at least 5 m"


def test_of_two_bounds_the_distance_is_reported_where_it_is_too_small() -> None:
    entries = [ego(10), ego(11), cars(10, (12, 0)), cars(11, (10, 0))]
    both: dict[str, Any] = {"minTimeToCollision": 4.5, "radius": 0.5}
    assert found(entries, minDistance=10, **both).message == "4.5 s to a collision at 1.000 s"
    assert found(entries, minDistance=10.1, **both).unit == "m"
    for least in (10, 10.1):
        figures = found(entries, minDistance=least, **both).figures
        assert [(each.figure, each.unit) for each in figures] == [(10.0, "m"), (4.5, "s")]
    # What is too near is so without a speed.
    alone = found([ego(11), cars(11, (10, 0))], minDistance=10.1, **both)
    assert (alone.outcome, alone.figure, alone.figures) == ("failed", 10.0, ())
    assert found(entries, minDistance=10).message == "10 m at 1.000 s"


@pytest.mark.parametrize(("age", "distances"), [("1s", [3.0, 2.0]), ("999ms", [3.0])])
def test_a_scene_counts_while_the_ego_s_pose_is_at_most_so_old(
    age: str, distances: list[float]
) -> None:
    wanted = Separation.model_validate(FAR | {"minDistance": 1, "maxAge": age})
    entries = [ego(12), cars(12, (3, 0)), cars(13, (2, 0)), cars(13.5, (1, 0))]
    assert [metres for _, metres in closest(wanted, evidence(entries))] == distances


def test_at_a_scene_between_two_poses_the_ego_is_on_its_way() -> None:
    entries = [ego(11, 1), ego(12, 2), ego(14, 6), cars(12, (10, 0)), cars(12.9, (11, 0))]
    assert found(entries, minDistance=1).figure == pytest.approx(7.2)
    # Of poses that are further apart the last one counts; so does the first, a little before it.
    assert found(entries, minDistance=1, maxAge="950ms").figure == 8.0
    assert found([cars(10.5, (10, 0)), ego(11, 1)], minDistance=1).figure == 9.0


@pytest.mark.parametrize(
    ("scenes", "age", "share"),
    [
        (range(10, 20), "1s", 1.0),
        ([10, 11, 12], "1s", 0.3),
        ([10, 11, 12], "1500ms", 0.35),
        ([10, 11, 12, 17, 18], "1s", 0.5),
        ([14], "1s", 0.2),  # a second from the window's start, and one from the scene
        ([14], "10s", 1.0),
    ],
)
def test_a_scene_speaks_for_the_time_until_it_is_too_old(
    scenes: list[float], age: str, share: float
) -> None:
    entries = [each for at in scenes for each in (ego(at), cars(at, (9, 9)))]
    finding = found(entries, minDistance=1, maxAge=age)
    assert (finding.coverage, finding.clock) == (share, "header")
    assert finding.covered == (f"{share:.0%} of the window, in which both are at most {age} old")


def test_what_is_covered_has_both_a_pose_and_a_scene() -> None:
    """Poses each 2.5 s, of which each speaks for a second, and scenes but from 15 to 18 s."""
    entries = [ego(10 + n * 2.5) for n in range(4)]
    entries += [cars(10 + n / 10, (9, 9)) for n in range(100) if not 50 < n < 80]
    finding = found(entries, minDistance=1)
    assert finding.coverage == 0.35
    late = [each for each in entries if each[0] == "/cars" or each[1] < 15]
    assert found(late, minDistance=1).coverage == 0.2
    assert found(late, minDistance=1, maxAge="1500ms").coverage == 0.3


def test_where_no_inputs_came_no_scene_is_missed() -> None:
    entries = [each for at in (10, 11, 12) for each in (ego(at), cars(at, (9, 9)))]
    for last, share in ((12.5, 1.0), (14.0, 0.75)):
        inputs = [round((10 + n / 10) * SECOND) for n in range(round((last - 10) * 10) + 1)]
        assert found(entries, inputs, minDistance=1, minCoverage=0.3).coverage == 0.3
        wanted = {"minDistance": 1, "minCoverage": 0.31}
        assert found(entries, inputs, **wanted).coverage == share


def test_only_what_lies_in_the_window_speaks_for_it() -> None:
    """A stamp may be a rounding later than its receipt, and of the lead-in's time."""
    late = [("/ego", 19.9998, stamped(20.0004, 0, 0)), ("/cars", 19.9998, poses(20.0004, (9, 9)))]
    assert found(late, minDistance=1).coverage == 0.0
    early = [("/ego", 11, stamped(9.5, 0, 0)), ("/cars", 11, poses(9.5, (9, 9)))]
    assert found(early, minDistance=1).coverage == 0.0
    first = [ego(10), cars(10, (9, 9))]
    assert found(first, minDistance=1).coverage == 0.1


@pytest.mark.parametrize("what", ["the ego's pose", "an obstacle's pose"])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_place_that_is_no_number_fails_with_its_time(what: str, axis: int) -> None:
    odd = (1.0, math.nan) if axis else (math.inf, 1.0)
    here, there = (odd, (5.0, 5.0)) if "ego" in what else ((0.0, 0.0), odd)
    finding = found([ego(11, *here), ego(12), cars(11, there), cars(12, (5, 5))], minDistance=1)
    assert (finding.outcome, finding.figure, finding.instead) == ("failed", None, "failed")
    value = "nan" if axis else "inf"
    assert finding.message == (
        f"{what} is no finite number but {value} at 1.000 s, the first of 1 of 4 values"
    )


def test_too_little_that_was_seen_is_invalid_and_says_what_to_do() -> None:
    few = [each for at in range(10, 15) for each in (ego(at), cars(at, (9, 0)))]
    finding = found(few, minDistance=1, minCoverage=0.6)
    assert (finding.outcome, finding.coverage) == ("invalid", 0.5)
    assert finding.message == (
        "judged on 50% of the window, in which both are at most 1s old, which is 50%, and at least"
        " 60% are needed: raise maxAge if they are published less often, or lower minCoverage;"
        " 9 m at 0.000 s"
    )
    # A car that came too near did so, however little else was seen.
    assert found(few, minDistance=10, minCoverage=0.6).outcome == "failed"


def test_places_of_two_frames_are_compared_only_where_somebody_says_so() -> None:
    scene = poses(11, (3, 0))
    scene.header.frame_id = "odom"
    entries = [ego(11), ("/cars", 11, scene)]
    finding = found(entries, minDistance=1)
    assert finding.outcome == "invalid"
    assert finding.message.startswith("/ego is in the frame map and /cars in the frame odom:")
    assert found(entries, minDistance=1, anyFrame=True).figure == 3.0


def test_what_was_measured_is_not_measured_again() -> None:
    wanted = Separation.model_validate(FAR | {"minDistance": 1})
    given = evidence([ego(11), cars(11, (3, 0))])
    separation("c", wanted, given)
    kept = given.kept(wanted)
    assert nearest(wanted, given) == [(11 * SECOND, (0.0, 0.0), (3.0, 0.0))]
    assert given.kept(wanted) is kept


def test_stamps_of_another_clock_leave_the_times_of_receipt() -> None:
    entries = [ego(12), ego(13, 1), ("/cars", 13.5, poses(900, (3, 0)))]
    finding = found(entries, minDistance=1, maxAge="600ms")
    assert (finding.figure, finding.clock) == (2.0, "receipt")
    # Also where it is the ego's clock that is another one.
    entries = [("/ego", 13, stamped(900, 1, 0)), ("/cars", 13.5, poses(13.2, (3, 0)))]
    finding = found(entries, minDistance=1, maxAge="600ms")
    assert (finding.figure, finding.clock) == (2.0, "receipt")


def test_cars_may_be_poses_with_headers_of_their_own() -> None:
    places = [stamped(11, 3, 4), stamped(11, 6, 8)]
    path = STORE.types["nav_msgs/msg/Path"](header(11), places)
    entries = [ego(11), ("/cars", 11, path)]
    assert found(entries, minDistance=1).figure == 5.0
    # One names no frame, none does but the poses, and one is in another one.
    places[0].header.frame_id = ""
    assert found(entries, minDistance=1).figure == 5.0
    header_of: Any = path
    header_of.header.frame_id = ""
    assert found(entries, minDistance=1).figure == 5.0
    places[0].header.frame_id = "base_link"
    finding = found(entries, minDistance=1)
    assert finding.outcome == "invalid"
    assert "/cars in the frame base_link, then map" in finding.message


@pytest.mark.parametrize(
    ("entries", "sentence"),
    [
        ([("/ego", 11, number(1)), cars(11, (1, 1))], "messages on /ego have no pose: record"),
        ([ego(11), ("/cars", 11, number(1))], "messages on /cars have no poses: record a Pose"),
        ([ego(11), cars(11)], "no obstacle was ever on /cars"),
        ([ego(11), cars(13, (1, 1))], "no obstacle was ever on /cars while a pose on /ego was at"),
    ],
)
def test_what_can_t_be_measured_is_reported(entries: list[Any], sentence: str) -> None:
    finding = found(entries, minDistance=1)
    assert (finding.outcome, finding.figure) == ("invalid", None)
    assert finding.message.startswith(sentence)


def pass_by(*scenes: tuple[float, list[Point]], speed: float = 20.0, each: int = 1) -> list[Any]:
    """An ego that drives along x, with a pose each 50 ms or multiples of it, and what it meets."""
    course = [ego(10 + step / 20, step / 20 * speed) for step in range(0, 200, each)]
    return course + [cars(at, *points) for at, points in scenes]


OTHER = (300.0, 40.0)


@pytest.mark.parametrize("place", [45.5, 45.0, 54.0], ids=["beside", "at a pose", "at a scene"])
def test_an_obstacle_that_stands_is_met_between_its_messages_too(place: float) -> None:
    scenes = [(10 + n * 0.9, [(place, 2.0), OTHER][:: 1 if n % 2 else -1]) for n in range(12)]
    finding = found(pass_by(*scenes), minDistance=5, maxAge="1s")
    assert finding.outcome == "failed"
    assert finding.figure == pytest.approx(2.0)
    assert finding.message.startswith(f"2 m at {place / 20:.3f} s")


@pytest.mark.parametrize("between", [0.05, 0.9], ids=["often", "seldom"])
def test_an_obstacle_is_met_between_two_poses_of_the_ego_too(between: float) -> None:
    """A pose each 0.9 s, of 18 m."""
    scenes = [(10 + n * between, [(99.0, 0.0)]) for n in range(round(10 / between))]
    finding = found(pass_by(*scenes, each=18), minDistance=5)
    assert finding.outcome == "failed"
    assert finding.figure == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("last", "soon"), [(18.5, 11.0), (18.95, 2.0)])
def test_an_obstacle_that_stands_is_met_behind_the_last_scene_too(last: float, soon: float) -> None:
    scenes = [(at, [(185.0, 0.0)]) for at in (17.5, 18.0, last)]
    finding = found(pass_by(*scenes), minDistance=5)
    assert (finding.outcome, finding.figure) == ("failed", 0.0)
    assert finding.message.startswith("0 m at 9.250 s")
    # For no longer than what was seen says something.
    shortly = found(pass_by(*scenes), minDistance=5, maxAge="200ms")
    assert shortly.figure == pytest.approx(soon)


def often(*obstacles: Point, least: float = 0.0, most: float = 1e9) -> list[Any]:
    """Messages at 20 Hz of those obstacles that stand and are at most and at least so far away."""
    scenes = []
    for step in range(200):
        near = [each for each in obstacles if least <= abs(each[0] - step) <= most]
        scenes.append((10 + step / 20, near))
    return scenes


def test_what_a_sensor_loses_below_its_least_range_was_driven_through() -> None:
    """It is lost 4 m before the ego, and for the next 20 messages nothing shows where it went."""
    ahead = [(at, [each for each in seen if each[0] > (at - 10) * 20]) for at, seen in
             often((100.0, 0.0), OTHER, least=4)]  # fmt: skip
    finding = found(pass_by(*ahead), minDistance=2)
    assert finding.outcome == "invalid"
    assert finding.figure == pytest.approx(4.0)
    assert finding.message.startswith(f"{NOBODY_SAW} 0 m away")
    # Where it is seen again behind the ego, it was there all the time.
    again = found(pass_by(*often((100.0, 0.0), OTHER, least=4)), minDistance=2)
    assert again.outcome == "failed"
    assert again.figure == pytest.approx(0.0, abs=1e-6)
    # Nor for longer than maxAge.
    assert found(pass_by(*ahead), minDistance=2, maxAge="50ms").outcome == "passed"


@pytest.mark.parametrize(
    "scenes",
    [
        [(11.1, [(50.0, 0.0)]), (12.0, [(50.0, 0.0)]), (12.9, []), (13.8, [OTHER])],
        [(11.1, [OTHER, (50.0, 0.0)]), (12.0, [(50.0, 0.0), OTHER]), (12.9, [OTHER])],
        # What comes instead is too far away to be the same.
        [(11.1, [(50.0, 0.0)]), (12.0, [(50.0, 0.0)]), (12.9, [(57.0, 8.0)])],
        # It moved, and would be met if it went on.
        [(10.2, [(64.0, 0.0)]), (11.1, [(58.0, 0.0)]), (12.0, [(52.0, 0.0)]), (12.9, [])],
        # It is lost 15 m before the ego, as by a sensor that it drives into.
        [(10 + n * 0.9, [(105.0, 0.0), OTHER] if n < 6 else [OTHER]) for n in range(12)],
    ],
    ids=["none", "others", "far", "moving", "long"],
)
def test_one_that_is_not_seen_any_more_may_have_come_too_near(
    scenes: list[tuple[float, list[Point]]],
) -> None:
    finding = found(pass_by(*scenes), minDistance=5)
    assert finding.outcome == "invalid"
    assert finding.message.startswith(NOBODY_SAW)
    assert "publish them more often" in finding.message
    assert finding.figure is not None
    # That it is too near decides, whatever else is not known.
    assert found(pass_by(*scenes), minDistance=200).outcome == "failed"
    # Circles that may have met are no time to a collision either.
    collision = found(pass_by(*scenes), minTimeToCollision=0.01, radius=0.5)
    assert (collision.outcome == "invalid") or collision.figure == 0.0


@pytest.mark.parametrize(
    ("scene", "share"),
    [
        # As one that is as fast as the ego, and comes into sight in the last message.
        ((19.5, [(199.0, 0.0)]), 0.95),
        ((15.0, [(109.0, 0.0)]), 0.9),
        # Too far away for the ego to come near it within maxAge.
        ((15.0, [(139.0, 0.0)]), 1.0),
    ],
    ids=["last", "lost", "far"],
)
def test_where_one_went_that_was_seen_once_is_not_made_up(
    scene: tuple[float, list[Point]], share: float
) -> None:
    scenes = [(10 + n / 2, [OTHER]) for n in range(20) if 10 + n / 2 != scene[0]]
    finding = found(pass_by(*scenes, (scene[0], [*scene[1], OTHER])), minDistance=5)
    assert finding.outcome == "passed"
    assert finding.coverage == pytest.approx(share, abs=1e-3)
    assert (finding.covered or "").endswith("before it had a speed") == (share < 1)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("each", [1, 2, 10])
def test_the_order_of_the_list_and_noise_make_no_ghosts(each: int, seed: int) -> None:
    """Traffic as fast as the ego and oncoming, and a row that is parked, at 20, 10 and 2 Hz."""
    chance, scenes = random.Random(seed), []  # noqa: S311
    for step in range(0, 200, each):
        ahead = [(step + x, y) for x, y in ((6, 3.5), (-7, -3.5), (11, -3.5), (15, 0))]
        oncoming = [(x - step, 7.0) for x in range(0, 400, 17) if -10 < x - 2 * step < 60]
        parked = [(x, -7.0) for x in range(0, 300, 6) if -10 < x - step < 60]
        all_of = [*ahead, *oncoming, *parked]
        chance.shuffle(all_of)
        noisy = [(x + chance.gauss(0, 0.1), y + chance.gauss(0, 0.1)) for x, y in all_of]
        scenes.append((10 + step / 20, noisy))
    finding = found(pass_by(*scenes), minDistance=2.5, minCoverage=0.9)
    assert finding.outcome == "passed", finding.message


@pytest.mark.parametrize(
    ("course", "obstacle"),
    [
        # A localization that is at the origin until it knows where it is.
        ([(0.0 if step < 6 else 100 + step, 0.0) for step in range(200)], (50.0, 0.0)),
        # One that closes a loop.
        ([(step / 4, 0.0 if step < 100 else 6.0) for step in range(200)], (25.0, 3.0)),
    ],
    ids=["begins", "corrected"],
)
def test_the_ego_has_not_driven_where_its_place_jumps(course: list[Point], obstacle: Point) -> None:
    entries = [ego(10 + step / 20, *place) for step, place in enumerate(course)]
    scenes = [cars(10 + step / 10, obstacle) for step in range(100)]
    finding = found(entries + scenes, minDistance=2.5)
    assert finding.outcome == "passed", finding.message


@pytest.mark.parametrize(
    "scenes",
    [
        # It drives ahead as fast, and where it was half a second ago is where the ego is now.
        [(10 + n * 0.9, [(10 + n * 18.0, 0.0)]) for n in range(12)],
        # Two do, and their list begins with another one each time.
        [(10 + n * 0.9, [(10 + n * 18.0, 0.0), (25 + n * 18.0, 0.0)][:: 1 if n % 2 else -1])
         for n in range(12)],
        # It drives ahead, and is not seen any more; or nothing is, from then on.
        [(12.0 + n / 2, [(50.0 + n * 10, 0.0)]) for n in range(6)] + [(15.0, [])],
        [(17.0 + n / 2, [(150.0 + n * 10, 0.0)]) for n in range(6)],
        # It has moved away by the next message.
        [(12.0, [(45.0, 0.0)]), (12.9, [(45.0, 30.0)]), (13.8, [(45.0, 30.0)])],
        # It was seen long before.
        [(10.0, [(45.0, 0.0)]), (13.5, [(45.0, 0.0)])],
    ],
    ids=["ahead", "two ahead", "lost ahead", "last ahead", "away", "old"],
)  # fmt: skip
def test_where_one_that_moves_was_in_between_is_not_made_up(
    scenes: list[tuple[float, list[Point]]],
) -> None:
    finding = found(pass_by(*scenes), minDistance=5, maxAge="1s")
    assert (finding.outcome, (finding.figure or 0) >= 5) == ("passed", True), finding


@pytest.mark.parametrize(
    ("course", "rate", "metres", "at"),
    [
        # Someone crosses at 8 m/s, is 2.15 m from the ego in two messages, and hits it in between.
        (lambda seconds: (102.0, 8.0 * (seconds - 5.1)), 5, 0.0, 5.1),
        # One that turns does as well: it goes round a circle of 12 m at 1.2 m/s².
        (lambda seconds: (102.0 - 12.0 * (1 - math.cos((seconds - 5.1) / 3)),
                          12.0 * math.sin((seconds - 5.1) / 3)), 2, 0.006, 5.1),
        # An oncoming one passes 1.8 m beside the ego, and is 2 m ahead and behind in messages.
        (lambda seconds: (202.0 - 20.0 * seconds, 1.8), 10, 1.8, 5.05),
    ],
    ids=["crossing", "turning", "oncoming"],
)  # fmt: skip
def test_one_whose_speed_is_known_is_met_between_its_messages_too(
    course: Callable[[float], Point], rate: int, metres: float, at: float
) -> None:
    scenes = [(10 + step / rate, [course(step / rate), OTHER]) for step in range(10 * rate)]
    finding = found(pass_by(*scenes), minDistance=2)
    assert finding.outcome == "invalid", finding
    where = re.match(rf"{NOBODY_SAW} ([\d.e-]+) m away at ([\d.]+) s", finding.message)
    assert where, finding.message
    assert float(where[1]) == pytest.approx(metres, abs=0.01)
    assert float(where[2]) == pytest.approx(at, abs=0.01)
    assert finding.figure is not None
    assert finding.figure > 2


@pytest.mark.parametrize("lost", [range(10, 11), range(9, 11)], ids=["one", "two"])
def test_one_that_turns_is_met_between_its_messages_though_one_in_between_lacks_it(
    lost: range,
) -> None:
    """At 7 m/s it goes round a circle of 12 m, at 4 m/s², and is seen twice a second but then."""
    scenes = []
    for step in range(20):
        angle = 7 / 12 * (step / 2 - 5.1)
        place = (102.0 + 12.0 * (1 - math.cos(angle)), 12.0 * math.sin(angle))
        scenes.append((10 + step / 2, [OTHER] if step in lost else [place, OTHER]))
    finding = found(pass_by(*scenes), minDistance=0.5, maxAge="2s")
    assert finding.outcome == "invalid", finding
    assert finding.message.startswith(NOBODY_SAW)


@pytest.mark.parametrize("rate", [1, 2, 5, 20])
def test_where_one_came_from_is_known_when_it_has_been_followed(rate: int) -> None:
    """It comes into sight just before the ego, crosses its way at 40 m/s, and drives on."""
    scenes = []
    for step in range(10 * rate):
        seconds = (step + 0.5) / rate
        place = (20.0 * (5 + 1 / rate), 40.0 * (seconds - 5 - 1 / rate))
        scenes.append((10 + seconds, [OTHER, place] if seconds > 5 else [OTHER]))
    finding = found(pass_by(*scenes), minDistance=0.9)
    assert finding.outcome == "invalid", finding
    assert finding.message.startswith(f"{NOBODY_SAW} "), finding


@pytest.mark.parametrize("apart", [0.0, 1e-6, 1e-3, 0.02], ids=["none", "1us", "1ms", "20ms"])
@pytest.mark.parametrize("speed", [8.0, 0.0], ids=["crossing", "standing"])
def test_two_sensors_that_see_one_at_nearly_the_same_time_give_it_no_speed_of_their_noise(
    apart: float, speed: float
) -> None:
    """Each sees it at 5 Hz, 0.28 m from where the other one does; it is hit between messages."""
    scenes = []
    for step in range(50):
        for late, off in ((0.0, 0.0), (apart, 0.2)):
            seconds = step / 5 + late
            place = (102.0 + off, speed * (seconds - 5.1) - off)
            scenes.append((10 + seconds, [place, OTHER]))
    finding = found(pass_by(*scenes), minDistance=1.5)
    assert finding.outcome == ("invalid" if speed else "failed"), finding
    assert finding.message.startswith(NOBODY_SAW) == bool(speed), finding


@pytest.mark.parametrize("speed", [60.0, 5.0])
def test_one_that_is_seen_very_often_is_followed_as_well(speed: float) -> None:
    """At 200 Hz, until the ego is 4 m before it."""
    scenes = []
    for step in range(2000):
        x = 102.0 + speed * (5.1 - step / 200)
        scenes.append((10 + step / 200, [(x, 0.0), OTHER] if x - step / 10 > 4 else [OTHER]))
    finding = found(pass_by(*scenes), minDistance=2)
    assert finding.outcome == "invalid", finding
    assert finding.message.startswith(NOBODY_SAW)


def test_the_time_until_one_without_a_speed_is_seen_elsewhere_is_not_covered() -> None:
    """It is 3 m ahead of the ego in one message, and 5 m beside it in the next, 0.2 s later."""
    scenes = [(10 + step / 5, [OTHER]) for step in range(50)]
    scenes[25][1].append((103.0, 0.0))
    scenes[26][1].append((104.0, -5.0))
    finding = found(pass_by(*scenes), minDistance=2)
    assert finding.outcome == "passed", finding
    assert finding.coverage == pytest.approx(0.98, abs=1e-6)


def test_one_that_creeps_is_where_it_was_on_its_way() -> None:
    """At 12.5 s, half of the way between its messages, it is 0.4 m beside the ego."""
    scenes = [(12.0, [(50.0, 0.2)]), (13.0, [(50.0, 0.6)])]
    finding = found(pass_by(*scenes), minDistance=5, maxAge="1s")
    assert finding.figure == pytest.approx(0.4, abs=1e-3)


@pytest.mark.parametrize(
    ("obstacle", "speed", "other"),
    [
        # What it hid comes into sight behind it: no further than what stands may have gone.
        ((100.0, 0.0), 0.0, (103.0, 2.5)),
        # It comes towards the ego, and is seen again behind it.
        ((200.0, 0.0), -20.0, None),
    ],
    ids=["another", "passed through"],
)
def test_what_a_sensor_lost_near_the_ego_is_not_found_elsewhere_unharmed(
    obstacle: Point, speed: float, other: Point | None
) -> None:
    """It is seen at 20 Hz, is lost 6 m before the ego, and is so for 0.4 s at least."""
    scenes = []
    for step in range(200):
        x = obstacle[0] + speed * step / 20
        near = [(x, obstacle[1])] if x - step > 6 or (other is None and x - step < -6) else []
        late = [other] if other is not None and step > obstacle[0] + 8 else []
        scenes.append((10 + step / 20, [*near, *late, OTHER]))
    finding = found(pass_by(*scenes), minDistance=2)
    assert finding.outcome == "invalid", finding
    assert finding.message.startswith(NOBODY_SAW)


@pytest.mark.parametrize("off", [0.0, 0.1], ids=["just there", "nearly there"])
def test_who_drives_over_a_place_is_not_who_was_seen_there_before(off: float) -> None:
    """A flash is 8 m ahead of the ego, and 16 m ahead of who follows it and is always seen."""
    scenes = [(10 + step / 20, [(step - 8.0, off), OTHER]) for step in range(200)]
    scenes[100][1].append((108.0, 0.0))
    finding = found(pass_by(*scenes), minDistance=2)
    assert finding.outcome == "passed", finding
    assert finding.coverage == pytest.approx(0.9, abs=1e-3)


def test_what_was_lost_before_the_window_covers_nothing_of_it() -> None:
    """It flashes up beside the ego again and again, all by stamps before the window."""
    entries = [*pass_by(), *(cars(10 + step / 20, OTHER) for step in range(10))]
    for turn in range(18):
        at, stamp = 10.001 + turn / 10_000, 5 + turn / 4
        entries += [("/ego", at, stamped(stamp, 0.0, 0.0))]
        entries += [("/cars", at, poses(stamp, (2.5, 0.0) if turn % 2 else (500.0, 0.0)))]
        entries += [("/ego", at, stamped(stamp + 0.15, 2.0, 0.0))]
        entries += [("/cars", at, poses(stamp + 0.2))]
    finding = found(entries, minDistance=2.2, maxAge="200ms", minCoverage=0.9)
    assert finding.outcome == "invalid", finding
    assert finding.coverage == pytest.approx(0.065)


def test_where_the_ego_s_place_jumps_nobody_comes_nearer_so_fast() -> None:
    course = [ego(10 + step / 20, step / 4 if step < 6 else 100 + step / 4) for step in range(200)]
    scenes = [cars(10 + step / 20, (300.0, 0.0)) for step in range(200)]
    finding = found(course + scenes, minTimeToCollision=5)
    # 150.25 m less two radii at 5 m/s.
    assert finding.outcome == "passed"
    assert finding.figure == pytest.approx(29.45, abs=0.01)


def test_who_steps_out_before_the_ego_and_is_lost_is_feared() -> None:
    """A cyclist is seen for 0.3 s at 50 Hz, and is lost 6 m before the ego and 2.4 m beside it."""
    scenes = [(10 + step / 50, [OTHER]) for step in range(500)]
    for step in range(235, 251):
        scenes[step][1].append((106.0, 8.0 * (step - 265) / 50))
    finding = found(pass_by(*scenes), minDistance=2)
    assert finding.outcome == "invalid", finding


# Places without messages are the same, whatever recordings are made of.
@pytest.mark.parametrize("form", ["ros1"], indirect=True)
def test_obstacles_in_one_place_are_looked_up_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tree has all that are in one place in one leaf, and each look passes all of them."""
    sizes: list[int] = []
    tree = KDTree

    def counted(points: Any) -> Any:
        sizes.append(len(points))
        return tree(points)

    monkeypatch.setattr("bagpipe.evaluate.tracks.KDTree", counted)
    padded = [(5.0, 5.0), (9.0, 0.0), *[(0.0, 0.0)] * 1000]
    scenes = [(step * SECOND // 10, padded) for step in range(5)]
    followed = list(tracks.stretches(scenes, SECOND, SECOND))
    assert max(sizes) == 3
    assert {(5.0, 5.0), (9.0, 0.0), (0.0, 0.0)} == {each.place for each in followed}


@pytest.mark.parametrize("form", ["ros1"], indirect=True)
def test_many_that_were_lost_at_once_are_not_looked_for_in_each_of_many_messages(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked_for: list[int] = []
    matched = tracks._matched

    def counted(waiting: Any, *more: Any) -> Any:
        looked_for.append(len(waiting))
        return matched(waiting, *more)

    monkeypatch.setattr(tracks, "_matched", counted)
    crowd = [(3.0 * place, 1000.0) for place in range(5000)]
    scenes = [(0, crowd), *((step * SECOND // 2000, [(0.0, -9000.0)]) for step in range(1, 2000))]
    followed = list(tracks.stretches(scenes, SECOND, SECOND))
    # Each is kept account of all the same.
    assert {each.place for each in followed if each.kind == "unknown"} >= set(crowd)
    assert sum(looked_for) < 300 * (len(crowd) + len(scenes))
    assert looked_for[1] == len(crowd)


def at_ten_hertz(*, until: int = 100) -> list[float]:
    return [10 + n / 10 for n in range(until)]


def beside(scenes: list[tuple[float, list[Point]]], speed: float = 0.0) -> list[Any]:
    """An ego that goes along x, and what is around it."""
    course = [ego(at, (at - 10) * speed) for at in at_ten_hertz()]
    return course + [cars(at, *points) for at, points in scenes]


def test_one_that_comes_into_sight_first_in_the_list_makes_no_other_one_faster() -> None:
    """All that is there stands."""
    scenes = [(at, [*([(15.0, 0.0)] if at > 15 else []), (30.0, 0.0)]) for at in at_ten_hertz()]
    finding = found(beside(scenes), minTimeToCollision=1.5)
    assert (finding.outcome, finding.figure) == ("passed", math.inf), finding.message


@pytest.mark.parametrize(("step", "speed"), [(0.1, 80), (0.2, 75), (0.5, 72)])
def test_one_that_is_faster_than_any_car_does_not_pass(step: float, speed: float) -> None:
    """Beside a parked car, whose speed is known."""
    scenes = []
    for turn in range(int(10 / step)):
        away = 500 - speed * turn * step
        there = [(200.0, 50.0), *([(away, 0.0)] if away > 30 else [])]
        scenes.append((10 + turn * step, there))
    finding = found(beside(scenes), minTimeToCollision=3)
    assert finding.outcome == "invalid", finding.message
    assert finding.figure == pytest.approx(0.425, abs=0.025)


@pytest.mark.parametrize("each", [1, 2, 3], ids=["kept", "turned round", "now and then"])
def test_in_whatever_order_they_are_listed_the_soonest_collision_is_found(each: int) -> None:
    """One comes from ahead at 8 m/s to 12 m, and one alike from behind."""
    scenes = []
    for turn, at in enumerate(at_ten_hertz()):
        away = 12 + 8 * abs(at - 15)
        order = 1 if turn % each == 0 else -1
        scenes.append((at, [(away, 0.0), (-away, 0.0)][::order]))
    finding = found(beside(scenes), minTimeToCollision=1.5)
    assert finding.outcome == "failed"
    assert finding.figure == pytest.approx(1.125)


@pytest.mark.parametrize("apart", [0.05, 0.02, 1e-6])
@pytest.mark.parametrize("off", [0.0, 0.2])
def test_two_sensors_in_turn_on_one_topic_see_nothing_move_that_stands(
    apart: float, off: float
) -> None:
    parked = [(20.0, 5.0), (60.0, 15.0)]
    scenes = []
    for at in at_ten_hertz():
        scenes += [(at, parked), (at + apart, [(x + off, y - off) for x, y in parked[::-1]])]
    finding = found(beside(scenes), minTimeToCollision=1.5)
    assert finding.outcome == "passed", finding.message
    # Also where each sees one of them alone.
    scenes = [(at, parked[turn % 2 :][:1]) for turn, at in enumerate(at_ten_hertz())]
    finding = found(beside(scenes), minTimeToCollision=1.5)
    assert finding.outcome == "passed", finding.message


def test_one_that_is_lost_in_each_other_message_has_its_speed() -> None:
    """It comes to 12 m at 8 m/s, and in between another one alone is seen."""
    scenes: list[tuple[float, list[Point]]] = []
    for turn, at in enumerate(at_ten_hertz()):
        scenes.append((at, [OTHER if turn % 2 else (12 + 8 * abs(at - 15), 0.0)]))
    finding = found(beside(scenes), minTimeToCollision=1.5)
    assert finding.outcome == "failed", finding.message
    assert finding.figure == pytest.approx(1.125)


def test_what_flashes_up_in_two_places_shows_no_speed_of_anybody() -> None:
    scenes = [(at, [OTHER]) for at in at_ten_hertz()]
    scenes[40][1].append((12.0, 0.0))
    scenes[41][1].append((9.5, 0.0))
    finding = found(beside(scenes), minTimeToCollision=1.5)
    assert finding.outcome == "invalid"
    assert finding.figure == pytest.approx(0.26)
    assert finding.message == (
        "which obstacle of one message is which of the next one is not sure, and it may have had no"
        " such speed: publish them more often; 0.26 s to a collision at 4.100 s, and may be at"
        " least 1.5 s"
    )
    # Who stands in it needs no speed, and is too near in any case.
    assert found(beside(scenes), minTimeToCollision=1.5, radius=5).outcome == "failed"
    both = found(beside(scenes), minTimeToCollision=1.5, minDistance=10)
    assert (both.outcome, both.unit) == ("failed", "m")
    assert [each.outcome for each in both.figures] == ["failed", "invalid"]
    # At its next message it is where that speed leads, so that it had it.
    scenes[42][1].append((7.2, 0.0))
    finding = found(beside(scenes), minTimeToCollision=0.2)
    assert finding.outcome == "failed"
    assert finding.figure == pytest.approx(4.2 / 23)


@pytest.mark.parametrize("each", [1.0, 0.5])
@pytest.mark.parametrize(
    ("start", "speed", "gap"), [(10.0, 20.0, 15.0), (185.0, -20.0, 20.0)], ids=["ahead", "oncoming"]
)
def test_in_rare_messages_of_a_column_it_is_not_known_who_is_who(
    start: float, speed: float, gap: float, each: float
) -> None:
    """Some are near where others were: by their places they stand, by their lists they go on."""
    scenes = []
    for turn in range(round(9 / each)):
        first = start + speed * turn * each
        scenes.append((10 + turn * each, [(first + gap * each * n, 0.0) for n in range(10)]))
    finding = found(beside(scenes, speed=max(speed, 0.0)), minTimeToCollision=1.5)
    assert finding.outcome == "invalid", finding
    # Often enough they are followed.
    often = [(at, [(start + speed * (at - 10), 0.0)]) for at in at_ten_hertz(until=85)]
    finding = found(beside(often, speed=max(speed, 0.0)), minTimeToCollision=1.5)
    assert finding.outcome == ("passed" if speed > 0 else "failed"), finding


def test_two_beside_each_other_in_any_order_have_no_speed_of_their_lists() -> None:
    chance, scenes = random.Random(3), []  # noqa: S311
    for at in at_ten_hertz():
        pair = [(12.0, 0.0), (12.8, 0.0), (14.0, 1.0)]
        chance.shuffle(pair)
        scenes.append((at, pair))
    finding = found(beside(scenes), minTimeToCollision=1.5)
    assert finding.outcome == "passed", finding.message


def test_where_the_ego_s_place_jumps_one_that_was_lost_meanwhile_has_no_speed() -> None:
    course = [ego(at, 0.0 if at < 14 else 40.0) for at in at_ten_hertz()]
    scenes = [cars(at, *([] if 13.55 < at < 14.35 else [(100.0, 0.0)])) for at in at_ten_hertz()]
    finding = found(course + scenes, minTimeToCollision=1.5)
    assert finding.outcome == "passed", finding.message
