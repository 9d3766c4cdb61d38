"""What a criterion measures, as a mark: figures of one name are compared where it is equal."""

import hashlib
import json
from dataclasses import replace

from bagpipe.evaluate.finding import Finding
from bagpipe.evaluate.model import Criterion
from bagpipe.row_facts import SLOWED
from bagpipe.texts import duration_seconds

# What is demanded of a figure, or of what it is judged on, makes it no other figure.
_DEMANDED = frozenset({
    "min", "max", "min_coverage", "share", "max_distance", "max_yaw_error", "min_distance",
    "min_time_to_collision", "max_cpu", "max_memory", "any_frame",
})  # fmt: skip
_DURATIONS = frozenset({"stamp_tolerance", "max_age"})
# What one of several figures of a kind, by its unit, does not depend on.
_ELSEWHERE = {
    ("finalPose", "m"): {"yaw"},
    ("finalPose", "rad"): {"position"},
    ("separation", "m"): {"radius"},
}

# The rate at which bag time is real time.
_REAL_TIME = "1"
_CPU = "CPUs"


def marked(finding: Finding, criterion: Criterion, rate: float, *, paced: bool) -> Finding:
    """The finding with the marks of its figures, in a play of that rate."""
    figures = (
        replace(each, measures=mark_of(criterion, each.unit, rate, paced=paced))
        for each in finding.figures
    )
    mark = mark_of(criterion, finding.unit, rate, paced=paced)
    return replace(finding, measures=mark, figures=tuple(figures))


def mark_of(criterion: Criterion, unit: str, rate: float, *, paced: bool = True) -> str:
    """Equal for criteria whose figure of that unit is of the same, whatever they demand.

    That of a latency in a slow play begins with SLOWED: no release before had it in real time.
    Empty for a user's own evaluator: what it measures is not known, and its ConfigMap may have
    another name in each version. With `paced` false bag time ran ahead of the stack.
    """
    if criterion.latency is not None and rate < 1:
        return f"{SLOWED}{rate:g}-{_mark(criterion, unit, _REAL_TIME)}"
    if _of_worst_gap(criterion) and not paced:
        return _mark(criterion, unit, "stamps")
    return earlier_mark_of(criterion, unit, "realtime" if paced else "max", rate)


def earlier_mark_of(criterion: Criterion, unit: str, mode: str, rate: float) -> str:
    """That of a figure of a release which wrote none: it had every latency in bag time, so many
    times that in real time, or in another mode that of an input; and the worst gap by receipt.
    """
    pace = _REAL_TIME
    if criterion.latency is not None:
        pace = f"{rate:g}" if mode == "realtime" else mode
    elif criterion.resources is not None and unit == _CPU:
        # Per second on the wall, in which more or less is played; lock-step has no rate.
        pace = {"max": mode, "realtime": f"{rate:g}"}.get(mode, _REAL_TIME)
    elif _of_worst_gap(criterion) and mode == "max":
        pace = mode
    return _mark(criterion, unit, pace)


def _of_worst_gap(criterion: Criterion) -> bool:
    return criterion.rate is not None and criterion.rate.over == "worst"


def _mark(criterion: Criterion, unit: str, pace: str) -> str:
    if criterion.own is not None:
        return ""
    measurement = criterion.measurement
    # Without defaults, so that a field of a later release makes no figure another one.
    given = measurement.model_dump(exclude=_left_out(criterion, unit), exclude_defaults=True)
    for name in _DURATIONS & type(measurement).model_fields.keys():
        seconds = duration_seconds(getattr(measurement, name))
        if seconds != duration_seconds(type(measurement).model_fields[name].default):
            given[name] = seconds
    paced = [] if pace == _REAL_TIME else [pace]
    text = json.dumps([criterion.kind, given, *paced], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _left_out(criterion: Criterion, unit: str) -> set[str]:
    """Names of fields that make the figure of that unit no other one."""
    names = {*_DEMANDED, *_DURATIONS, *_ELSEWHERE.get((criterion.kind, unit), ())}
    error = criterion.error
    # Both are so as well where nothing is written.
    if error is not None and error.truth_fields == error.fields:
        names.add("truth_fields")
    if error is not None and error.recording and error.truth == error.topic:
        names.add("truth")
    return names
