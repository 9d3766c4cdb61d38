"""The example's filter on motions whose truth is known, and what it believes about itself."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

EXAMPLE = Path(__file__).parents[3] / "docs/examples/localisation"
sys.path.insert(0, str(EXAMPLE))

import ekf  # type: ignore[import-not-found]  # noqa: E402


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 1.7, math.pi - 1e-6])
def test_rotations_and_their_vectors_are_each_others_inverse(angle: float) -> None:
    for axis in np.vstack([np.eye(3), -np.eye(3), [[0.6, -0.48, 0.64]]]):
        matrix = ekf.rotation(axis * angle)
        assert np.allclose(ekf.rotation_vector(matrix), axis * angle, atol=1e-9)
        assert np.allclose(ekf.matrix_of(*ekf.quaternion(matrix)), matrix, atol=1e-12)


def drive(noise: ekf.Noise, slip: float = 0.0) -> ekf.Filter:
    """Twice around a circle of 2 m radius in 20 s, at 50 Hz; wheels turn too fast by `slip`."""
    robot, turn, speed = ekf.Filter(noise), math.tau / 10, 2 * math.tau / 10
    for step in range(1001):
        time = step / 50
        robot.advance(time)
        robot.see_imu(ekf.rotation(np.array([0.0, 0.0, turn * time])), np.array([0.0, 0.0, turn]))
        robot.see_wheels(speed, turn * (1 + slip))
    return robot


def test_a_circle_ends_where_it_began() -> None:
    robot = drive(ekf.Noise())
    assert np.linalg.norm(robot.position) < 0.02
    assert np.linalg.norm(robot.velocity - [2 * math.tau / 10, 0, 0]) < 1e-3
    # It grows with the way, in x and y alike, and stays a covariance.
    assert 0.001 < math.sqrt(robot.covariance[0, 0]) < 0.1
    assert np.linalg.eigvalsh(robot.covariance).min() > -1e-12


def test_slipping_wheels_matter_only_to_a_filter_that_believes_them() -> None:
    assert np.linalg.norm(drive(ekf.Noise(), slip=0.2).position) < 0.03
    trusting = ekf.Noise(imu_attitude=0.5, imu_rate=0.5, wheel_rate=0.005)
    assert np.linalg.norm(drive(trusting, slip=0.2).position) > 0.15


def test_time_never_runs_backwards() -> None:
    robot = ekf.Filter(ekf.Noise())
    robot.advance(1.0)
    robot.see_wheels(1.0, 0.0)
    robot.advance(2.0)
    there = robot.position.copy()
    robot.advance(1.5)
    assert np.array_equal(robot.position, there)
    assert there[0] == pytest.approx(1.0, abs=0.01)
