"""Writes the tables of docs/concepts/liars.md from the table of the tests.

.venv/bin/python -m tests.liars.page           write them
.venv/bin/python -m tests.liars.page --check   say whether they are up to date
"""

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from docs.site.generated import keep
from tests.liars.jobs import CRITERIA, Question
from tests.liars.row import Row
from tests.liars.table import HONEST, LIARS

PAGE = Path(__file__).parents[2] / "docs/concepts/liars.md"
MARK = "<!-- From here on written by tests/liars/page.py; do not edit. -->"
MODES = {
    "live": "realtime",
    "stepped": "lockstep",
    "steady": "lockstep",
    "simulated": "lockstep, simulated time",
    "in-vain": "lockstep, simulated time",
    "simulated-live": "realtime, simulated time",
    "stamped": "lockstep, by stamp",
    "fast": "max",
    "old": "max",
    "tolerant": "realtime, `faultPolicy` allows it",
    "leaving": "realtime, `faultPolicy` allows the command to end",
    "programs": "the exec engine",
}


def page() -> str:
    """The whole page: its text as it is, and the tables as they should be."""
    head, mark, _ = PAGE.read_text().partition(MARK)
    if not mark:
        raise ValueError(f"{PAGE} has lost its line {MARK}")
    return head + "\n".join([MARK, "", *_parts()]) + "\n"


def _parts() -> Iterator[str]:
    yield f"## The {len(LIARS)} that lie"
    for name in dict.fromkeys(row.of for row in LIARS):
        yield from ["", f"### {name[0].upper()}{name[1:]}", ""]
        yield from ["| what the stack does | asked | outcome |", "|---|---|---|"]
        yield from _lines(row for row in LIARS if row.of == name)
    yield from ["", f"## The {len(HONEST)} that only look as if they did", ""]
    yield "Each of these passes."
    yield from ["", "| what the stack does | asked |", "|---|---|"]
    for row in HONEST:
        yield f"| {row.does} | {_asked(row.asked)} |"


def _lines(rows: Iterable[Row]) -> Iterator[str]:
    for row in rows:
        outcome = " or ".join(f"`{word}`" for word in row.outcome.split("|"))
        reason = f", {row.reason}" if row.reason else ""
        yield f"| {row.does} | {_asked(row.asked)} | {outcome}{reason} |"


def _asked(question: Question) -> str:
    mode = MODES[question.job.name.removeprefix("ros2-")]
    if not question.criterion:
        return mode
    kind, fields = next(
        (kind, fields)
        for kind, fields in CRITERIA[question.criterion].items()
        if isinstance(fields, dict)
    )
    shown = {key: value for key, value in fields.items() if key in SHOWN.get(kind, ())}
    bounds = ", ".join(f"{key}: {value}" for key, value in shown.items())
    expected = " with `expectFailure`" if "expectFailure" in CRITERIA[question.criterion] else ""
    return (f"`{kind} {{{bounds}}}`" if bounds else f"`{kind}`") + f"{expected}, {mode}"


# Of each kind, the fields that distinguish its criteria.
SHOWN = {
    "presence": ("min", "max"),
    "rate": ("min",),
    "latency": ("max",),
    "error": ("metric", "max"),
    "bounds": ("min", "max"),
    "expression": ("holds",),
    "resources": ("maxMemory",),
    "separation": ("minDistance",),
}


def main(arguments: list[str]) -> int:
    return keep(PAGE, page(), "tests.liars.page", arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
