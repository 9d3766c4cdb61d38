"""Where the ego is between its poses: on the straight line from one to the next."""

import itertools
import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence

Point = tuple[float, float]
# Two times in ns and where the ego is then.
Part = tuple[tuple[int, Point], tuple[int, Point]]

# Metres per second: what is further away than that is not where it has driven to.
FASTEST = 70.0
# Metres: what moves by less stands, or its place is a little wrong.
STANDS = 0.5


class Way:
    """Poses of an ego, and what follows from them for other times."""

    def __init__(self, poses: Sequence[tuple[int, Point]], age: int) -> None:
        """Poses ascend by their time in ns. Between two of them a place is known if it is never
        more than `age` ns from one of them, and no speed is needed that nothing has: a
        localization that finds itself has not driven there.
        """
        self._poses = list(poses)
        self._times = [time for time, _ in self._poses]
        self._longest = 2 * age

    def at(self, time: int) -> Point | None:
        """Where it is at a pose or between two; None where that is not known."""
        after = bisect_right(self._times, time)
        if after and self._times[after - 1] == time:
            return self._poses[after - 1][1]
        if not 0 < after < len(self._poses):
            return None
        (begin, old), (end, new) = self._poses[after - 1 : after + 1]
        if end - begin > self._longest or not drives((begin, old), (end, new)):
            return None
        return between(old, new, (time - begin) / (end - begin))

    def parts(self, begin: int, end: int) -> Iterator[Part]:
        """The straight parts of the way from one time to a later one, as far as it is known; a
        place without a way is a part of no length.
        """
        first, last = bisect_right(self._times, begin), bisect_left(self._times, end)
        edges = [(time, self.at(time)) for time in (begin, end)]
        start, stop = ([(time, place)] if place is not None else [] for time, place in edges)
        places = [*start, *self._poses[first:last], *stop]
        for one, other in itertools.pairwise(places if len(places) > 1 else 2 * places):
            yield from [(one, other)] if drives(one, other) else [(one, one), (other, other)]


def drives(one: tuple[int, Point], other: tuple[int, Point]) -> bool:
    """Whether the ego may have gone straight from one place to the other."""
    seconds = (other[0] - one[0]) / 1e9
    return math.dist(one[1], other[1]) <= STANDS + FASTEST * seconds


def between(old: Point, new: Point, share: float) -> Point:
    """The point that lies so far on the way from one to the other."""
    return old[0] + share * (new[0] - old[0]), old[1] + share * (new[1] - old[1])
