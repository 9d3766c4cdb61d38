"""Distances and times to a collision, each worked out by hand."""

import math
from typing import Any

import pytest

from bagpipe.evaluate.finding import Finding
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion, Separation
from bagpipe.evaluate.motion import closest
from tests.unit.evaluate.recordings import STORE, evidence, header, number, poses, stamped

Point = tuple[float, float]
SECOND = 1_000_000_000
FAR = {"ego": "/ego", "obstacles": "/cars", "minCoverage": 0}


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
    assert found(entries, minDistance=10).message == "10 m at 1.000 s"


@pytest.mark.parametrize(("age", "distances"), [("1s", [3.0, 2.0]), ("999ms", [3.0])])
def test_a_scene_counts_while_the_ego_s_pose_is_at_most_so_old(
    age: str, distances: list[float]
) -> None:
    wanted = Separation.model_validate(FAR | {"minDistance": 1, "maxAge": age})
    entries = [ego(12), cars(12, (3, 0)), cars(13, (2, 0)), cars(13.5, (1, 0))]
    assert [metres for _, metres in closest(wanted, evidence(entries))] == distances


def test_the_pose_is_the_last_one_that_was_known_at_the_scene() -> None:
    entries = [ego(11, 1), ego(12, 2), ego(13, 3), cars(12, (10, 0)), cars(12.9, (10, 0))]
    assert found(entries, minDistance=1).figure == 8.0
    # The first scene may come a little before the first pose.
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


def test_where_no_inputs_came_no_scene_is_missed() -> None:
    entries = [each for at in (10, 11, 12) for each in (ego(at), cars(at, (9, 9)))]
    for last, share in ((12.5, 1.0), (14.0, 0.75)):
        inputs = [round((10 + n / 10) * SECOND) for n in range(round((last - 10) * 10) + 1)]
        assert found(entries, inputs, minDistance=1, minCoverage=0.3).coverage == 0.3
        wanted = {"minDistance": 1, "minCoverage": 0.31}
        assert found(entries, inputs, **wanted).coverage == share


def test_stamps_of_another_clock_leave_the_times_of_receipt() -> None:
    entries = [ego(12), ego(13, 1), ("/cars", 13.5, poses(900, (3, 0)))]
    finding = found(entries, minDistance=1, maxAge="600ms")
    assert (finding.figure, finding.clock) == (2.0, "receipt")


def test_cars_may_be_poses_with_headers_of_their_own() -> None:
    path = STORE.types["nav_msgs/msg/Path"](header(11), [stamped(11, 3, 4), stamped(11, 6, 8)])
    assert found([ego(11), ("/cars", 11, path)], minDistance=1).figure == 5.0


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
