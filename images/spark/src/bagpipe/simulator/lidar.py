"""A planar laser scanner: rays from the middle of the ego car until they meet a body's side."""

import math
from typing import Any

import numpy as np

from bagpipe.simulator.actors import Body
from bagpipe.simulator.geometry import corners
from bagpipe.simulator.scenario import Lidar
from bagpipe.simulator.vehicle import Pose


class Scanner:
    """Casts the same beams every time; what none meets within the range gives no point."""

    def __init__(self, lidar: Lidar) -> None:
        self._range = lidar.range
        angles = np.arange(lidar.beams) * (math.tau / lidar.beams)
        self._beams = np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def points(self, ego: Pose, bodies: list[Body]) -> bytes:
        """x, y, z as float32 for each beam that meets a body, in the car's own frame."""
        if not bodies:
            return b""
        begins, sides = _sides(ego, bodies)
        # A ray o + t d meets a side p + u s where both t and u solve two linear equations.
        dx, dy = self._beams[:, :1], self._beams[:, 1:]
        sx, sy = sides[:, 0], sides[:, 1]
        px, py = begins[:, 0], begins[:, 1]
        across = dx * sy - dy * sx
        with np.errstate(divide="ignore", invalid="ignore"):
            way = (px * sy - py * sx) / across
            part = (px * dy - py * dx) / across
        met = (np.abs(across) > 1e-12) & (way > 0) & (part >= 0) & (part <= 1)
        nearest = np.where(met, way, np.inf).min(axis=1)
        seen = nearest <= self._range
        points = np.zeros((int(seen.sum()), 3), dtype="<f4")
        points[:, :2] = self._beams[seen] * nearest[seen, None]
        return bytes(points.tobytes())


def _sides(ego: Pose, bodies: list[Body]) -> tuple[Any, Any]:
    """Where each side of each body begins and where it leads, in the car's own frame."""
    outlines = np.array([corners(body) for body in bodies]) - [ego.x, ego.y]
    cos, sin = math.cos(ego.heading), math.sin(ego.heading)
    turned = outlines @ np.array([[cos, -sin], [sin, cos]])
    sides = np.roll(turned, -1, axis=1) - turned
    return turned.reshape(-1, 2), sides.reshape(-1, 2)
