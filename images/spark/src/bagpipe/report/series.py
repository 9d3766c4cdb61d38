"""Courses of criteria as the page draws them: checked, since rows may be anybody's. Pure."""

import math
from collections.abc import Mapping
from typing import Any

from bagpipe.moments import moment_of

Row = Mapping[str, Any]

# As evaluate/courses.py writes them, and CRDs allow; another release may have written more.
_MOST_POINTS = 400
_MOST_CRITERIA = 100
_MOST_ODD = 20
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
        "points": [list(point) for point in _list(points) if _is_point(point)][:_MOST_POINTS],
        "odd": [seconds for seconds in _list(odd) if _is_finite(seconds)][:_MOST_ODD],
        "low": course.get("low") if _is_finite(course.get("low")) else None,
        "high": course.get("high") if _is_finite(course.get("high")) else None,
    }
    return {
        "criterion": str(finding["name"])[:_CHARACTERS],
        "outcome": str(finding["outcome"]),
        "label": str(course.get("label") or "")[:_CHARACTERS],
        "unit": str(course.get("unit") or "")[:_CHARACTERS],
        "step": bool(course.get("step")),
        "moment": moment_of({**finding, "course": clean}),
        **clean,
    }


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _is_point(point: Any) -> bool:
    return isinstance(point, list) and len(point) == 2 and all(_is_finite(each) for each in point)


def _is_finite(number: Any) -> bool:
    if isinstance(number, bool) or not isinstance(number, int | float):
        return False
    try:
        return math.isfinite(number)
    except OverflowError:  # an integer that no float has
        return False
