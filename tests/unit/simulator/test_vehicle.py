"""The ego car's model: a circle, a braking way, and the library's own worked example."""

import math

import pytest
from vehiclemodels.vehicle_dynamics_ks import vehicle_dynamics_ks
from vehiclemodels.vehicle_dynamics_st import vehicle_dynamics_st

from bagpipe.simulator.scenario import Ego
from bagpipe.simulator.vehicle import SUBSTEP, Vehicle, Wish, parameters, runge_kutta

GRAVITY = 9.81


def drive(vehicle: Vehicle, wish: Wish, seconds: float) -> None:
    for _ in range(round(seconds / SUBSTEP)):
        vehicle.advance(wish, SUBSTEP)


def test_a_constant_yaw_rate_is_a_circle_of_the_speed_over_it() -> None:
    vehicle = Vehicle(Ego(speed=10), 0.0)
    wish = Wish(10.0, 0.5)
    drive(vehicle, wish, 3.0)
    begun = vehicle.pose
    assert begun.yaw_rate == pytest.approx(0.5, abs=1e-6)
    # The rear axle is what the kinematic model turns about the circle's middle.
    radius = 10.0 / 0.5
    x, y, _, _, yaw = vehicle.state
    middle = x - radius * math.sin(yaw), y + radius * math.cos(yaw)
    around = 2 * math.pi / 0.5
    for _ in range(4):
        drive(vehicle, wish, around / 4)
        away = math.dist(vehicle.state[:2], middle)
        assert away == pytest.approx(radius, abs=1e-4)
    assert vehicle.pose.heading == pytest.approx(begun.heading, abs=0.01)


def test_braking_is_bounded_by_the_car_and_takes_v_squared_over_2a() -> None:
    vehicle = Vehicle(Ego(speed=20), 0.0)
    strongest = parameters(2).longitudinal.a_max
    assert strongest == 11.5
    drive(vehicle, Wish(-100.0, 0.0), 1.5)
    speed = vehicle.state[3]
    assert speed == pytest.approx(20 - strongest * 1.5, abs=1e-9)
    way = vehicle.pose.x
    assert way == pytest.approx((20**2 - speed**2) / (2 * strongest), abs=1e-9)


def test_the_steering_angle_and_its_rate_are_bounded_by_the_car() -> None:
    vehicle = Vehicle(Ego(speed=5), 0.0)
    limits = parameters(2).steering
    before = 0.0
    for _ in range(500):
        vehicle.advance(Wish(5.0, 50.0), SUBSTEP)
        angle = vehicle.state[2]
        assert angle - before <= limits.v_max * SUBSTEP + 1e-12
        assert angle <= limits.max + limits.v_max * SUBSTEP
        before = angle
    assert before == pytest.approx(limits.max, abs=limits.v_max * SUBSTEP)


# The derivative that the library's own tests assert for these states, inputs and vehicle 2
# (test_derivatives.py of commonroad-vehicle-models).
STATE_KS = [3.9579422297936526, 0.0391650102771405, 0.0378491427211811, 16.3546957860883566,
            0.0294717351052816]  # fmt: skip
STATE_ST = [2.0233348142065677, 0.0041907137716636, 0.0197545248559617, 15.7216236334290116,
            0.0025857914776859, 0.0529001056654038, 0.0033012170610298]  # fmt: skip
INPUTS = [0.15, 0.63 * GRAVITY]
DERIVATIVE_KS = [16.3475935934250209, 0.4819314886013121, 0.1500000000000000, 5.1464424102339752,
                 0.2401426578627629]  # fmt: skip
DERIVATIVE_ST = [15.7213512030862397, 0.0925527979719355, 0.1500000000000000, 5.3536773276413925,
                 0.0529001056654038, 0.6435589397748606, 0.0313297971641291]  # fmt: skip


def test_the_models_are_the_published_ones() -> None:
    known = parameters(2)
    assert vehicle_dynamics_ks(STATE_KS, INPUTS, known) == pytest.approx(DERIVATIVE_KS, abs=1e-10)
    assert vehicle_dynamics_st(STATE_ST, INPUTS, known) == pytest.approx(DERIVATIVE_ST, abs=1e-10)


def test_the_integration_is_of_fourth_order() -> None:
    def error(step: float) -> float:
        state = [1.0]
        for _ in range(round(1 / step)):
            state = runge_kutta(lambda at, _, __: [at[0]], state, [], None, step)
        return abs(state[0] - math.e)

    assert error(0.1) / error(0.05) == pytest.approx(16, rel=0.1)


def test_ten_times_finer_steps_change_no_hundredth_of_a_millimetre_of_a_slalom() -> None:
    def end(model: str, parts: int) -> list[float]:
        vehicle = Vehicle(Ego(model=model, speed=20), 0.0)  # type: ignore[arg-type]
        for number in range(600):
            way = math.copysign(0.2, math.sin(2 * math.pi * number * SUBSTEP / 3))
            inputs = [way, 2 * math.cos(number / 50)]
            for _ in range(parts):
                vehicle.state = runge_kutta(
                    vehicle._dynamics, vehicle.state, inputs, vehicle.parameters, SUBSTEP / parts
                )
        return vehicle.state

    for model in ("kinematic", "singleTrack"):
        assert math.dist(end(model, 1)[:2], end(model, 10)[:2]) < 1e-5, model


def test_the_single_track_car_slips_and_the_kinematic_one_does_not() -> None:
    slipping, kinematic = (
        Vehicle(Ego(model=model, speed=20), 0.0) for model in ("singleTrack", "kinematic")
    )
    for vehicle in (slipping, kinematic):
        drive(vehicle, Wish(20.0, 0.3), 3.0)
    assert slipping.state[6] != 0
    assert abs(slipping.pose.y - kinematic.pose.y) > 0.5
    assert slipping.pose.speed == pytest.approx(20.0, abs=0.3)


def test_the_middle_of_the_car_starts_where_the_scenario_says() -> None:
    for model in ("kinematic", "singleTrack"):
        ego = Ego(model=model, x=3.0, heading=0.5, speed=7)
        pose = Vehicle(ego, 1.75).pose
        assert (pose.x, pose.y) == pytest.approx((3.0, 1.75), abs=1e-12)
        assert (pose.heading, pose.speed, pose.yaw_rate) == (0.5, 7.0, 0.0)
