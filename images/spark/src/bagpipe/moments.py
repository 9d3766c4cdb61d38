"""When in a case something went wrong, as far as its row knows. Pure."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Moment:
    """Seconds after the window's start, and what happened then, as a sentence."""

    seconds: float
    what: str


def moments(row: Mapping[str, Any]) -> list[Moment]:
    """The first time at which each failed criterion left its bounds, ascending."""
    found = []
    for finding in row.get("criteria") or []:
        seconds = moment_of(finding)
        if seconds is not None:
            found.append(Moment(seconds, f"{finding['name']}: {finding['message']}"))
    return sorted(found, key=lambda moment: moment.seconds)


def moment_of(finding: Mapping[str, Any]) -> float | None:
    """The first time at which a failed criterion left its bounds, or was no number.

    Of a final pose it is the last one: the drive begins far from its goal. Too few messages have
    no such time, and nothing that is summed over the window has one.
    """
    course = finding.get("course")
    if finding.get("outcome") != "failed" or not course:
        return None
    points, kind = points_of(course), finding.get("kind")
    low, high = bounds_of(course).values()
    if kind == "finalPose":
        points = points[-1:]
    elif kind == "presence":
        low = None
    elif kind == "expression":
        low = 1.0
    odd = [seconds for seconds in course.get("odd") or () if math.isfinite(seconds)]
    return min([*odd, *_outside(points, low, high)], default=None)


def points_of(course: Mapping[str, Any]) -> list[tuple[float, float]]:
    """A course's seconds and values. Raises ValueError for seconds that are no number."""
    found = []
    for seconds, value in course["points"]:
        if not math.isfinite(seconds):
            raise ValueError(f"a course has a value at {seconds} s")
        # JSON has no others, and viewers draw none.
        if math.isfinite(value):
            found.append((seconds, value))
    return found


def bounds_of(course: Mapping[str, Any]) -> dict[str, float | None]:
    """A course's `low` and `high`, None where it has none."""
    bounds = {name: course.get(name) for name in ("low", "high")}
    return {
        name: None if bound is None or not math.isfinite(bound) else bound
        for name, bound in bounds.items()
    }


def _outside(
    points: list[tuple[float, float]], low: float | None, high: float | None
) -> Iterator[float]:
    for seconds, value in points:
        if (low is not None and value < low) or (high is not None and value > high):
            yield seconds
