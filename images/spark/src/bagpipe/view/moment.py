"""When in a case something went wrong, as far as its row knows."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Moment:
    """Seconds after the window's start, and what happened then, as a sentence."""

    seconds: float
    what: str


def moments(row: dict[str, Any]) -> list[Moment]:
    """The first time at which each failed criterion left its bounds, ascending.

    Of a final pose it is the last one: the drive begins far from its goal. Criteria that count
    something over the whole window have no such time.
    """
    found = []
    for finding in row.get("criteria") or []:
        course = finding.get("course")
        if finding.get("outcome") != "failed" or not course:
            continue
        points = points_of(course)
        if finding.get("kind") == "finalPose":
            points = points[-1:]
        outside = next(_outside(points, *bounds_of(course).values()), None)
        if outside is not None:
            found.append(Moment(outside, f"{finding['name']}: {finding['message']}"))
    return sorted(found, key=lambda moment: moment.seconds)


def points_of(course: dict[str, Any]) -> list[tuple[float, float]]:
    """A course's seconds and values. Raises ValueError for seconds that are no number."""
    found = []
    for seconds, value in course["points"]:
        if not math.isfinite(seconds):
            raise ValueError(f"a course has a value at {seconds} s")
        # JSON has no others, and viewers draw none.
        if math.isfinite(value):
            found.append((seconds, value))
    return found


def bounds_of(course: dict[str, Any]) -> dict[str, float | None]:
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
