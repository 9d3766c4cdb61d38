"""How a failing criterion's figure went over time: a few points that travel with its finding.

They are taken where the recording is decoded already, in the executor. The report is made in the
driver, whose account may create pods: nothing that a stack has recorded is decoded there.
"""

import itertools
import logging
import math
from collections.abc import Callable
from typing import Any

from bagpipe.evaluate.errors import distances_of, pose_of
from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.fields import number_at
from bagpipe.evaluate.model import Criterion
from bagpipe.evaluate.motion import closest
from bagpipe.evaluate.window import messages_of, samples
from bagpipe.texts import duration_seconds

# 200 points are some 3 KB of a row, which passes through the driver.
MOST_POINTS = 200
Course = list[tuple[int, float]]

log = logging.getLogger(__name__)


def course_of(criterion: Criterion, evidence: Evidence) -> dict[str, Any] | None:
    """`label`, `unit`, the bounds `low` and `high`, and `points` of [seconds, value].

    None for kinds that have no course, and where none can be had: it decides nothing.
    """
    measured = _COURSES.get(criterion.kind)
    if measured is None:
        return None
    try:
        label, unit, low, high, course = measured(criterion.measurement, evidence)
    except Exception:  # the finding stands without it
        log.info("no course of %s", criterion.name, exc_info=True)
        return None
    finite = [(at, value) for at, value in course if math.isfinite(value)]
    points = [
        [round((at - evidence.start) / 1e9, 4), float(f"{value:.5g}")]
        for at, value in thinned(finite)
    ]
    return {"label": label, "unit": unit, "low": low, "high": high, "points": points}


def thinned(course: Course, most: int = MOST_POINTS) -> Course:
    """At most `most` points: of every stretch its least and its greatest, so that peaks stay."""
    if len(course) <= most:
        return course
    stretches = most // 2
    kept = []
    for number in range(stretches):
        first = number * len(course) // stretches
        last = (number + 1) * len(course) // stretches
        stretch = course[first:last]
        kept += sorted({min(stretch, key=_value), max(stretch, key=_value)})
    return kept


def _value(point: tuple[int, float]) -> float:
    return point[1]


_Plotted = tuple[str, str, float | None, float | None, Course]


def _bounds(wanted: Any, evidence: Evidence) -> _Plotted:
    answers = samples(messages_of(wanted.topic, evidence), evidence)
    course = [(sample.time, number_at(sample.message, wanted.field)) for sample in answers]
    return f"{wanted.topic} {wanted.field}", "", wanted.min, wanted.max, course


def _rate(wanted: Any, evidence: Evidence) -> _Plotted:
    pairs = itertools.pairwise(each.time for each in messages_of(wanted.topic, evidence).inside)
    course = [(after, 1e9 / (after - before)) for before, after in pairs if after > before]
    return f"{wanted.topic}, 1 / time since the last", "Hz", wanted.min, wanted.max, course


def _latency(wanted: Any, evidence: Evidence) -> _Plotted:
    course = [
        (each.time, (each.time - each.stamp) / 1e9)
        for each in messages_of(wanted.topic, evidence).answers
        if each.stamp is not None
    ]
    return f"{wanted.topic}, stamp to receipt", "s", None, duration_seconds(wanted.max), course


def _error(wanted: Any, evidence: Evidence) -> _Plotted:
    fields = ", ".join(wanted.fields)
    return (
        f"{wanted.topic} {fields} off the truth",
        "",
        None,
        wanted.max,
        distances_of(wanted, evidence),
    )


def _final_pose(wanted: Any, evidence: Evidence) -> _Plotted:
    course = []
    for sample in samples(messages_of(wanted.topic, evidence), evidence):
        pose = pose_of(sample.message)
        if pose is not None:
            distance = math.dist(wanted.position[:2], (float(pose[0].x), float(pose[0].y)))
            course.append((sample.time, distance))
    return f"{wanted.topic}, distance from the goal", "m", None, wanted.max_distance, course


def _separation(wanted: Any, evidence: Evidence) -> _Plotted:
    label = f"{wanted.ego}, distance to the nearest of {wanted.obstacles}"
    return label, "m", wanted.min_distance, None, closest(wanted, evidence)


_COURSES: dict[str, Callable[[Any, Evidence], _Plotted]] = {
    "bounds": _bounds,
    "rate": _rate,
    "latency": _latency,
    "error": _error,
    "finalPose": _final_pose,
    "separation": _separation,
}
