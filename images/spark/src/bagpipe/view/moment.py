"""When in a case something went wrong, as far as its row knows."""

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

    Criteria that count something over the whole window have no such time.
    """
    found = []
    for finding in row.get("criteria") or []:
        course = finding.get("course")
        if finding.get("outcome") != "failed" or not course:
            continue
        outside = next(_outside(course), None)
        if outside is not None:
            found.append(Moment(outside, f"{finding['name']}: {finding['message']}"))
    return sorted(found, key=lambda moment: moment.seconds)


def _outside(course: dict[str, Any]) -> Iterator[float]:
    low, high = course.get("low"), course.get("high")
    for seconds, value in course["points"]:
        if (low is not None and value < low) or (high is not None and value > high):
            yield seconds
