"""Where obstacles come from at the speeds that they have, whatever the order of their lists."""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from bagpipe.evaluate.tracks import Mark, Scene, Sighting, off_course, stretches
from bagpipe.evaluate.way import Point

# Places that lie nearer to each other in time, as of two sensors, give no speed but their noise.
_APART = 100_000_000


class Origin(NamedTuple):
    """Where an obstacle was earlier, and from where it came at the speed that it has."""

    mark: Mark
    sure: bool


# None where no speed is known, and two where the list says something else than the places.
Origins = tuple[Origin, ...]


def origins(scenes: Sequence[Scene], age: int) -> Iterator[list[Origins]]:
    """Of each obstacle of each scene. Places are finite, and scenes ascend by time; who is lost is
    looked for in the next `age` ns.

    One is sure if the obstacle hardly moved, or is where its speed led, now or at its next message,
    and its list says nothing else: in rare messages each of a column may be where another one was.
    """
    seen: list[Sighting] = []
    deque(stretches(scenes, age, 0, seen.append), maxlen=0)
    marks, led = _marks(seen)
    there: set[int] = set()
    for at, (owners, tracks) in enumerate(seen):
        found: list[Origins] = []
        for number, track in enumerate(tracks):
            before, (old, _) = owners.get(number), marks[id(track)]
            listed = _listed(scenes, at, number, before.place if before else None)
            sure = not listed and (track.known or led.get(id(track), False))
            # Who had no speed and was away may be anybody.
            same = track.known or id(before) in there
            apart = same and track.time - old[0] >= _APART
            found.append((*([Origin(old, sure)] if apart else []), *listed))
        there = {id(track) for track in tracks}
        yield found


def _marks(seen: Sequence[Sighting]) -> tuple[dict[int, tuple[Mark, Mark]], dict[int, bool]]:
    """By the identities of tracks, since two in one place are equal: the last two sightings that
    lie apart, or the first, and whether the next one is where the speed led.
    """
    marks: dict[int, tuple[Mark, Mark]] = {}
    led: dict[int, bool] = {}
    for owners, tracks in seen:
        for number, track in enumerate(tracks):
            before = owners.get(number, track)
            if before is track:
                marks.setdefault(id(track), (track.mark, track.mark))
                continue
            led[id(before)] = track.known
            old, middle = marks[id(before)] if track.known else (before.mark, before.mark)
            later = track.time - middle[0] >= _APART
            marks[id(track)] = (middle, track.mark) if later else (old, middle)
    return marks, led


def _listed(scenes: Sequence[Scene], at: int, number: int, place: Point | None) -> list[Origin]:
    """What has its place in the list of the scene before and was elsewhere, if what keeps that
    place in three lists goes steadily.
    """
    for first in range(max(at - 2, 0), at):
        three = scenes[first : first + 3]
        if len(three) < 3 or any(number >= len(points) for _, points in three):
            continue
        marks = [(time, points[number]) for time, points in three]
        old, new = marks[at - 1 - first], marks[at - first]
        elsewhere = place is None or math.dist(old[1], place) > off_course((new[0] - old[0]) / 1e9)
        if elsewhere and _steady(*marks):
            return [Origin(old, sure=False)]
    return []


def _steady(one: Mark, two: Mark, three: Mark) -> bool:
    """Whether one goes straight from the first to the third, however fast."""
    (begin, (x, y)), (middle, (new_x, new_y)), (end, last) = one, two, three
    if not begin < middle < end:
        return False
    ahead = (end - middle) / (middle - begin)
    leads = new_x + ahead * (new_x - x), new_y + ahead * (new_y - y)
    return math.dist(leads, last) <= off_course((end - middle) / 1e9)
