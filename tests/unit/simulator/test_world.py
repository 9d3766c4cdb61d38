"""The world's turns: what is published when, what is obeyed, and when it gives up."""

import struct
from typing import Any

import pytest

from bagpipe.simulator.model import START, Simulator
from bagpipe.simulator.scenario import Scenario
from bagpipe.simulator.serialisation import ROS1
from bagpipe.simulator.world import MOST_UNANSWERED, NeverAnsweredError, Steering, World

ALWAYS = Steering(frozenset({"/ego/odom"}), required=True)
NOTHING: dict[str, Any] = {"messages": []}


def world(steering: Steering = ALWAYS, duration: str = "2s", **described: Any) -> World:
    simulator = Simulator.model_validate({"duration": duration, **described})
    return World(simulator, Scenario.model_validate(simulator.described), steering, ROS1)


def twist(speed: float, yaw_rate: float = 0.0) -> dict[str, Any]:
    data = struct.pack("<6d", speed, 0, 0, 0, 0, yaw_rate)
    return {"messages": [["/cmd", "geometry_msgs/Twist", data]]}


def topics(made: World, step: dict[str, Any] | None) -> list[str]:
    assert step is not None
    return [made.publications[place].topic for place, _ in step["messages"]]


def test_moments_are_a_step_apart_and_end_with_the_drive() -> None:
    made = world(duration="1s", step="250ms")
    times = []
    while (step := made.step(twist(0))) is not None:
        times.append(step["time"])
    assert times == [START + at * 250_000_000 for at in range(4)]
    assert made.step(twist(0)) is None


def test_the_odometry_comes_last_and_the_scene_once() -> None:
    light = {"name": "a", "program": [{"shows": "red", "seconds": 1}]}
    made = world(scene={"lights": [light]}, lidar={"every": 2})
    both = ["/obstacles", "/ego/odom"]
    assert topics(made, made.step(NOTHING)) == [
        "/ego/collision", "/scene", "/lights", "/points", *both,
    ]  # fmt: skip
    assert topics(made, made.step(twist(0))) == ["/ego/collision", "/lights", *both]
    assert topics(made, made.step(twist(0))) == ["/ego/collision", "/lights", "/points", *both]


def test_the_latest_wish_is_obeyed_and_kept_until_the_next() -> None:
    made = world(duration="20s")
    made.step(NOTHING)
    made.step(twist(10))
    for _ in range(15):
        made.step(NOTHING)
    assert made.car.pose.speed == pytest.approx(10, abs=0.2)


def test_whoever_is_met_between_two_moments_has_been_met() -> None:
    # At 50 m/s past a board 10 cm thick, in steps of half a second: 25 m apart.
    board = {"x": 30, "y": 0, "length": 0.1, "width": 1}
    made = world(step="500ms", ego={"speed": 50}, scene={"barriers": [board]})
    made.step(NOTHING)
    assert not made.collided
    made.step(twist(50))
    made.step(twist(50))
    assert made.collided
    assert made.car.pose.x > 40


def test_a_start_inside_an_obstacle_is_a_collision_from_the_first_moment() -> None:
    made = world(scene={"barriers": [{"x": 1, "y": 0}]})
    made.step(NOTHING)
    assert made.collided


def test_a_stack_that_falls_silent_is_given_up_and_one_that_may_is_not() -> None:
    made = world(duration="10s")
    made.step(NOTHING)
    made.step(twist(1))
    for _ in range(MOST_UNANSWERED - 1):
        made.step(NOTHING)
    with pytest.raises(
        NeverAnsweredError, match=r"in 20 steps in a row, up to 2\.1 s of the drive"
    ):
        made.step(NOTHING)
    patient = world(Steering(frozenset(), required=False), duration="10s")
    for _ in range(100):
        assert patient.step(NOTHING) is not None


def test_an_answer_is_only_missed_where_its_trigger_was_published() -> None:
    rare = world(Steering(frozenset({"/points"}), required=True), "10s", lidar={"every": 10})
    for _ in range(100):
        assert rare.step(NOTHING) is not None


def test_the_same_answers_give_the_same_bytes() -> None:
    described: dict[str, Any] = {
        "ego": {"model": "singleTrack", "speed": 15},
        "actors": [{"start": {"direction": "front"}, "speed": "slower", "motion": "left"}],
        "lidar": {},
    }
    runs = []
    for _ in range(2):
        made = world(**described)
        runs.append([made.step(twist(15, 0.01 * number)) for number in range(20)])
    assert runs[0] == runs[1]
