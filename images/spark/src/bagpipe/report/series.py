"""Courses of criteria as the page draws them: checked, since rows may be anybody's. Pure."""

from collections.abc import Mapping
from itertools import chain
from math import isfinite
from typing import Any

from bagpipe.moments import moment_of
from bagpipe.row_facts import is_finite

Row = Mapping[str, Any]

# As evaluate/courses.py writes them, and CRDs allow; another release may have written more.
_MOST_POINTS = 400
_MOST_CRITERIA = 100
_MOST_ODD = 20
_MOST_PATHS = 2
_CHARACTERS = 200


def series_of(row: Row) -> list[dict[str, Any]]:
    """One map for each criterion of a row that has a course, those that did not pass first.

    `criterion`, `outcome`, `label`, `unit`, `low`, `high`, `step`, `points` of [seconds, value],
    `odd` and `moment` (seconds or None), of finite numbers alone.
    """
    findings = sorted(row.get("criteria") or [], key=lambda each: each["outcome"] == "passed")
    drawn = [_drawn(finding) for finding in findings[:_MOST_CRITERIA]]
    return [each for each in drawn if each is not None]


def _drawn(finding: Mapping[str, Any]) -> dict[str, Any] | None:
    course = finding.get("course")
    if not isinstance(course, Mapping):
        return None
    points, odd = course.get("points"), course.get("odd")
    clean = {
        "points": _points(points),
        "odd": [seconds for seconds in _list(odd) if is_finite(seconds)][:_MOST_ODD],
        "low": course.get("low") if is_finite(course.get("low")) else None,
        "high": course.get("high") if is_finite(course.get("high")) else None,
    }
    return {
        "criterion": str(finding["name"])[:_CHARACTERS],
        "outcome": str(finding["outcome"]),
        "label": str(course.get("label") or "")[:_CHARACTERS],
        "unit": str(course.get("unit") or "")[:_CHARACTERS],
        "step": bool(course.get("step")),
        "moment": moment_of({**finding, "course": clean}),
        **clean,
    } | _plane(course.get("plane"))


def _plane(plane: Any) -> dict[str, Any]:
    """`plane`: `paths` of `name` and `points` of [seconds, x, y], and `goal` of [x, y, radius]."""
    if not isinstance(plane, Mapping):
        return {}
    paths = [
        {
            "name": str(path.get("name") or "")[:_CHARACTERS],
            "points": _points(path.get("points"), 3),
        }
        for path in _list(plane.get("paths"))[:_MOST_PATHS]
        if isinstance(path, Mapping)
    ]
    found = plane.get("goal")
    goal = found if isinstance(found, list) and _is_point(found, 3) and found[2] >= 0 else None
    return {"plane": {"paths": paths, "goal": goal}} if paths else {}


def _points(points: Any, length: int = 2) -> list[list[float]]:
    """Those that are so many finite numbers, 400 at most."""
    found = _list(points)
    if not _are_all_points(found, length):
        found = [point for point in found if _is_point(point, length)]
    return found[:_MOST_POINTS]


def _are_all_points(found: list[Any], length: int) -> bool:
    """Whether all are points, without a call of Python for each: 20,000 cases have millions."""
    if set(map(type, found)) != {list} or set(map(len, found)) != {length}:
        return False
    values = list(chain.from_iterable(found))
    try:
        return set(map(type, values)) <= {float, int} and all(map(isfinite, values))
    except OverflowError:  # an integer that no float has
        return False


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _is_point(point: Any, length: int = 2) -> bool:
    return isinstance(point, list) and len(point) == length and all(map(is_finite, point))
