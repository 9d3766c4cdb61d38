"""An extended Kalman filter over wheel odometry and an inertial unit, in three dimensions.

The state is the position in the frame in which the robot started, its attitude (a rotation
matrix, body to that frame), its velocity and its angular rate (both in the body's frame).
Velocity and rate are random walks; what the sensors say of them, and of the attitude, corrects
them. Errors of the attitude are small rotations in the body's frame, so nothing is singular at
any attitude. Nothing here knows of ROS.
"""

from dataclasses import dataclass

import numpy as np

# Where each part stands in the error state.
POSITION, ATTITUDE, VELOCITY, RATE = (slice(start, start + 3) for start in (0, 3, 6, 9))


@dataclass(frozen=True)
class Noise:
    """Standard deviations: how little each measurement is believed, how fast the robot changes."""

    imu_attitude: float = 0.005  # rad
    imu_rate: float = 0.005  # rad/s
    wheel_velocity: float = 0.03  # m/s
    wheel_rate: float = 0.2  # rad/s: the wheels of a skid-steered robot slip when it turns
    acceleration: float = 1.0  # m/s per square root of a second
    angular_acceleration: float = 1.0  # rad/s per square root of a second


class Filter:
    """Begins at the origin; the attitude is the first one that is measured."""

    def __init__(self, noise: Noise) -> None:
        self.noise = noise
        self.position = np.zeros(3)
        self.attitude = np.eye(3)
        self.velocity = np.zeros(3)
        self.rate = np.zeros(3)
        self.covariance = np.diag([1e-9] * 3 + [np.pi**2] * 3 + [1.0] * 6)
        self._time: float | None = None

    def advance(self, time: float) -> None:
        """Move on to a time in seconds; an earlier one than before changes nothing."""
        step = 0.0 if self._time is None else time - self._time
        if self._time is None or step > 0:
            self._time = time
        if step <= 0:
            return
        turn = rotation(self.rate * step)
        change = np.eye(12)
        change[POSITION, ATTITUDE] = -self.attitude @ crossing(self.velocity) * step
        change[POSITION, VELOCITY] = self.attitude * step
        change[ATTITUDE, ATTITUDE] = turn.T
        change[ATTITUDE, RATE] = np.eye(3) * step
        self.position = self.position + self.attitude @ self.velocity * step
        self.attitude = self.attitude @ turn
        walk = np.zeros(12)
        walk[VELOCITY] = self.noise.acceleration**2
        walk[RATE] = self.noise.angular_acceleration**2
        self.covariance = change @ self.covariance @ change.T + np.diag(walk * step)

    def see_imu(self, attitude: np.ndarray, rate: np.ndarray) -> None:
        """An attitude (rotation matrix) and an angular rate in rad/s, as measured."""
        off = rotation_vector(self.attitude.T @ attitude)
        self._correct(list(range(3, 6)), off, self.noise.imu_attitude)
        self._correct(list(range(9, 12)), rate - self.rate, self.noise.imu_rate)

    def see_wheels(self, forward: float, turn: float) -> None:
        """Speed in m/s and turning rate in rad/s. Wheels move neither sideways nor up."""
        velocity = np.array([forward, 0.0, 0.0])
        self._correct(list(range(6, 9)), velocity - self.velocity, self.noise.wheel_velocity)
        self._correct([11], np.array([turn - self.rate[2]]), self.noise.wheel_rate)

    def _correct(self, states: list[int], off: np.ndarray, sigma: float) -> None:
        """Measured states directly: `off` is what was measured less what was expected."""
        expected = self.covariance[np.ix_(states, states)] + np.eye(len(states)) * sigma**2
        gain = np.linalg.solve(expected, self.covariance[states, :]).T
        error = gain @ off
        self.covariance = self.covariance - gain @ self.covariance[states, :]
        self.position = self.position + error[POSITION]
        self.attitude = self.attitude @ rotation(error[ATTITUDE])
        self.velocity = self.velocity + error[VELOCITY]
        self.rate = self.rate + error[RATE]


def crossing(v: np.ndarray) -> np.ndarray:
    """The matrix that multiplies as the cross product with `v` does."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rotation(v: np.ndarray) -> np.ndarray:
    """The rotation about `v` by its length (Rodrigues)."""
    angle = float(np.linalg.norm(v))
    if angle < 1e-12:
        return np.eye(3) + crossing(v)
    axis = crossing(v / angle)
    return np.eye(3) + np.sin(angle) * axis + (1 - np.cos(angle)) * axis @ axis


def rotation_vector(matrix: np.ndarray) -> np.ndarray:
    """The inverse of `rotation`, through the quaternion: right at half a turn as well."""
    x, y, z, w = quaternion(matrix)
    length = float(np.linalg.norm([x, y, z]))
    if length < 1e-12:
        return np.array([2 * x, 2 * y, 2 * z])
    return np.array([x, y, z]) / length * 2 * np.arctan2(length, w)


def quaternion(matrix: np.ndarray) -> tuple[float, float, float, float]:
    """x, y, z, w of a rotation matrix, with w not negative."""
    # Four times each component's square, of which the largest is the safe one to divide by.
    trace = np.trace(matrix)
    squares = np.array([1 + 2 * matrix[n, n] - trace for n in range(3)] + [1 + trace])
    largest = int(np.argmax(squares))
    found = np.zeros(4)
    if largest == 3:
        found[:3] = [matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0],
                     matrix[1, 0] - matrix[0, 1]]  # fmt: skip
        found[3] = squares[3]
    else:
        one, two = (largest + 1) % 3, (largest + 2) % 3
        found[largest] = squares[largest]
        found[one] = matrix[one, largest] + matrix[largest, one]
        found[two] = matrix[two, largest] + matrix[largest, two]
        found[3] = matrix[two, one] - matrix[one, two]
    found /= np.copysign(np.linalg.norm(found), found[3])
    return float(found[0]), float(found[1]), float(found[2]), float(found[3])


def matrix_of(x: float, y: float, z: float, w: float) -> np.ndarray:
    """The rotation matrix of a quaternion, which need not be of length one."""
    x, y, z, w = np.array([x, y, z, w]) / np.linalg.norm([x, y, z, w])
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
