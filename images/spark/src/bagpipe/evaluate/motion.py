"""Criteria over moving things: distance to obstacles and time to collision."""

import math

from bagpipe.evaluate.errors import pose_of
from bagpipe.evaluate.evidence import Evidence, Sample
from bagpipe.evaluate.finding import Finding, NoEvidenceError
from bagpipe.evaluate.limits import bounded
from bagpipe.evaluate.model import Separation

Point = tuple[float, float]


def separation(name: str, wanted: Separation, evidence: Evidence) -> Finding:
    """The least distance, or the least time to collision. Raises NoEvidenceError without both."""
    pairs = _pairs(wanted, evidence)
    if wanted.min_distance is not None:
        distance, at = min((_distance(e, o), t) for t, e, o, _ in pairs)
        found = bounded(
            Finding(name, "separation", "passed", distance, "m", direction="higher"),
            wanted.min_distance,
            None,
            f"at {(at - evidence.start) / 1e9:.3f} s",
        )
        if found.outcome == "failed" or wanted.min_time_to_collision is None:
            return found
    least = min((_time_to_collision(e, o, v, 2 * wanted.radius), t) for t, e, o, v in pairs)
    return bounded(
        Finding(name, "separation", "passed", least[0], "s", direction="higher"),
        wanted.min_time_to_collision,
        None,
        f"to a collision at {(least[1] - evidence.start) / 1e9:.3f} s",
    )


def closest(wanted: Separation, evidence: Evidence) -> list[tuple[int, float]]:
    """Time in ns and metres to the nearest obstacle. Raises NoEvidenceError without both."""
    least: dict[int, float] = {}
    for time, ego, obstacle, _ in _pairs(wanted, evidence):
        least[time] = min(least.get(time, math.inf), _distance(ego, obstacle))
    return sorted(least.items())


def _pairs(wanted: Separation, evidence: Evidence) -> "list[tuple[int, Point, Point, Point]]":
    ego = evidence.recorded.samples(wanted.ego)
    obstacles = evidence.recorded.samples(wanted.obstacles)
    course = [(sample.time, _ego_at(sample, wanted.ego)) for sample in ego]
    scenes = [(sample.time, _points(sample, wanted.obstacles)) for sample in obstacles]
    if not any(points for _, points in scenes):
        raise NoEvidenceError(f"no obstacle was ever on {wanted.obstacles}")
    return _paired(course, scenes)


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


def _paired(
    course: list[tuple[int, Point]], scenes: list[tuple[int, list[Point]]]
) -> "list[tuple[int, Point, Point, Point]]":
    """(time, ego, obstacle, closing velocity of the obstacle as the ego sees it), per obstacle.

    Each scene meets the ego's pose that was known at its time; velocities come from the scene
    before, where an obstacle keeps its place in the list.
    """
    pairs = []
    at = 0
    before: tuple[int, Point, list[Point]] | None = None
    for time, points in scenes:
        while at + 1 < len(course) and course[at + 1][0] <= time:
            at += 1
        ego = course[at][1]
        for number, point in enumerate(points):
            velocity = (0.0, 0.0)
            if before is not None and number < len(before[2]) and time > before[0]:
                span = (time - before[0]) / 1e9
                old_ego, old = before[1], before[2][number]
                velocity = (
                    ((point[0] - ego[0]) - (old[0] - old_ego[0])) / span,
                    ((point[1] - ego[1]) - (old[1] - old_ego[1])) / span,
                )
            pairs.append((time, ego, point, velocity))
        before = (time, ego, points)
    return pairs


def _distance(ego: Point, obstacle: Point) -> float:
    return math.dist(ego, obstacle)


def _time_to_collision(ego: Point, obstacle: Point, velocity: Point, reach: float) -> float:
    """Seconds until two circles meet at constant velocities; infinite where they never do."""
    x, y = obstacle[0] - ego[0], obstacle[1] - ego[1]
    gap = x * x + y * y - reach * reach
    if gap <= 0:
        return 0.0
    a = velocity[0] ** 2 + velocity[1] ** 2
    b = 2 * (x * velocity[0] + y * velocity[1])
    root = b * b - 4 * a * gap
    if a == 0 or b >= 0 or root < 0:
        return math.inf
    return (-b - math.sqrt(root)) / (2 * a)
