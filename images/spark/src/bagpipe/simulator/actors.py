"""The others on the road: where each is at a time, by its script alone, in closed form."""

import math
from bisect import bisect_right
from dataclasses import dataclass

from bagpipe.simulator.scenario import DIRECTIONS, RELATIVE_SPEEDS, SIZES, Actor, Ego, Scene


@dataclass(frozen=True)
class Body:
    """A rectangle on the ground: its middle, heading in radians, length and width in metres."""

    x: float
    y: float
    heading: float
    length: float
    width: float


class Course:
    """One actor's way. Speed changes evenly; a lane change is a half wave of a cosine."""

    def __init__(self, actor: Actor, ego: Ego, scene: Scene) -> None:
        self.length, self.width = SIZES[actor.kind]
        start = actor.start
        if start.direction is not None:
            ahead, left = DIRECTIONS[start.direction]
            x, lane = ego.x + ahead * start.distance, ego.lane + left
        else:
            x, lane = float(start.x or 0.0), int(start.lane or 0)
        self._start = (x, lane * scene.lane_width)
        self._heading = start.heading
        speed = actor.speed
        if isinstance(speed, str):
            speed = RELATIVE_SPEEDS[speed] * ego.speed
        self._pieces = _pieces(float(speed), actor)
        self._times = [piece[0] for piece in self._pieces]
        width = scene.lane_width
        self._changes = [(a.at, a.over, a.lanes * width) for a in actor.actions if a.lanes]

    def at(self, seconds: float) -> Body:
        """Where it is, `seconds` after the start."""
        begun, way, speed, gain = self._pieces[bisect_right(self._times, seconds) - 1]
        passed = seconds - begun
        ahead = way + speed * passed + gain * passed * passed / 2
        pace = speed + gain * passed
        aside = drift = 0.0
        for at, over, width in self._changes:
            part = min(max((seconds - at) / over, 0.0), 1.0)
            aside += width * (1 - math.cos(math.pi * part)) / 2
            if 0 < part < 1:
                drift += width * math.pi / (2 * over) * math.sin(math.pi * part)
        cos, sin = math.cos(self._heading), math.sin(self._heading)
        turned = math.atan2(drift, pace) if pace or drift else 0.0
        x, y = self._start
        return Body(
            x + ahead * cos - aside * sin,
            y + ahead * sin + aside * cos,
            math.remainder(self._heading + turned, math.tau),
            self.length,
            self.width,
        )


def _pieces(speed: float, actor: Actor) -> list[tuple[float, float, float, float]]:
    """(begin, way so far, speed, acceleration) of each stretch of even acceleration."""
    pieces = [(0.0, 0.0, speed, 0.0)]
    for action in actor.actions:
        if action.speed is None:
            continue
        begun, way, pace, gain = pieces[-1]
        at = max(action.at, begun)
        passed = at - begun
        way += pace * passed + gain * passed * passed / 2
        pace += gain * passed
        gain = (action.speed - pace) / action.over
        pieces.append((at, way, pace, gain))
        end = at + action.over
        way += pace * action.over + gain * action.over**2 / 2
        pieces.append((end, way, action.speed, 0.0))
    return pieces
