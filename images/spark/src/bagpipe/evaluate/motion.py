"""Criteria over moving things: distance to obstacles and time to collision."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from bagpipe.evaluate.errors import pose_of
from bagpipe.evaluate.evidence import Evidence, Sample
from bagpipe.evaluate.fields import no_number
from bagpipe.evaluate.finding import Clock, Finding, NoEvidenceError, covering
from bagpipe.evaluate.limits import bounded, of_all_bounds
from bagpipe.evaluate.matching import several_frames
from bagpipe.evaluate.model import Separation
from bagpipe.evaluate.way import Point, Way, drives
from bagpipe.evaluate.window import (
    frames_differ,
    messages_of,
    refuse_timeless,
    samples,
    stamp_of,
    stamps_of,
)
from bagpipe.texts import duration_nanoseconds

if TYPE_CHECKING:
    from bagpipe.evaluate.approach import Approaches
    from bagpipe.evaluate.speeds import Origins

# Time in ns, the ego, an obstacle, and the obstacle's velocity as the ego sees it, if it is known.
Pair = tuple[int, Point, Point, Point | None]


def separation(name: str, wanted: Separation, evidence: Evidence) -> Finding:
    """The least distance, or the least time to collision. Raises NoEvidenceError without both."""
    met = _met(wanted, evidence)
    evidence.keep(wanted, met)
    odd = _odd(name, met, evidence)
    if odd is None:
        for topic in (wanted.ego, wanted.obstacles):
            found = messages_of(topic, evidence)
            refuse_timeless(found, evidence, "where both were at one time")
    finding = odd or _least(name, wanted, evidence, met.pairs, met.sure)
    finding = _feared(finding, wanted, evidence, met.feared)
    return covering(
        finding,
        met.share,
        f"{met.share:.0%} of the window, in which both are at most {wanted.max_age} old"
        f"{met.besides}",
        met.clock,
        wanted.min_coverage,
        lasting=True,
        remedy="raise maxAge if they are published less often, or lower minCoverage",
    )


def _least(
    name: str,
    wanted: Separation,
    evidence: Evidence,
    pairs: list[Pair],
    sure: list[Pair] | None = None,
) -> Finding:
    """By default all velocities are sure."""
    if not pairs:
        raise NoEvidenceError(
            f"no obstacle was ever on {wanted.obstacles} while a pose on {wanted.ego} was at most"
            f" {wanted.max_age} old"
        )
    found = []
    if wanted.min_distance is not None:
        found.append(_least_distance(name, wanted.min_distance, evidence, pairs))
    if wanted.min_time_to_collision is not None:
        try:
            found.append(
                _least_time(name, wanted, evidence, pairs, pairs if sure is None else sure)
            )
        except NoEvidenceError:
            # What came too near did so, however fast it was.
            if not found or found[0].outcome != "failed":
                raise
    return of_all_bounds(found, found[-1])


def _least_distance(name: str, least: float, evidence: Evidence, pairs: list[Pair]) -> Finding:
    distance, at = min((_distance(e, o), t) for t, e, o, _ in pairs)
    finding = Finding(name, "separation", "passed", distance, "m", direction="higher")
    return bounded(finding, least, None, f"at {(at - evidence.start) / 1e9:.3f} s")


def _least_time(
    name: str, wanted: Separation, evidence: Evidence, pairs: list[Pair], sure: list[Pair]
) -> Finding:
    """Invalid where a collision is too near at a speed alone that an obstacle may not have had."""
    least = _soonest(pairs, wanted)
    if least is None:
        raise NoEvidenceError(
            f"no obstacle on {wanted.obstacles} was seen at two times, so that none has a speed"
        )
    found = [
        bounded(
            Finding(name, "separation", "passed", left, "s", direction="higher"),
            wanted.min_time_to_collision,
            None,
            f"to a collision at {(at - evidence.start) / 1e9:.3f} s",
        )
        for left, at in filter(None, (least, _soonest(sure, wanted)))
    ]
    if found[0].outcome == "passed":
        return found[0]
    if found[-1].outcome == "failed" and len(found) > 1:
        return found[-1]
    message = (
        "which obstacle of one message is which of the next one is not sure, and it may have had"
        f" no such speed: publish them more often; {found[0].message}"
    )
    return replace(found[0], outcome="invalid", message=message)


def _soonest(pairs: list[Pair], wanted: Separation) -> tuple[float, int] | None:
    """The least time to a collision in seconds, and when that was in ns."""
    times = [(_time_to_collision(e, o, v, 2 * wanted.radius), t) for t, e, o, v in pairs]
    return min(((left, t) for left, t in times if left is not None), default=None)


def _feared(
    finding: Finding, wanted: Separation, evidence: Evidence, feared: list[tuple[int, float]]
) -> Finding:
    """Invalid where no message shows that an obstacle came too near, and one would have: on the
    straight line between two messages, or after its last one, had it gone on as before.
    """
    distance, at = min(((metres, time) for time, metres in feared), default=(math.inf, 0))
    if finding.outcome != "passed" or distance >= _too_near(wanted):
        return finding
    message = (
        f"between two messages that have it, or after the last one, an obstacle may have been"
        f" {distance:.6g} m away at {(at - evidence.start) / 1e9:.3f} s, and no message on"
        f" {wanted.obstacles} shows where it was then: publish them more often, or until they are"
        f" passed; {finding.message}"
    )
    return replace(finding, outcome="invalid", message=message)


def _too_near(wanted: Separation) -> float:
    """Metres below which the distance of an obstacle breaks a bound, whatever its speed is."""
    touch = 2 * wanted.radius if wanted.min_time_to_collision is not None else 0.0
    return max(wanted.min_distance or 0.0, touch)


def _odd(name: str, met: "Met", evidence: Evidence) -> Finding | None:
    for what, points in (("the ego's pose", met.course), ("an obstacle's pose", met.obstacles)):
        values = ((time, number) for time, point in points for number in point)
        found = no_number(name, "separation", what, values, evidence.start)
        if found is not None:
            return found
    return None


def closest(wanted: Separation, evidence: Evidence) -> list[tuple[int, float]]:
    """Time in ns and metres to the nearest obstacle. Raises NoEvidenceError without both."""
    return [(time, _distance(ego, obstacle)) for time, ego, obstacle in nearest(wanted, evidence)]


def nearest(wanted: Separation, evidence: Evidence) -> list[tuple[int, Point, Point]]:
    """Time in ns, the ego and the nearest obstacle. Raises NoEvidenceError without both."""
    least: dict[int, tuple[Point, Point]] = {}
    met: Met = evidence.kept(wanted) or _met(wanted, evidence)
    for time, ego, obstacle, _ in met.pairs:
        if time not in least or _distance(ego, obstacle) < _distance(*least[time]):
            least[time] = (ego, obstacle)
    return [(time, *least[time]) for time in sorted(least)]


@dataclass(frozen=True)
class Met:
    """Where ego and obstacles were at the same time, and in how much of the window."""

    course: list[tuple[int, Point]]
    obstacles: list[tuple[int, Point]]
    pairs: list[Pair]
    # The same, without the velocities that an obstacle may never have had.
    sure: list[Pair]
    # How near obstacles may have been that are not seen any more.
    feared: list[tuple[int, float]]
    share: float
    clock: Clock
    # In words, what else the covered time is without.
    besides: str


def _met(wanted: Separation, evidence: Evidence) -> Met:
    ego_messages = messages_of(wanted.ego, evidence)
    obstacle_messages = messages_of(wanted.obstacles, evidence)
    ego, obstacles = samples(ego_messages, evidence), samples(obstacle_messages, evidence)
    apart = frames_differ(ego, obstacles, wanted.ego, wanted.obstacles)
    apart = apart or several_frames(ego, wanted.ego)
    apart = apart or several_frames(obstacles, wanted.obstacles)
    if apart and not wanted.any_frame:
        raise NoEvidenceError(apart)
    # One bad stamp moves nothing but its own message; of another clock all of a topic's are bad.
    stamped = all(
        any(stamp is not None for stamp in stamps_of(topic, evidence)) for topic in (ego, obstacles)
    )
    course = sorted((_when(each, stamped, evidence), _ego_at(each, wanted.ego)) for each in ego)
    scenes = sorted(
        (_when(each, stamped, evidence), _points(each, wanted.obstacles)) for each in obstacles
    )
    if not any(points for _, points in scenes):
        raise NoEvidenceError(f"no obstacle was ever on {wanted.obstacles}")
    age = duration_nanoseconds(wanted.max_age)
    way = Way(course, age)
    with_ego = _with_ego(course, way, scenes, age)
    near = _between(course, way, scenes, age, evidence.end)
    seen: list[Pair] = [(*each, None) for each in near.seen]
    since = _since(wanted, course, with_ego, age)
    pairs = _paired(with_ego, since) + seen
    in_time = wanted.min_time_to_collision is not None
    lost = [(each.begin, each.until) for each in near.unknown if each.metres < _too_near(wanted)]
    return Met(
        course,
        [(time, point) for time, points in scenes for point in points],
        pairs,
        _paired(with_ego, since, sure=True) + seen if in_time else pairs,
        near.feared,
        _share(course, with_ego, lost, wanted, evidence),
        "header" if ego_messages.clock == obstacle_messages.clock == "header" else "receipt",
        " and no obstacle was lost near the ego before it had a speed" if lost else "",
    )


def _when(sample: Sample, stamped: bool, evidence: Evidence) -> int:
    stamp = stamp_of(sample, evidence) if stamped else None
    return sample.time if stamp is None else stamp


def _with_ego(
    course: list[tuple[int, Point]], way: Way, scenes: list[tuple[int, list[Point]]], age: int
) -> list[tuple[int, Point, list[Point]]]:
    """The scenes with the ego's pose that was known then, or comes soon after the first ones;
    without those at which it was too old.
    """
    found = []
    at = 0
    for time, points in scenes:
        while at + 1 < len(course) and course[at + 1][0] <= time:
            at += 1
        if abs(time - course[at][0]) <= age:
            found.append((time, way.at(time) or course[at][1], points))
    return found


def _share(
    course: list[tuple[int, Point]],
    scenes: list[tuple[int, Point, list[Point]]],
    lost: list[tuple[int, int]],
    wanted: Separation,
    evidence: Evidence,
) -> float:
    """The share of the window that is at most `maxAge` after a pose and after a scene, or before
    the first ones, without the stretches for which an obstacle is lost.
    """
    times = [time for time, _, _ in scenes]
    if not any(evidence.start <= time < evidence.end for time in times):
        return 0.0
    age = duration_nanoseconds(wanted.max_age)
    length = evidence.end - evidence.start
    old = _too_old([time for time, _ in course], age, evidence) + _too_old(times, age, evidence)
    inside = [(max(begin, evidence.start), until) for begin, until in lost]
    unknown = _joined(old + [each for each in inside if each[0] < each[1]])
    share = 1.0 - sum(after - before for before, after in unknown) / length
    if share < wanted.min_coverage:
        length = evidence.input_time_between(evidence.start, evidence.end) or length
        share = 1.0 - sum(evidence.input_time_between(*each) for each in unknown) / length
    return share


def _too_old(times: list[int], age: int, evidence: Evidence) -> list[tuple[int, int]]:
    """The stretches of the window in which the last of the times is more than `age` ago."""
    inside = [time for time in times if evidence.start <= time < evidence.end]
    gaps = itertools.pairwise([evidence.start, *inside, evidence.end])
    return [(before + age, after) for before, after in gaps if before + age < after]


def _joined(stretches: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """The same stretches of time, none of which overlaps another."""
    joined: list[tuple[int, int]] = []
    for begin, end in sorted(stretches):
        if joined and begin <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(end, joined[-1][1]))
        else:
            joined.append((begin, end))
    return joined


def _ego_at(sample: Sample, topic: str) -> Point:
    pose = pose_of(sample.message)
    if pose is None:
        raise NoEvidenceError(f"messages on {topic} have no pose: record an Odometry")
    return float(pose[0].x), float(pose[0].y)


def _points(sample: Sample, topic: str) -> list[Point]:
    poses = getattr(sample.message, "poses", None)
    if poses is None:
        raise NoEvidenceError(f"messages on {topic} have no poses: record a PoseArray")
    points = []
    for pose in poses:
        position = getattr(pose, "position", None) or pose.pose.position
        points.append((float(position.x), float(position.y)))
    return points


def _since(
    wanted: Separation,
    course: list[tuple[int, Point]],
    scenes: list[tuple[int, Point, list[Point]]],
    age: int,
) -> "list[list[Origins]]":
    """For each obstacle where its speed may be from, if that is asked for."""
    places = [(time, points) for time, _, points in scenes]
    if wanted.min_time_to_collision is None or not _finite(course, places):
        return [[()] * len(points) for _, points in places]
    # Other criteria, and the start of a laptop's run, need neither numpy nor scipy.
    from bagpipe.evaluate.speeds import origins  # noqa: PLC0415

    return list(origins(places, age))


def _paired(
    scenes: list[tuple[int, Point, list[Point]]],
    since: "Sequence[Sequence[Origins]]",
    *,
    sure: bool = False,
) -> list[Pair]:
    """(time, ego, obstacle, closing velocity of the obstacle as the ego sees it), per obstacle and
    place where it may come from, or of those that are sure.

    Velocities are of an ego that may have driven from where it was then.
    """
    pairs: list[Pair] = []
    egos: dict[int, Point] = {}
    before: tuple[int, Point] | None = None
    driven = 0  # since when
    for (time, ego, points), earlier in zip(scenes, since, strict=True):
        if before is not None and not drives(before, (time, ego)):
            driven = time
        before, egos[time] = (time, ego), ego
        for point, origins in zip(points, earlier, strict=True):
            marks = [each.mark for each in origins if each.sure or not sure]
            velocities: list[Point | None] = [
                _velocity((then, egos[then]), old, (time, ego), point)
                for then, old in marks
                if then >= driven
            ]
            pairs.extend((time, ego, point, each) for each in velocities or [None])
    return pairs


def _velocity(then: tuple[int, Point], old: Point, now: tuple[int, Point], point: Point) -> Point:
    """Of an obstacle, as the ego sees it."""
    (begin, old_ego), (end, ego) = then, now
    span = (end - begin) / 1e9
    return (
        ((point[0] - ego[0]) - (old[0] - old_ego[0])) / span,
        ((point[1] - ego[1]) - (old[1] - old_ego[1])) / span,
    )


def _between(
    course: list[tuple[int, Point]],
    way: Way,
    scenes: list[tuple[int, list[Point]]],
    age: int,
    end: int,
) -> "Approaches":
    """How near the ego came to obstacles between the scenes and behind the last ones."""
    # As for speeds.
    from bagpipe.evaluate.approach import Approaches, approaches  # noqa: PLC0415

    if not _finite(course, scenes):
        return Approaches([], [], [])  # which fails it
    return approaches(way, scenes, age, end)


def _finite(course: list[tuple[int, Point]], scenes: list[tuple[int, list[Point]]]) -> bool:
    places = itertools.chain((ego for _, ego in course), *(points for _, points in scenes))
    return all(math.isfinite(number) for place in places for number in place)


def _distance(ego: Point, obstacle: Point) -> float:
    return math.dist(ego, obstacle)


def _time_to_collision(
    ego: Point, obstacle: Point, velocity: Point | None, reach: float
) -> float | None:
    """Seconds until two circles meet at constant velocities; infinite where they never do, None
    where it is not known how fast they come nearer.
    """
    x, y = obstacle[0] - ego[0], obstacle[1] - ego[1]
    gap = x * x + y * y - reach * reach
    if gap <= 0:
        return 0.0
    if velocity is None:
        return None
    a = velocity[0] ** 2 + velocity[1] ** 2
    b = 2 * (x * velocity[0] + y * velocity[1])
    root = b * b - 4 * a * gap
    if b >= 0 or root < 0:  # it comes no nearer, or passes by
        return math.inf
    return (-b - math.sqrt(root)) / (2 * a)
