"""Obstacles followed from message to message by their places, whatever the order of the list is."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from scipy.spatial import KDTree

from bagpipe.evaluate.way import FASTEST, STANDS, Point

# Time in ns, and where the obstacles are then.
Scene = tuple[int, list[Point]]
# Time in ns, and where one obstacle is then.
Mark = tuple[int, Point]
# `seen`: it is known where it was; `feared`: where it would have been at the speed that it had, or
# on the straight line to where it was next; `unknown`: where it was last, and no speed is known.
Kind = Literal["seen", "feared", "unknown"]

# Metres per second, per second: what changes its speed by more is another obstacle.
_HARDEST = 5.0
# A speed is that over so many ns at least, if there are: places have noise.
_LONG_ENOUGH = 500_000_000
# Of one that was followed for less, it is not known where it goes.
_LEAST_FOLLOWED = 250_000_000
# Of one that was followed for less still, its speed leads no longer than so many times as long: two
# sensors that see it at nearly the same time, each a little off, give it a speed that it hasn't.
_LEADS = 2
# Of finding who is nearest to whom among those that are left; the rest is taken for others.
_ROUNDS = 8
# Lost ones that are looked for at a time: with a large maxAge they would only become more. In
# messages that have few obstacles they are fewer, so that the work grows as the recording does.
_MOST_LOST, _LEAST_LOST, _LOST_OF_EACH = 10_000, 100, 50


class Stretch(NamedTuple):
    """Where an obstacle is from one time in ns to another, in metres and metres per second."""

    kind: Kind
    begin: int
    until: int
    place: Point
    speed: Point


class _Track(NamedTuple):
    """An obstacle that was seen last at a time in ns. Its speed is `known` if it hardly moved, or
    was where its speed before leads to.
    """

    time: int
    place: Point
    speed: Point | None = None
    known: bool = False
    # Earlier sightings, of which the first gives the speed.
    marks: tuple[Mark, ...] = ()

    @property
    def mark(self) -> Mark:
        """This sighting."""
        return self.time, self.place

    @property
    def goes(self) -> bool:
        """Whether its speed says where it would be later."""
        return self.known and self._followed >= _LEAST_FOLLOWED

    @property
    def _followed(self) -> int:
        """For how many ns its speed was measured."""
        return self.time - self.marks[0][0] if self.marks else 0

    def _leads(self, time: int) -> bool:
        """Whether a speed of sightings that lie so near to each other leads that far."""
        followed = self._followed
        return followed >= _LEAST_FOLLOWED or abs(time - self.time) <= _LEADS * followed

    def _on_course(self, time: int) -> bool:
        """Whether it is known how far it may be at most from where it would be."""
        return self.known and self._leads(time)

    def at(self, time: int) -> Point:
        """Where it would be, or as far on the way there as its speed leads; where it was last, as
        long as it has none.
        """
        # Most that are looked for are lost ones without a speed.
        if self.speed is None:
            return self.place
        x, y = self.speed
        since = time - self.time
        if not self._leads(time):
            since = round(math.copysign(_LEADS * self._followed, since))
        return self.place[0] + x * since / 1e9, self.place[1] + y * since / 1e9

    def reach(self, time: int) -> float:
        """How many metres from there it may be."""
        seconds = (time - self.time) / 1e9
        return off_course(seconds) if self._on_course(time) else STANDS + FASTEST * seconds

    def seen_again(self, time: int, place: Point) -> Self:
        """The same, at a later message."""
        if time == self.time:
            return self
        off, seconds = math.dist(self.at(time), place), (time - self.time) / 1e9
        led_there = self._leads(time) and off <= off_course(seconds)
        known = self._on_course(time) or led_there or math.dist(self.place, place) <= STANDS
        old, middle = self.marks if known and self.marks else 2 * (self.mark,)
        if time - middle[0] >= _LONG_ENOUGH:
            old, middle = middle, (time, place)
        span = (time - old[0]) / 1e9
        speed = (place[0] - old[1][0]) / span, (place[1] - old[1][1]) / span
        return type(self)(time, place, speed, known, (old, middle))

    def until_again(self, again: Self, age: int, before: int) -> Iterator[Stretch]:
        """From this sighting to the next one, if it hardly moved meanwhile or it is known where it
        goes: straight there, and then it is known where it came from, too. If the message at the
        time `before`, just before the next one, lacks it, it may as well have gone on as before and
        be another one.
        """
        if again.time == self.time:
            return
        stood = math.dist(self.place, again.place) <= STANDS
        if stood or again.goes:
            yield _straight("seen" if stood else "feared", self.mark, again.mark, age)
        if again.goes and self.marks and not (self.goes or stood):
            yield _straight("feared", self.marks[0], self.mark, age)
        if not stood and (self.time < before or not again.goes):
            yield self.behind(age, again.time, again.time)

    def may_be(self, other: Self) -> bool:
        """Whether it was where the other one, which was not seen later, was seen last."""
        off = math.dist(self.at(other.time), other.place)
        seconds = (self.time - other.time) / 1e9
        return not self._on_course(other.time) or off <= off_course(seconds)

    def behind(self, age: int, end: int, last: int) -> Stretch:
        """Behind its last sighting. Where it stood, and no later message lacks it, it stands."""
        until = min(self.time + age, end)
        if self.speed is None or not self.goes:
            return Stretch("unknown", self.time, until, self.place, (0.0, 0.0))
        stands = math.hypot(*self.speed) * (until - self.time) / 1e9 <= STANDS
        kind: Kind = "seen" if stands and self.time == last else "feared"
        return Stretch(kind, self.time, until, self.place, self.speed)


def _straight(kind: Kind, one: Mark, other: Mark, age: int) -> Stretch:
    """From one sighting to a later one, and for at most `age` ns."""
    (begin, (x, y)), (end, (new_x, new_y)) = one, other
    seconds = (end - begin) / 1e9
    speed = (new_x - x) / seconds, (new_y - y) / seconds
    return Stretch(kind, begin, min(end, begin + age), (x, y), speed)


def off_course(seconds: float) -> float:
    """Metres that one whose speed is known may be from where that leads in so many seconds."""
    return 2 * STANDS + _HARDEST * seconds * seconds


# The tracks that go on at a scene's points, by the points' numbers, and those that end there now.
Sighting = tuple[dict[int, _Track], list[_Track]]


def stretches(
    scenes: Sequence[Scene], age: int, end: int, seen: Callable[[Sighting], None] | None = None
) -> Iterator[Stretch]:
    """What is known of the obstacles' places between their messages, and for at most `age` ns
    behind the last one that has them, up to `end`. Places are finite, and scenes ascend by time.

    An obstacle that a message lacks is looked for in the later ones for `age` ns. One that is
    another one's double is the same. `seen` is called with what each scene has.
    """
    tracks: list[_Track] = []
    before = last = scenes[-1][0] if scenes else 0
    for (time, points), most in zip(scenes, _most_lost(scenes), strict=True):
        oldest = min(time - age, before)
        yield from (each.behind(age, end, last) for each in tracks if each.time < oldest)
        waiting = [each for each in tracks if each.time >= oldest]
        numbers = _matched(waiting, time, points)
        owners = _owners(waiting, numbers, time, points)
        tracks = []
        for track, number in zip(waiting, numbers, strict=True):
            if number is None or not owners[number].may_be(track):
                tracks.append(track)
            else:
                yield from track.until_again(track.seen_again(time, points[number]), age, before)
        before = time
        yield from (each.behind(age, end, last) for each in tracks[:-most])
        del tracks[:-most]
        new = [
            owners[number].seen_again(time, point) if number in owners else _Track(time, point)
            for number, point in enumerate(points)
        ]
        tracks += new
        if seen is not None:
            seen((owners, new))
    yield from (each.behind(age, end, last) for each in tracks)


def _most_lost(scenes: Sequence[Scene]) -> Iterator[int]:
    """How many lost ones are looked for behind each scene."""
    seen = itertools.accumulate(len(points) for _, points in scenes)
    for number, so_far in enumerate(seen, start=1):
        yield min(_MOST_LOST, _LEAST_LOST + _LOST_OF_EACH * so_far // number)


def _owners(
    tracks: Sequence[_Track], numbers: Sequence[int | None], time: int, points: Sequence[Point]
) -> dict[int, _Track]:
    """The track that goes on at each point: of several the one that was seen last, and of these
    the one that leads there best.
    """
    owners: dict[int, tuple[int, float, _Track]] = {}
    for track, number in zip(tracks, numbers, strict=True):
        if number is not None:
            owner = (-track.time, math.dist(track.at(time), points[number]), track)
            owners[number] = min(owner, owners.get(number, owner), key=lambda each: each[:2])
    return {number: track for number, (_, _, track) in owners.items()}


def _matched(tracks: Sequence[_Track], time: int, points: Sequence[Point]) -> list[int | None]:
    """Which point each track is, None for those that are not there.

    A point where a track would be, or nearly, is it, though another one may be it as well; one
    that is only within its reach is if it is nobody else's.
    """
    found = np.full(len(tracks), -1)
    if not (tracks and points):
        return [None] * len(tracks)
    there = _array([each.at(time) for each in tracks])
    # What lies in one place lies in one leaf of a tree, through all of which each look would go.
    new, numbers = np.unique(_array(points), axis=0, return_index=True)
    apart, which = KDTree(new).query(there, distance_upper_bound=STANDS)
    found[apart <= STANDS] = which[apart <= STANDS]
    reach = np.array([each.reach(time) for each in tracks])
    for _ in range(_ROUNDS):
        left = np.flatnonzero(found < 0)
        free = np.setdiff1d(np.arange(len(new)), found)
        if not (len(left) and len(free)):
            break
        apart, which = KDTree(new[free]).query(there[left])
        within = np.flatnonzero(apart <= reach[left])
        if not len(within):
            break
        nearest = within[np.argsort(apart[within], kind="stable")]
        _, first = np.unique(which[nearest], return_index=True)
        chosen = nearest[first]
        found[left[chosen]] = free[which[chosen]]
    return [int(numbers[place]) if place >= 0 else None for place in found]


def _array(points: Sequence[Point]) -> Any:
    return np.array(points, dtype=float).reshape(-1, 2)
