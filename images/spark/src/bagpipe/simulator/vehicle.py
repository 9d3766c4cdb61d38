"""The ego car: CommonRoad's vehicle models, driven by a wish for speed and yaw rate.

The models, their three parameter sets (1: Ford Escort, 2: BMW 320i, 3: VW Vanagon) and their
limits of acceleration, braking, steering angle and steering rate are those of M. Althoff and
G. Wuersching, "CommonRoad: Vehicle Models" (2020), by the library `commonroad-vehicle-models`.
Integrated with the classical Runge-Kutta method of fourth order at a fixed step.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

from bagpipe.simulator.scenario import Ego

# The longest step of the integration, in seconds; its error is far below a millimetre.
SUBSTEP = 0.01
# How fast the driver's foot and hands follow a wish, in seconds: first-order lags.
_SPEED_LAG = 0.3
_STEERING_LAG = 0.1
# Below this speed a yaw rate is turned into a steering angle as if at it: the wheels of a car
# that stands need not turn to their stop.
_LEAST_SPEED = 1.0

State = list[float]
Dynamics = Callable[[State, list[float], Any], State]


@cache
def parameters(vehicle: int) -> Any:
    """The library's parameters of a vehicle, read once."""
    # Here and below: a job of recordings has no car, and loading the library takes a while.
    from vehiclemodels.vehicle_parameters import setup_vehicle_parameters  # noqa: PLC0415

    return setup_vehicle_parameters(vehicle_id=vehicle)


def dynamics(*, kinematic: bool) -> Dynamics:
    """The library's model: how the state changes, with or without wheels that slip."""
    if kinematic:
        from vehiclemodels.vehicle_dynamics_ks import vehicle_dynamics_ks  # noqa: PLC0415

        return vehicle_dynamics_ks  # type: ignore[no-any-return]
    from vehiclemodels.vehicle_dynamics_st import vehicle_dynamics_st  # noqa: PLC0415

    return vehicle_dynamics_st  # type: ignore[no-any-return]


@dataclass(frozen=True)
class Wish:
    """What the stack asks of the car: speed in m/s and yaw rate in rad/s."""

    speed: float
    yaw_rate: float


@dataclass(frozen=True)
class Pose:
    """The middle of the car's body, its heading, and how it moves in its own frame."""

    x: float
    y: float
    heading: float
    speed: float
    lateral_speed: float
    yaw_rate: float


class Vehicle:
    """One car. `state` is the library's own: x, y, steering angle, speed, yaw[, rate, slip]."""

    def __init__(self, ego: Ego, y: float) -> None:
        self.parameters = parameters(ego.vehicle)
        self.wheelbase: float = self.parameters.a + self.parameters.b
        self.kinematic = ego.model == "kinematic"
        # The models' reference points: the rear axle, and the centre of mass.
        self._to_middle: float = (
            self.wheelbase / 2 if self.kinematic else (self.parameters.a - self.parameters.b) / 2
        )
        x = ego.x - self._to_middle * math.cos(ego.heading)
        y -= self._to_middle * math.sin(ego.heading)
        self.state: State = [x, y, 0.0, ego.speed, ego.heading]
        if not self.kinematic:
            self.state += [0.0, 0.0]
        self._dynamics = dynamics(kinematic=self.kinematic)

    @property
    def length(self) -> float:
        """Metres."""
        return float(self.parameters.l)

    @property
    def width(self) -> float:
        """Metres."""
        return float(self.parameters.w)

    @property
    def pose(self) -> Pose:
        """Where it is now."""
        x, y, steering, speed, heading = self.state[:5]
        to_middle = self._to_middle
        if self.kinematic:
            yaw_rate = speed / self.wheelbase * math.tan(steering)
            ahead, aside = speed, 0.0
        else:
            yaw_rate = self.state[5]
            ahead = speed * math.cos(self.state[6])
            aside = speed * math.sin(self.state[6])
        return Pose(
            x + to_middle * math.cos(heading),
            y + to_middle * math.sin(heading),
            math.remainder(heading, math.tau),
            ahead,
            aside + to_middle * yaw_rate,
            yaw_rate,
        )

    def inputs(self, wish: Wish) -> list[float]:
        """Steering rate and acceleration towards a wish; the model bounds both by the car's."""
        steering, speed = self.state[2], self.state[3]
        turning = max(abs(speed), _LEAST_SPEED)
        angle = math.atan(self.wheelbase * wish.yaw_rate / turning)
        return [(angle - steering) / _STEERING_LAG, (wish.speed - speed) / _SPEED_LAG]

    def advance(self, wish: Wish, seconds: float) -> None:
        """Move on by `seconds`, at most SUBSTEP; the inputs follow the state at its start."""
        inputs = self.inputs(wish)
        self.state = runge_kutta(self._dynamics, self.state, inputs, self.parameters, seconds)


def runge_kutta(
    dynamics: Dynamics, state: State, inputs: list[float], known: Any, step: float
) -> State:
    """The state one step later, by the classical method of fourth order."""
    first = dynamics(state, inputs, known)
    second = dynamics(_ahead(state, first, step / 2), inputs, known)
    third = dynamics(_ahead(state, second, step / 2), inputs, known)
    fourth = dynamics(_ahead(state, third, step), inputs, known)
    return [
        at + step / 6 * (a + 2 * b + 2 * c + d)
        for at, a, b, c, d in zip(state, first, second, third, fourth, strict=True)
    ]


def _ahead(state: State, slope: State, step: float) -> State:
    return [at + step * by for at, by in zip(state, slope, strict=True)]
