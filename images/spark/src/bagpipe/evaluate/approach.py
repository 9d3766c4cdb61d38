"""How near the ego came to obstacles between two of their messages, and behind the last one."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from bagpipe.evaluate.way import Part, Point, Way, between

# Time in ns, and where the obstacles are then, each at its place in the list.
Scene = tuple[int, list[Point]]
# Time in ns, the ego, and the obstacle that is nearest then.
Near = tuple[int, Point, Point]

# Metres between two messages: who has moved by more is not looked for in between.
STANDS = 0.5
# Metres per second: what is further away in the next message is another obstacle.
_FASTEST = 70.0


@dataclass(frozen=True)
class Approaches:
    """The nearest obstacle on each straight part of the ego's way.

    `seen` are those that stand, or nearly do; `feared` are those of which it is not known where
    they went, at the speed that they had or, without one, where they were last.
    """

    seen: list[Near]
    feared: list[Near]


@dataclass(frozen=True)
class _Moving:
    """Places of obstacles at one time in metres, and their speeds in metres per second."""

    places: Any
    speeds: Any

    def of(self, which: Any) -> "_Moving":
        """Some of them."""
        return _Moving(self.places[which], self.speeds[which])


def approaches(ego: Way, scenes: Sequence[Scene], age: int, end: int) -> Approaches:
    """Between each scene and the next, or the window's end, for at most `age` ns. Places are
    finite, and scenes ascend by their time.
    """
    found = Approaches([], [])
    for number, (begin, _) in enumerate(scenes):
        until = min(scenes[number + 1][0] if number + 1 < len(scenes) else end, begin + age)
        parts = list(ego.parts(begin, until)) if until > begin else []
        if parts:
            standing, gone = _behind(scenes, number, (until - begin) / 1e9)
            for part in parts:
                found.seen.extend(_nearest(begin, part, standing))
                found.feared.extend(_nearest(begin, part, gone))
    return found


def _behind(scenes: Sequence[Scene], number: int, seconds: float) -> tuple[_Moving, _Moving]:
    """Of the obstacles of a scene those that stand so long behind it, and those that are gone."""
    begin, points = scenes[number]
    old = _array(points)
    speeds = np.zeros_like(old)
    stays, gone = np.zeros(len(old), bool), np.ones(len(old), bool)
    if number + 1 < len(scenes):
        after, new = scenes[number + 1]
        span = (after - begin) / 1e9
        stays, gone, moved = _kept(old, _array(new), _FASTEST * span)
        speeds[stays] = moved / span
    if number and gone.any() and begin > scenes[number - 1][0]:
        before = _array(scenes[number - 1][1])
        speeds[gone], known = _speeds(
            np.flatnonzero(gone), old, before, begin - scenes[number - 1][0]
        )
        slow = np.hypot(speeds[:, 0], speeds[:, 1]) * seconds <= STANDS
        stood = np.zeros(len(old), bool)
        stood[gone] = known
        stays, gone = stays | (stood & slow), gone & ~(stood & slow)
    everything = _Moving(old, speeds)
    return everything.of(stays), everything.of(gone)


def _kept(old: Any, new: Any, reach: float) -> tuple[Any, Any, Any]:
    """Which obstacles stand until the next scene and which are gone by then, and how far the
    former have moved. Others may be one that has moved on.
    """
    stays, gone = np.zeros(len(old), bool), np.ones(len(old), bool)
    if not (len(old) and len(new)):
        return stays, gone, old[stays]
    apart, which = KDTree(new).query(old, distance_upper_bound=STANDS)
    stays = apart <= STANDS
    moved = new[which[stays]] - old[stays]
    others = np.flatnonzero(~stays)
    free = np.delete(new, which[stays], axis=0)
    if len(others) and len(free):
        apart, which = KDTree(old[others]).query(free, distance_upper_bound=reach)
        taken = which[np.isfinite(apart)]
        # Where there is one for each, who became which is not asked.
        gone[others if len(taken) >= len(others) else others[taken]] = False
    return stays, gone & ~stays, moved


def _speeds(which: Any, points: Any, before: Any, span: int) -> tuple[Any, Any]:
    """Speeds since the scene before, `span` ns earlier, and which of them are those of an obstacle
    that was all but there already. Of others it is taken for the one of the same place in the list,
    and none where that is too far away to be the same.
    """
    speeds, known = np.zeros((len(which), 2)), np.zeros(len(which), bool)
    if not len(before):
        return speeds, known
    apart, nearest = KDTree(before).query(points[which], distance_upper_bound=STANDS)
    known = apart <= STANDS
    same = np.where(known, nearest, which)
    there = same < len(before)
    speeds[there] = (points[which[there]] - before[same[there]]) / (span / 1e9)
    speeds[np.hypot(speeds[:, 0], speeds[:, 1]) > _FASTEST] = 0.0
    return speeds, known


def _nearest(begin: int, part: Part, obstacles: _Moving) -> Iterator[Near]:
    """Of obstacles at the time `begin` the one that the ego comes nearest to on a straight part of
    its way, and when.
    """
    places, speeds = obstacles.places, obstacles.speeds
    if not len(places):
        return
    (start, old), (end, new) = part
    with np.errstate(all="ignore"):  # what overflows is far away
        first = places + speeds * ((start - begin) / 1e9) - np.array(old)
        way = speeds * ((end - start) / 1e9) - (np.array(new) - np.array(old))
        share = -(first * way).sum(axis=1) / (way * way).sum(axis=1)
        share = np.clip(np.nan_to_num(share, nan=0.0), 0.0, 1.0)
        there = first + way * share[:, None]
        apart = np.nan_to_num(np.hypot(there[:, 0], there[:, 1]), nan=np.inf)
    at = int(apart.argmin())
    time = start + round(float(share[at]) * (end - start))
    x, y = places[at] + speeds[at] * ((time - begin) / 1e9)
    yield time, between(old, new, float(share[at])), (float(x), float(y))


def _array(points: Sequence[Point]) -> Any:
    return np.array(points, dtype=float).reshape(-1, 2)
