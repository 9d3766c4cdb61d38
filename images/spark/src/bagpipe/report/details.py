"""The cases that a reader will ask about: chosen among those that did not pass, shown in full."""

import itertools
from collections.abc import Collection, Mapping
from typing import Any

from bagpipe.row_facts import discarded_runs, run_words

Row = Mapping[str, Any]

MOST_DETAILS = 50
# Kinds of trouble that are distinguished; what differs beyond that many is not chosen.
_MOST_GROUPS = 50
_STDERR_LINES = 40
_LINE_CHARACTERS = 500
_LEDGER_TOPICS = 50
_LEDGER_NODES = 20
_MOST_COURSES = 8
_MOST_STARTS = 10
_MOST_RUNS = 50


class Details:
    """Keeps some rows of every kind of trouble, so that 50 of one kind do not hide the others."""

    def __init__(self, most: int = MOST_DETAILS, regressed: Collection[str] = ()) -> None:
        self._most = most
        self._regressed = frozenset(regressed)
        self._first: list[Row] = []
        self._groups: dict[tuple[Any, ...], list[Row]] = {}

    def add(self, row: Row) -> None:
        """One case, which may have passed."""
        if row["outcome"] == "passed":
            return
        if row["case"] in self._regressed:
            self._first.append(row)
        key = (row["outcome"], row.get("variant"), row.get("reason"), *_not_passed(row))
        if key not in self._groups and len(self._groups) >= _MOST_GROUPS:
            return
        group = self._groups.setdefault(key, [])
        if len(group) < self._most:
            group.append(row)

    def rows(self) -> list[Row]:
        """The chosen rows: what regressed, then by name the first of every other kind, and so on.

        Of what regressed half of all, so that it does not hide the others.
        """
        first = sorted(self._first, key=lambda row: str(row["case"]))[: self._most // 2]
        named = {row["case"] for row in first}
        turns = itertools.zip_longest(*self._groups.values())
        others = [row for turn in turns for row in turn if row and row["case"] not in named]
        chosen = others[: self._most - len(first)]
        return first + sorted(chosen, key=lambda row: str(row["case"]))


def _not_passed(row: Row) -> list[str]:
    return [f["name"] for f in row.get("criteria") or [] if f["outcome"] != "passed"]


def detail_of(row: Row) -> dict[str, Any]:
    """What the page says of one case beyond its line in the table."""
    result = row.get("result") or {}
    evidence = row.get("evidence") or {}
    stack = result.get("stack") or {}
    ledger = result.get("ledger") or evidence.get("ledger") or {}
    stderr = row.get("stderr") or stack.get("stderr") or []
    return {
        "message": str(row.get("message") or "")[:4000],
        "stderr": [str(line)[:_LINE_CHARACTERS] for line in stderr[-_STDERR_LINES:]],
        "criteria": [
            {
                key: str(finding.get(key) or "")[:1000]
                for key in ("name", "kind", "outcome", "limit", "covered", "message")
            }
            for finding in row.get("criteria") or []
        ],
        "bag": str(row.get("bag") or ""),
        "window": row.get("window"),
        "recorded": row.get("recorded"),
        "ledger": _ledger(ledger),
        "discarded": [
            run_words(run)[:_LINE_CHARACTERS] for run in discarded_runs(row)[:_MOST_RUNS]
        ],
        "strength": str(ledger.get("strength") or ""),
        "machine": _machine(result.get("machine") or evidence.get("machine") or {}),
        "lost": [lost_start(start) for start in (evidence.get("starts") or [])[:_MOST_STARTS]],
        "timings": {
            str(name): seconds
            for name, seconds in (result.get("timings") or {}).items()
            if isinstance(seconds, int | float)
        },
        "series": [
            {"criterion": str(finding["name"])} | finding["course"]
            for finding in row.get("criteria") or []
            if finding.get("course")
        ][:_MOST_COURSES],
    }


def lost_start(start: Mapping[str, Any]) -> str:
    """A line for a start of a case that came to no end."""
    seconds = start.get("seconds")
    after = f" after {seconds:.1f} s" if isinstance(seconds, int | float) else ""
    error = " ".join(str(start.get("error") or "Spark does not say why").split())
    where = f"executor {start.get('executor')} at {start.get('host')}"
    return f"{where}{after}: {error}"[:_LINE_CHARACTERS]


def _machine(machine: Mapping[str, Any]) -> dict[str, Any]:
    """What was measured of the machine while the case played: a sentence, and figures."""
    return {
        "message": str(machine.get("message") or "")[:_LINE_CHARACTERS],
        "figures": {
            name.removesuffix("_seconds").replace("_", " "): figure
            for name, figure in machine.items()
            if name.endswith("_seconds") and isinstance(figure, int | float)
        },
    }


def _ledger(ledger: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One line for each topic and node."""
    return [
        {
            "topic": topic.get("topic"),
            "sent": topic.get("sent"),
            "node": node.get("node", ""),
            "received": node.get("received"),
            "dropped": node.get("dropped"),
            "strength": node.get("strength") or "",
            "queue": node.get("queue"),
        }
        for topic in (ledger.get("topics") or [])[:_LEDGER_TOPICS]
        for node in (topic.get("subscribers") or [{}])[:_LEDGER_NODES]
    ]
