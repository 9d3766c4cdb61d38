"""All cases of a job as columns, small enough for one page: 10,000 cases take 1 or 2 MB.

Words that repeat (variants, reasons, messages) stand once and are numbered.
"""

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from bagpipe.row_facts import discarded_runs, figures_of, is_finite, quarantine_words

Row = Mapping[str, Any]

# More lines than this make no page that a browser likes; those that did not pass come first.
MOST_CASES = 20_000
# Figures of all criteria and cases together; about 8 bytes each.
_MOST_FIGURES = 300_000
# Those of the parts of a case, of all cases together.
_MOST_SECONDS = 200_000
_MOST_TIMINGS = 20
_LEDGER = ("sent", "received", "dropped")
_MESSAGE_CHARACTERS = 300
# Figures of one criterion; an own evaluator may give another unit in each case.
_MOST_UNITS = 4
_ALL_MESSAGES_CHARACTERS = 1_000_000
_WORDS = ("fragment", "reason", "message", "seed", "round", "discarded", "quarantine")
_LETTERS = {"passed": "P", "failed": "F", "invalid": "I"}

_NUMBER = r"(-?[0-9.]+(?:e[-+]?[0-9]+)?)"
_LIMITS = [
    (re.compile(rf"at least {_NUMBER}\b.*"), (1, None)),
    (re.compile(rf"at most {_NUMBER}\b.*"), (None, 1)),
    (re.compile(rf"{_NUMBER} to {_NUMBER}\b.*"), (1, 2)),
]


class Words:
    """A column of words, each kept once; those that are given first come first."""

    def __init__(self, first: Iterable[Any] = ()) -> None:
        self._numbers: dict[str, int] = {}
        self._words: list[Any] = []
        self.at: list[int] = []
        for word in first:
            self._number(word)

    def add(self, word: Any) -> None:
        """The next case's word: a text or a number, which may be JSON's."""
        self.at.append(self._number(word))

    def _number(self, word: Any) -> int:
        key = json.dumps(word, sort_keys=True)
        if key not in self._numbers:
            self._numbers[key] = len(self._words)
            self._words.append(word)
        return self._numbers[key]

    def as_json(self) -> dict[str, Any]:
        """`values`, and for each case the number of its own."""
        return {"values": self._words, "at": self.at}


def short(figure: Any, digits: int = 5) -> int | float | None:
    """A figure with so many digits; None where there is none that is finite."""
    if not is_finite(figure):
        return None
    shown = float(f"{figure:.{digits}g}")
    return int(shown) if isinstance(figure, int) else shown


def limits_of(text: str) -> tuple[float | None, float | None]:
    """The bounds in a finding's `limit`, as evaluate/limits.py writes them."""
    for pattern, (least, most) in _LIMITS:
        found = pattern.fullmatch(text)
        if found:
            return (float(found[least]) if least else None, float(found[most]) if most else None)
    return None, None


class Columns:
    """Takes rows one by one; its memory is some hundred bytes for each that it keeps."""

    def __init__(self, variants: Iterable[str] = (), most_cases: int = MOST_CASES) -> None:
        self._variants = list(variants)
        self._most = most_cases
        self._passed: list[Row] = []
        self._others: list[Row] = []
        self.counted = 0

    def add(self, row: Row) -> None:
        """One case; `counted` has all of them, also those that are not kept."""
        self.counted += 1
        kept = self._passed if row["outcome"] == "passed" else self._others
        if len(kept) < self._most:
            kept.append(_slim(row))

    def rows(self) -> list[Row]:
        """The rows of the page in the order of their names: first of all what did not pass."""
        left = max(0, self._most - len(self._others))
        return sorted(self._others + self._passed[:left], key=lambda row: str(row["case"]))

    def as_json(self) -> dict[str, Any]:
        """`cases`, `variables` and `criteria`, as report/page reads them."""
        rows = self.rows()
        columns = {name: Words() for name in _WORDS}
        columns["variant"] = Words(self._variants)
        budget = _ALL_MESSAGES_CHARACTERS
        for row in rows:
            for name, words in columns.items():
                word = row.get(name)
                if name == "message":
                    word = str(word or "")[: min(_MESSAGE_CHARACTERS, max(0, budget))]
                    budget -= len(word)
                words.add(word if word is not None else "")
        return {
            "counted": self.counted,
            "cases": {
                "case": [str(row["case"]) for row in rows],
                "outcome": "".join(_LETTERS.get(row["outcome"], "E") for row in rows),
                "seconds": [short(row.get("seconds")) for row in rows],
                "attempts": [int(row.get("attempts") or 0) for row in rows],
                **{name: [row[name] for row in rows] for name in _LEDGER},
                **{name: words.as_json() for name, words in columns.items()},
            },
            "timings": _timings(rows),
            "variables": _variables(rows),
            "criteria": _criteria(rows),
        }


def _slim(row: Row) -> dict[str, Any]:
    kept = (
        "case", "fragment", "variant", "scenario", "values", "seed", "round", "outcome", "reason",
        "message", "attempts", "seconds",
    )  # fmt: skip
    slim = {name: row.get(name) for name in kept}
    reasons = Counter(run["reason"] for run in discarded_runs(row))
    slim["discarded"] = ", ".join(f"{count} x {reason}" for reason, count in reasons.items())
    slim["quarantine"] = quarantine_words(row)
    result = row.get("result") or {}
    ledger = result.get("ledger") or {}
    slim |= {name: short(ledger.get(name), 12) for name in _LEDGER}
    timings = list((result.get("timings") or {}).items())[:_MOST_TIMINGS]
    slim["timings"] = {str(name): short(seconds, 3) for name, seconds in timings}
    slim["criteria"] = [
        {key: finding.get(key) for key in ("name", "kind", "outcome")}
        | {"figures": [_slim_figure(each) for each in figures_of(finding)[:_MOST_UNITS]]}
        for finding in row.get("criteria") or []
    ]
    return slim


def _slim_figure(figure: Mapping[str, Any]) -> dict[str, Any]:
    return {key: figure.get(key) for key in ("figure", "unit", "limit")}


def _timings(rows: list[Row]) -> dict[str, list[float | None]]:
    """Seconds of each part of every case; of some parts where all together would be too many."""
    names = list(dict.fromkeys(name for row in rows for name in row["timings"]))
    room = max(1, _MOST_SECONDS // max(1, len(rows)))
    return {name: [row["timings"].get(name) for row in rows] for name in names[:room]}


def _variables(rows: list[Row]) -> list[dict[str, Any]]:
    """The matrix' variables; their values in the order of the scenarios, as the job has them."""
    by_scenario = sorted(rows, key=lambda row: row.get("scenario") or 0)
    names = dict.fromkeys(name for row in rows for name in row.get("values") or {})
    found = []
    for name in names:
        words = Words((row.get("values") or {}).get(name) for row in by_scenario)
        for row in rows:
            words.add((row.get("values") or {}).get(name))
        found.append({"name": name, **words.as_json()})
    return found


def _criteria(rows: list[Row]) -> list[dict[str, Any]]:
    """One map per criterion, with its first figure and `others` of other units; figures are left
    out where all together would be too many.
    """
    found: dict[str, dict[str, Any]] = {}
    for at, row in enumerate(rows):
        for finding in row["criteria"]:
            criterion = found.setdefault(finding["name"], _empty(finding, len(rows)))
            criterion["outcomes"][at] = _LETTERS.get(finding["outcome"], "I")
            for figure in finding["figures"]:
                _put(criterion["figures"], at, figure, len(rows))
    room = _MOST_FIGURES
    criteria = []
    for criterion in found.values():
        first, *others = criterion.pop("figures").values() or [_no_figures("", len(rows))]
        for series in (first, *others):
            series["low"], series["high"] = limits_of(series["limit"])
            room -= len(rows)
            if room < 0:
                series["figures"] = None
        outcomes = "".join(criterion["outcomes"])
        criteria.append({**criterion, "outcomes": outcomes, **first, "others": others})
    return criteria


def _put(series: dict[str, dict[str, Any]], at: int, figure: Mapping[str, Any], cases: int) -> None:
    """A case's figure among those of its unit. One that was not measured may have none."""
    unit, limit = str(figure["unit"] or ""), str(figure["limit"] or "")
    if not (unit or limit) and figure["figure"] is None:
        return
    if unit not in series and len(series) < _MOST_UNITS:
        series[unit] = _no_figures(unit, cases)
    if unit in series:
        series[unit]["limit"] = series[unit]["limit"] or limit
        series[unit]["figures"][at] = short(figure["figure"])


def _no_figures(unit: str, cases: int) -> dict[str, Any]:
    return {"unit": unit, "limit": "", "figures": [None] * cases}


def _empty(finding: Mapping[str, Any], cases: int) -> dict[str, Any]:
    return {
        "name": finding["name"],
        "kind": finding["kind"],
        "outcomes": ["-"] * cases,
        "figures": {},
    }
