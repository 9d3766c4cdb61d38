"""A traffic simulator in place of ROS: one scenario in, its trajectory and a verdict out.

The case's only file is a scenario: a barrier car starts beside, before or behind the car under
test and drives straight on or changes lanes. highway-env drives the car under test (IDM for its
speed, MOBIL for its lane) and moves both. The case fails when the car under test crashes.
"""

import csv
import io
import json
import math
import sys
from typing import Any

import numpy as np
from frames import Answer, read_files
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.controller import ControlledVehicle

STEPS_PER_SECOND = 15
LANES = 3
START_METRES = 100.0
# Where the barrier car starts, seen from the car under test: metres ahead, lanes to the right.
DIRECTIONS = {
    "front": (1, 0),
    "front-right": (1, 1),
    "right": (0, 1),
    "rear-right": (-1, 1),
    "rear": (-1, 0),
    "rear-left": (-1, -1),
    "left": (0, -1),
    "front-left": (1, -1),
}
SPEED_FACTORS = {"slower": 0.8, "equal": 1.0, "faster": 1.2}
MOTIONS = {"straight": None, "left": "LANE_LEFT", "right": "LANE_RIGHT"}


class BarrierCar(ControlledVehicle):
    """Drives as its scenario says, whatever is in its way."""


def cars(scenario: dict[str, Any]) -> tuple[Road, IDMVehicle, BarrierCar]:
    """The road with both cars at their start."""
    network = RoadNetwork.straight_road_network(LANES, length=2000, speed_limit=30)
    road = Road(network, np_random=np.random.RandomState(0), record_history=False)
    speed = float(scenario["speed"])
    ahead, right = DIRECTIONS[scenario["barrier"]["start"]]
    gap = ahead * float(scenario["barrier"].get("gap", 20.0))
    middle = ("0", "1", 1)
    beside = ("0", "1", 1 + right)
    tested = IDMVehicle.make_on_lane(road, middle, START_METRES, speed)
    tested.target_speed = speed
    barrier_speed = speed * SPEED_FACTORS[scenario["barrier"]["speed"]]
    barrier = BarrierCar.make_on_lane(road, beside, START_METRES + gap, barrier_speed)
    barrier.target_speed = barrier_speed
    road.vehicles = [tested, barrier]
    return road, tested, barrier


def simulate(scenario: dict[str, Any]) -> tuple[list[list[Any]], dict[str, Any]]:
    """The rows of the trajectory, one for each step, and the figures of the whole."""
    road, tested, barrier = cars(scenario)
    motion_at = round(float(scenario["barrier"].get("after", 1.0)) * STEPS_PER_SECOND)
    motion = MOTIONS[scenario["barrier"]["motion"]]
    rows: list[list[Any]] = []
    closest, braking, lanes = math.inf, 0.0, {tested.lane_index[2]}
    for step in range(round(float(scenario["seconds"]) * STEPS_PER_SECOND)):
        road.act()
        if motion and step == motion_at:
            barrier.act(motion)
        road.step(1 / STEPS_PER_SECOND)
        between = float(np.linalg.norm(tested.position - barrier.position))
        closest = min(closest, between)
        braking = max(braking, -float(tested.action["acceleration"]))
        lanes.add(tested.lane_index[2])
        rows.append(
            [
                round((step + 1) / STEPS_PER_SECOND, 4),
                *(round(float(value), 4) for value in (*tested.position, tested.speed)),
                *(round(float(value), 4) for value in (*barrier.position, barrier.speed)),
            ]
        )
        if tested.crashed:
            break
    return rows, {
        "steps": len(rows),
        "crashed": bool(tested.crashed),
        "closest_metres": round(closest, 3),
        "hardest_braking": round(braking, 3),
        "end_speed": round(float(tested.speed), 3),
        "lanes": len(lanes),
    }


def trajectory(rows: list[list[Any]]) -> bytes:
    """The rows as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["seconds", "x", "y", "speed", "barrier_x", "barrier_y", "barrier_speed"])
    writer.writerows(rows)
    return text.getvalue().encode()


def main() -> int:
    """One case: stdin to stdout; all messages go to stderr."""
    # A library that prints must not print between the frames.
    stream, sys.stdout = sys.stdout.buffer, sys.stderr
    (scenario,) = [json.loads(data) for _, data in read_files(sys.stdin.buffer)]
    rows, figures = simulate(scenario)
    print(f"{scenario['barrier']}: {figures}", file=sys.stderr)
    answer = Answer(stream)
    answer.file("trajectory.csv", trajectory(rows))
    if figures["crashed"]:
        seconds = figures["steps"] / STEPS_PER_SECOND
        message = f"the car under test crashed after {seconds:.1f} s"
        answer.end({
            "outcome": "failed", "reason": "Collision", "message": message, "figures": figures,
        })  # fmt: skip
    else:
        answer.end({"outcome": "passed", "figures": figures})
    return 0


if __name__ == "__main__":
    sys.exit(main())
