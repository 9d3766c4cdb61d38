"""Actors, shapes, lights, the lidar and the static scene, against figures worked out by hand."""

import math
import struct
from typing import Any

import pytest
from pydantic import ValidationError

from bagpipe.simulator.actors import Body, Course
from bagpipe.simulator.geometry import overlap
from bagpipe.simulator.lidar import Scanner
from bagpipe.simulator.lights import shown
from bagpipe.simulator.scenario import Actor, Barrier, Ego, Lidar, Scenario, Scene
from bagpipe.simulator.vehicle import Pose

EGO = Ego(x=5, lane=1, speed=20)
SCENE = Scene(lanes=3, lane_width=3.5)


def course(**fields: Any) -> Course:
    return Course(Actor.model_validate({"start": {"x": 0, "lane": 0}} | fields), EGO, SCENE)


@pytest.mark.parametrize(
    ("direction", "x", "y"),
    [
        ("front", 25, 3.5), ("front-left", 25, 7), ("left", 5, 7), ("rear-left", -15, 7),
        ("rear", -15, 3.5), ("rear-right", -15, 0), ("right", 5, 0), ("front-right", 25, 0),
    ],
)  # fmt: skip
def test_a_direction_is_beside_the_ego_car_by_lanes(direction: str, x: float, y: float) -> None:
    body = course(start={"direction": direction, "distance": 20}).at(0)
    assert (body.x, body.y) == (x, y)


@pytest.mark.parametrize(("word", "speed"), [("slower", 16), ("equal", 20), ("faster", 24), (3, 3)])
def test_a_speed_is_a_number_or_a_part_of_the_ego_car_s(word: Any, speed: float) -> None:
    assert course(speed=word).at(2.0).x == pytest.approx(2 * speed)


def test_a_lane_change_ends_on_the_other_lane_and_is_half_done_in_its_middle() -> None:
    changing = course(speed=10, motion="left", after=2)
    where = [changing.at(t).y for t in (2, 3.5, 5, 9)]
    assert where == pytest.approx([0, 1.75, 3.5, 3.5])
    # d/dt of the half wave in its middle, over the speed.
    slope = 3.5 * math.pi / (2 * 3) / 10
    assert changing.at(3.5).heading == pytest.approx(math.atan(slope))
    assert course(speed=10, motion="right").at(60).y == -3.5


def test_a_script_changes_the_speed_evenly_and_the_way_is_exact() -> None:
    braking = course(speed=10, script=[{"at": 1, "over": 2, "speed": 0}])
    assert [braking.at(t).x for t in (1, 2, 3, 50)] == pytest.approx([10, 17.5, 20, 20])
    turned = course(start={"x": 0, "lane": 0, "heading": math.pi / 2}, speed=2).at(3)
    assert (turned.x, turned.y) == pytest.approx((0, 6))


def test_rectangles_overlap_by_their_sides_and_not_by_their_circles() -> None:
    def car(x: float, y: float, heading: float = 0.0) -> Body:
        return Body(x, y, heading, 4.5, 1.8)

    assert overlap(car(0, 0), car(4.49, 0))
    assert not overlap(car(0, 0), car(4.51, 0))
    assert overlap(car(0, 0), car(0, 1.79))
    assert not overlap(car(0, 0), car(0, 1.81))
    # Turned by an eighth, a corner lies (4.5 + 1.8) / 2 / sqrt(2) behind and half the sides'
    # difference to the right of its middle: it meets the middle of the other's front.
    reach, aside = 2.25 + 3.15 / math.sqrt(2), 1.35 / math.sqrt(2)
    assert overlap(car(0, 0), car(reach - 0.01, aside, math.pi / 4))
    assert not overlap(car(0, 0), car(reach + 0.01, aside, math.pi / 4))


def test_lights_follow_their_program_again_and_again() -> None:
    program = [{"shows": "green", "seconds": 5}, {"shows": "yellow", "seconds": 1},
               {"shows": "red", "seconds": 4}]  # fmt: skip
    scene = Scene.model_validate({"lights": [{"name": "a", "program": program}]})
    at = [shown(scene, t)[0] for t in (0, 4.999, 5, 5.9, 6, 9.999, 10, 25.5)]
    assert at == [2, 2, 1, 1, 0, 0, 2, 1]


def test_the_lidar_sees_the_nearest_side_in_the_car_s_own_frame() -> None:
    ego = Pose(10.0, 5.0, math.pi / 2, 0, 0, 0)
    ahead = Body(10.0, 15.0, 0.0, 2.0, 2.0)
    behind_it = Body(10.0, 20.0, 0.0, 8.0, 8.0)
    far = Body(-100.0, 5.0, 0.0, 2.0, 2.0)
    data = Scanner(Lidar(beams=8, range=50)).points(ego, [ahead, behind_it, far])
    assert struct.unpack(f"<{len(data) // 4}f", data) == pytest.approx((9.0, 0.0, 0.0), abs=1e-5)
    assert Scanner(Lidar(beams=8, range=8.9)).points(ego, [ahead]) == b""
    assert Scanner(Lidar()).points(ego, []) == b""


def test_a_lidar_sees_a_wall_where_it_is() -> None:
    wall = Body(20.0, 0.0, 0.0, 0.2, 40.0)
    data = Scanner(Lidar(beams=720, range=80)).points(Pose(0, 0, 0, 0, 0, 0), [wall])
    points = list(struct.iter_unpack("<3f", data))
    # Half of the wall's 40 m at 19.9 m is 45.15 degrees, in beams of half a degree.
    assert len(points) == 181
    assert {round(x, 3) for x, _, _ in points} == {19.9}


@pytest.mark.parametrize(
    ("written", "words"),
    [
        ({"ego": {"lane": 3}, "scene": {"lanes": 3}}, "counted from 0 at the right"),
        ({"scene": {"stopLines": [{"x": 5, "light": "a"}]}}, "the scene's lights are none"),
        ({"actors": [{"start": {}}]}, "either a direction, such as front-left, or x and lane"),
        ({"actors": [{"start": {"x": 4}}]}, "needs both x and lane"),
        ({"actors": [{"start": {"direction": "up"}}]}, "front-left"),
        ({"ego": {"wheels": 3}}, "Extra inputs are not permitted"),
        ({"ego": {"speed": float("nan")}}, "less than or equal|greater than or equal"),
        ({"lidar": {"beams": 2}}, "greater than or equal to 8"),
    ],
)
def test_a_scenario_that_makes_no_sense_is_refused(written: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Scenario.model_validate(written)


def test_barriers_are_about_their_middle() -> None:
    scene = Scene(barriers=[Barrier(x=30, y=0, length=2, width=4)])
    (barrier,) = scene.barriers
    assert (barrier.x, barrier.length, barrier.width) == (30, 2, 4)
