"""How criteria's figures went over time: a few points that travel with each finding.

They are taken where the recording is decoded already, in the executor. The report is made in the
driver, whose account may create pods: nothing that a stack has recorded is decoded there.
"""

import itertools
import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from bagpipe.evaluate.delivery import counted_by_presence, moments_of
from bagpipe.evaluate.errors import distances_of, pose_of
from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.fields import number_at
from bagpipe.evaluate.finding import Finding, NoEvidenceError
from bagpipe.evaluate.model import Criterion
from bagpipe.evaluate.motion import closest
from bagpipe.evaluate.plane import Plane, plane_of_error, plane_of_final_pose, plane_of_separation
from bagpipe.evaluate.rounding import digits_for, rounded_within
from bagpipe.evaluate.values import held
from bagpipe.evaluate.window import messages_of, samples
from bagpipe.texts import duration_seconds

# A point is some 14 bytes of a row, which passes through the driver, one in the plane 24: of a case
# that did not pass 76 KB at most, of one that passed, of which there may be 100,000, 19 KB.
MOST_POINTS, MOST_POINTS_OF_ALL = 400, 2000
MOST_PASSED_POINTS, MOST_PASSED_POINTS_OF_ALL = 100, 500
_MOST_ODD = 20
_DIGITS = 5
_TURNS = 3
Course = list[tuple[int, float]]

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Plotted:
    """What a criterion's figure did: times in ns and values, with the bounds of a single value.

    With `step` a value holds until the next one.
    """

    label: str
    unit: str
    low: float | None
    high: float | None
    course: Course
    step: bool = False
    plane: Plane | None = None


def with_courses(
    criteria: Sequence[Criterion], findings: Sequence[Finding], evidence: Evidence
) -> list[Finding]:
    """The findings with their courses, as far as there are some.

    Those of all that passed share one bound of points, and all others another.
    """
    passed = sum(finding.outcome == "passed" for finding in findings)
    others = len(findings) - passed
    kept = []
    for criterion, finding in zip(criteria, findings, strict=True):
        if finding.outcome == "passed":
            most = min(MOST_PASSED_POINTS, MOST_PASSED_POINTS_OF_ALL // passed)
        else:
            most = min(MOST_POINTS, MOST_POINTS_OF_ALL // others)
        kept.append(replace(finding, course=_course_of(criterion, finding, evidence, most)))
    return kept


def _course_of(
    criterion: Criterion, finding: Finding, evidence: Evidence, most: int
) -> dict[str, Any] | None:
    """`label`, `unit`, the bounds `low` and `high`, `points` of [seconds, value], and, where there
    are some, `odd`: seconds at which the value is no finite number; `step` where it is True.

    None for kinds that have no course, and where none can be had: it decides nothing.
    """
    measured = _COURSES.get(criterion.kind)
    if measured is None:
        return _answered(finding, evidence, most)
    try:
        plotted = measured(criterion.measurement, evidence)
    except NoEvidenceError:
        return None  # the finding says why
    except Exception:  # the finding stands without it
        log.info("no course of %s", criterion.name, exc_info=True)
        return None
    return _as_json(plotted, evidence, most, failed=finding.outcome == "failed")


def _answered(finding: Finding, evidence: Evidence, most: int) -> dict[str, Any] | None:
    """The course that a user's own evaluator has answered, if it has."""
    own = finding.course
    if own is None:
        return None
    plotted = _Plotted(own["label"], own["unit"], own["low"], own["high"], own["points"])
    return _as_json(plotted, evidence, most, failed=finding.outcome == "failed")


def _as_json(plotted: _Plotted, evidence: Evidence, most: int, *, failed: bool) -> dict[str, Any]:
    def seconds(time: int) -> float:
        return round((time - evidence.start) / 1e9, 4)

    finite = [(at, value) for at, value in plotted.course if math.isfinite(value)]
    odd = [seconds(at) for at, value in plotted.course if not math.isfinite(value)]
    low, high = plotted.low, plotted.high
    kept = with_turns(finite, most, low, high) if failed else thinned(finite, most)
    digits = digits_for([value for _, value in finite], _DIGITS)
    points = [[seconds(at), rounded_within(value, digits, low, high)] for at, value in kept]
    course: dict[str, Any] = {"label": plotted.label, "unit": plotted.unit}
    course |= {"low": low, "high": high, "points": points}
    course |= {"odd": odd[:_MOST_ODD]} if odd else {}
    if plotted.plane is not None:
        # Half as many points of each of at most two paths.
        course["plane"] = plotted.plane.as_json(evidence.start, most // 2)
    return course | ({"step": True} if plotted.step else {})


def with_turns(course: Course, most: int, low: float | None, high: float | None) -> Course:
    """The same, with the first points below and above its bounds, and the last one: by them it is
    known when it left them, which the greatest of a stretch of many does not show.
    """
    if len(course) <= most:
        return course
    below = [each for each in course if low is not None and each[1] < low][:1]
    above = [each for each in course if high is not None and each[1] > high][:1]
    return sorted({*thinned(course, most - _TURNS), *below, *above, course[-1]})


def thinned(course: Course, most: int = MOST_POINTS) -> Course:
    """At most `most` points, from 2 on: of every stretch its least and its greatest, so that peaks
    stay.
    """
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


def _presence(wanted: Any, evidence: Evidence) -> _Plotted:
    times = sorted(each.time for each in counted_by_presence(wanted, evidence))
    course = [(evidence.start, 0.0)]
    course += [(time, float(number)) for number, time in enumerate(times, start=1)]
    course.append((max(evidence.end, course[-1][0]), float(len(times))))
    label = f"{wanted.topic}, messages so far"
    return _Plotted(label, "messages", wanted.min, wanted.max, course, step=True)


def _bounds(wanted: Any, evidence: Evidence) -> _Plotted:
    answers = samples(messages_of(wanted.topic, evidence), evidence)
    course = [(sample.time, number_at(sample.message, wanted.field)) for sample in answers]
    return _Plotted(f"{wanted.topic} {wanted.field}", "", wanted.min, wanted.max, course)


def _expression(wanted: Any, evidence: Evidence) -> _Plotted:
    course = [(time, float(holds)) for time, holds in held(wanted, evidence)]
    # Of a share single messages may miss it, and no line is theirs.
    low = 1.0 if wanted.share == 1.0 else None
    return _Plotted(f"{wanted.holds}: 1 where it holds", "", low, None, course, step=True)


def _rate(wanted: Any, evidence: Evidence) -> _Plotted:
    moments = moments_of(messages_of(wanted.topic, evidence), evidence)
    pairs = itertools.pairwise(time for time, _ in moments)
    course = [(after, 1e9 / (after - before)) for before, after in pairs if after > before]
    label = f"{wanted.topic}, 1 / time since the last"
    return _Plotted(label, "Hz", wanted.min, wanted.max, course)


def _latency(wanted: Any, evidence: Evidence) -> _Plotted:
    course = [
        (each.time, evidence.real_seconds(each.time - each.stamp))
        for each in messages_of(wanted.topic, evidence).answers
        if each.stamp is not None
    ]
    label = f"{wanted.topic}, stamp to receipt"
    return _Plotted(label, "s", None, duration_seconds(wanted.max), course)


def _error(wanted: Any, evidence: Evidence) -> _Plotted:
    label = f"{wanted.topic} {', '.join(wanted.fields)} off the truth"
    course = distances_of(wanted, evidence)
    return _Plotted(label, "", None, wanted.max, course, plane=plane_of_error(wanted, evidence))


def _final_pose(wanted: Any, evidence: Evidence) -> _Plotted:
    course = []
    for sample in samples(messages_of(wanted.topic, evidence), evidence):
        pose = pose_of(sample.message)
        if pose is not None:
            distance = math.dist(wanted.position[:2], (float(pose[0].x), float(pose[0].y)))
            course.append((sample.time, distance))
    label = f"{wanted.topic}, distance from the goal"
    plane = plane_of_final_pose(wanted, evidence)
    return _Plotted(label, "m", None, wanted.max_distance, course, plane=plane)


def _separation(wanted: Any, evidence: Evidence) -> _Plotted:
    label = f"{wanted.ego}, distance to the nearest of {wanted.obstacles}"
    course, plane = closest(wanted, evidence), plane_of_separation(wanted, evidence)
    return _Plotted(label, "m", wanted.min_distance, None, course, plane=plane)


# Not `resources`: the agent measures sums over the whole case.
_COURSES: dict[str, Callable[[Any, Evidence], _Plotted]] = {
    "presence": _presence,
    "bounds": _bounds,
    "expression": _expression,
    "rate": _rate,
    "latency": _latency,
    "error": _error,
    "finalPose": _final_pose,
    "separation": _separation,
}
