"""history.html: criteria and cases over runs, one page without scripts that needs no network."""

from importlib.resources import files
from typing import Any

from jinja2 import Environment, StrictUndefined

from bagpipe.history.findings import CriterionHistory, History

# Rows of a table of cases; how many more there are stands below it.
_MOST_CASES = 200
_WIDTH, _HEIGHT = 240, 36


def page(history: History, title: str) -> str:
    """The whole page. What names and messages hold is escaped."""
    environment = Environment(autoescape=True, undefined=StrictUndefined)
    template = environment.from_string(
        files("bagpipe.history").joinpath("history.html.j2").read_text("utf-8")
    )
    cases = _cases(history)
    return template.render(
        title=title,
        runs=history.runs,
        criteria=[_row(each, history) for each in history.criteria],
        cases=cases[:_MOST_CASES],
        left_out=max(0, len(cases) - _MOST_CASES),
        flaky=history.flaky,
        quarantined=history.quarantined,
        slowest=history.slowest,
    )


def _row(of: CriterionHistory, history: History) -> dict[str, Any]:
    def day(run: int | None) -> str | None:
        return None if run is None else history.runs[run].ended[:10]

    return {
        "name": of.name,
        "unit": of.unit,
        "nights": of.nights,
        "worse": day(of.worse),
        "moved": day(of.moved),
        "cases": of.cases,
        "curve": _curve([night.median for night in of.nights]),
        "width": _WIDTH,
        "height": _HEIGHT,
    }


def _curve(values: list[float | None]) -> list[str]:
    """Points of polylines in a box of _WIDTH by _HEIGHT; a run without a figure is a gap."""
    known = [value for value in values if value is not None]
    if not known:
        return []
    low, high = min(known), max(known)
    lines: list[list[str]] = [[]]
    for at, value in enumerate(values):
        if value is None:
            lines.append([])
            continue
        across = (at + 0.5) * _WIDTH / len(values)
        up = (value - low) / (high - low) if high > low else 0.5
        lines[-1].append(f"{across:.1f},{_HEIGHT - 3 - up * (_HEIGHT - 6):.1f}")
    return [" ".join(line) for line in lines if line]


def _cases(history: History) -> list[dict[str, Any]]:
    """Cases that did not always pass, those that failed most often first."""
    outcomes: dict[str, list[str]] = {}
    for at, run in enumerate(history.runs):
        for case in run.cases:
            row = outcomes.setdefault(case.name, [""] * len(history.runs))
            row[at] = case.outcome
    odd = [
        {"case": case, "outcomes": row, "failed": sum(each == "failed" for each in row)}
        for case, row in outcomes.items()
        if any(each not in ("", "passed") for each in row)
    ]
    return sorted(odd, key=lambda each: (-each["failed"], each["case"]))
