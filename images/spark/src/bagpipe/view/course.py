"""Courses of criteria and their messages as channels of JSON, which viewers plot and list."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from bagpipe.moments import Moment, bounds_of, points_of

CRITERIA = "/bagpipe/criteria"
LOG = "/bagpipe/log"
_ERROR = 4
_NUMBERS = ("value", "low", "high")
_VALUE = {"type": "object", "properties": {name: {"type": "number"} for name in _NUMBERS}}
_LOG = {
    "type": "object",
    "properties": {
        "timestamp": {
            "type": "object",
            "title": "time",
            "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
        },
        "level": {"type": "integer"},
        "message": {"type": "string"},
        "name": {"type": "string"},
        "file": {"type": "string"},
        "line": {"type": "integer"},
    },
}


@dataclass(frozen=True)
class Schema:
    """A JSON schema by its name."""

    name: str
    text: str


VALUE = Schema("bagpipe.Criterion", json.dumps(_VALUE))
# Viewers show messages of this name as a log (Foxglove's schema of that name).
MESSAGE = Schema("foxglove.Log", json.dumps(_LOG))


@dataclass(frozen=True)
class Note:
    """A message of ours: its topic, schema, time in ns and JSON."""

    topic: str
    schema: Schema
    time: int
    data: bytes


def topics_of(criteria: Iterable[str]) -> Iterator[str]:
    """Where each criterion's course is: its name with what a topic's name can't have as _.

    Of names that would be the same then the later ones end in a number.
    """
    taken: set[str] = set()
    many: Counter[str] = Counter()
    for name in criteria:
        plain = "".join(each if each.isascii() and each.isalnum() else "_" for each in name)
        chosen = plain
        while chosen in taken:
            many[plain] += 1
            chosen = f"{plain}_{many[plain] + 1}"
        taken.add(chosen)
        yield f"{CRITERIA}/{chosen}"


def notes(row: dict[str, Any], moments: Iterable[Moment], start: int) -> Iterator[Note]:
    """What Bagpipe found in a case, with the `moments` of its row, from the window's `start` in ns;
    by topic, then time.
    """
    findings = row.get("criteria") or []
    topics = topics_of(finding["name"] for finding in findings)
    for finding, topic in zip(findings, topics, strict=True):
        course = finding.get("course") or {"points": ()}
        known = {name: bound for name, bound in bounds_of(course).items() if bound is not None}
        for seconds, value in points_of(course):
            text = json.dumps({"value": value} | known)
            yield Note(topic, VALUE, time_at(start, seconds), text.encode())
    for moment in moments:
        time = time_at(start, moment.seconds)
        stamp = {"sec": time // 1_000_000_000, "nsec": time % 1_000_000_000}
        text = json.dumps(
            {"timestamp": stamp, "level": _ERROR, "message": moment.what, "name": "bagpipe"}
            | {"file": "", "line": 0}
        )
        yield Note(LOG, MESSAGE, time, text.encode())


def time_at(start: int, seconds: float) -> int:
    """A time of a course, in ns, of a window that starts at `start` ns."""
    return start + round(seconds * 1e9)
