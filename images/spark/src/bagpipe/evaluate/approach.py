"""How near the ego came to obstacles between two of their messages, and behind the last one."""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bagpipe.evaluate.tracks import Kind, Scene, stretches
from bagpipe.evaluate.way import Part, Point, Way, between

# Time in ns, the ego, and the obstacle that is nearest then.
Near = tuple[int, Point, Point]

# Of parts times obstacles that are looked at in one go: it bounds the memory.
_AT_ONCE = 1 << 16


@dataclass(frozen=True)
class Unknown:
    """A stretch of time in ns for which it is not known where an obstacle went, and how near the
    ego came meanwhile to where it was last, in metres.
    """

    begin: int
    until: int
    metres: float


@dataclass(frozen=True)
class Approaches:
    """How near the ego came to obstacles.

    `seen` has the nearest of those that stand, or nearly do, on each straight part of its way;
    `feared` the least distances in metres, each with its time, of those that are not seen any more,
    at the speed that they had. `unknown` is of those that had none.
    """

    seen: list[Near]
    feared: list[tuple[int, float]]
    unknown: list[Unknown]


def approaches(ego: Way, scenes: Sequence[Scene], age: int, end: int) -> Approaches:
    """Between two messages, and for at most `age` ns behind the last one that has an obstacle, up
    to `end`. Places are finite, and scenes ascend by their time.
    """
    alike: dict[tuple[Kind, int, int], list[tuple[Point, Point]]] = defaultdict(list)
    for each in stretches(scenes, age, end):
        alike[each.kind, each.begin, each.until].append((each.place, each.speed))
    found = Approaches([], [], [])
    for (kind, begin, until), obstacles in alike.items():
        parts = list(ego.parts(begin, until)) if until > begin else []
        near = _nearest(begin, parts, obstacles)
        if kind == "seen":
            found.seen.extend(near)
        elif near:
            metres, time = min((math.dist(one, other), time) for time, one, other in near)
            if kind == "feared":
                found.feared.append((time, metres))
            else:
                found.unknown.append(Unknown(begin, until, metres))
    return found


def _nearest(
    begin: int, parts: Sequence[Part], obstacles: Sequence[tuple[Point, Point]]
) -> list[Near]:
    """Of obstacles at the time `begin`, with their speeds, the one that the ego comes nearest to
    on each straight part of its way, and when.
    """
    step = max(1, _AT_ONCE // len(obstacles))
    moving = np.array(obstacles, dtype=float)
    found = []
    for first in range(0, len(parts), step):
        some = parts[first : first + step]
        shares, at = _closest(begin, some, moving[:, 0], moving[:, 1])
        for ((start, old), (stop, new)), share, number in zip(some, shares, at, strict=True):
            time = start + round(float(share) * (stop - start))
            (x, y), (by_x, by_y) = obstacles[number]
            seconds = (time - begin) / 1e9
            place = (x + by_x * seconds, y + by_y * seconds)
            found.append((time, between(old, new, float(share)), place))
    return found


def _closest(begin: int, parts: Sequence[Part], places: Any, speeds: Any) -> tuple[Any, Any]:
    """For each part which obstacle is the nearest, and on which share of the part."""
    since = np.array([[start - begin, end - begin] for (start, _), (end, _) in parts]) / 1e9
    ego = np.array([[old, new] for (_, old), (_, new) in parts], dtype=float)
    with np.errstate(all="ignore"):  # what overflows is far away
        first = places + speeds * since[:, :1, None] - ego[:, :1]
        length = (since[:, 1] - since[:, 0])[:, None, None]
        way = speeds * length - (ego[:, 1] - ego[:, 0])[:, None]
        share = -(first * way).sum(axis=2) / (way * way).sum(axis=2)
        share = np.clip(np.nan_to_num(share, nan=0.0), 0.0, 1.0)
        there = first + way * share[..., None]
        apart = np.nan_to_num(np.hypot(there[..., 0], there[..., 1]), nan=np.inf)
    at = apart.argmin(axis=1)
    return share[np.arange(len(at)), at], at
