"""Courses of criteria and their messages as channels of JSON, which viewers plot and list."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from bagpipe.view.moment import moments

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


def topic_of(criterion: str) -> str:
    """Where a criterion's course is: its name with what a topic's name can't have as _."""
    plain = "".join(each if each.isascii() and each.isalnum() else "_" for each in criterion)
    return f"{CRITERIA}/{plain}"


def notes(row: dict[str, Any], start: int) -> Iterator[Note]:
    """What Bagpipe found in a case, from the window's `start` in ns; by topic, then time."""
    for finding in row.get("criteria") or []:
        course = finding.get("course")
        for seconds, value in (course or {"points": ()})["points"]:
            bounds = {
                name: course[name] for name in ("low", "high") if course.get(name) is not None
            }
            text = json.dumps({"value": value, **bounds})
            yield Note(topic_of(finding["name"]), VALUE, _at(start, seconds), text.encode())
    for moment in moments(row):
        time = _at(start, moment.seconds)
        stamp = {"sec": time // 1_000_000_000, "nsec": time % 1_000_000_000}
        text = json.dumps(
            {"timestamp": stamp, "level": _ERROR, "message": moment.what, "name": "bagpipe"}
            | {"file": "", "line": 0}
        )
        yield Note(LOG, MESSAGE, time, text.encode())


def _at(start: int, seconds: float) -> int:
    return start + round(seconds * 1e9)
