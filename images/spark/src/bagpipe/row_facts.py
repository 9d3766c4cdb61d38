"""What is read off a row of results, each fact in one place for all who report it. Pure."""

import json
import math
from collections.abc import Mapping, Set
from typing import Any

Row = Mapping[str, Any]
Key = tuple[str, str, int]

OUTCOMES = ("passed", "failed", "invalid", "errored")
# Of two runs of one case the worse one counts; an errored one says nothing of the stack, and less
# than one that passed.
_BADNESS = {"failed": 2, "invalid": 1, "passed": 0, "errored": -1}
# Reasons by which the stack, or a part of it, ended or restarted where it should not have.
CRASHES = frozenset(
    {"StackCrashed", "StackExited", "StackOutOfMemory", "NodeGone", "NodeRespawned"}
)
LOSSES = frozenset({"MessagesLost"})
# Of a case that had no input: it says nothing of any version.
NOTHING_PLAYED = "NothingPlayed"
# What the mark of a figure begins with that was measured in real time in a slow play.
SLOWED = "slowed-"
# What a job counts of its rows, beside how many were planned and are running.
TALLIES = (*OUTCOMES, "crashed", "lost", "discarded", "quarantined")


def badness(row: Row) -> int:
    """How much a row says against the stack: of two rows of one case the greater one counts."""
    return _BADNESS.get(str(row["outcome"]), -1)


def is_finite(number: Any) -> bool:
    """Whether it is a number that a page can show: rows may be anybody's."""
    if type(number) is float:  # as nearly all are, of millions
        return math.isfinite(number)
    if isinstance(number, bool) or not isinstance(number, int | float):
        return False
    try:
        return math.isfinite(number)
    except OverflowError:  # an integer that no float has
        return False


def figures_of(finding: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """What a criterion measured: `figure`, `unit`, `limit` and `direction` for each of its bounds.

    Rows of before there were `figures` have the one that decided.
    """
    figures = finding.get("figures")
    several = [each for each in figures if isinstance(each, Mapping)] if figures else []
    return several or [finding]


def of_other_measures(before: Set[str], after: Set[str]) -> bool:
    """Whether figures with these marks (`measures`) are known to be of something else.

    Releases before had no mark, and latencies of slow plays in bag time.
    """
    if not before or not after:  # where nothing was measured, nothing else was
        return False
    if any(mark.startswith(SLOWED) for mark in before | after):
        return before != after
    known = before - {""}, after - {""}
    return all(known) and known[0] != known[1]


def discarded_runs(row: Row) -> list[dict[str, Any]]:
    """The runs that do not count, in order: `reason`, `message` and `seconds` of each.

    Rows of before faultPolicy hold reasons alone.
    """
    runs = row.get("discarded") or []
    return [
        {"message": "", "seconds": None} | ({"reason": run} if isinstance(run, str) else dict(run))
        for run in runs
    ]


def run_words(run: Mapping[str, Any]) -> str:
    """A discarded run in one line, for all who report it."""
    seconds = run.get("seconds")
    after = f" after {seconds:.1f} s" if is_finite(seconds) else ""
    message = f": {run['message']}" if run.get("message") else ""
    return f"{run['reason']}{after}{message}"


def discarded_of(row: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A row's discarded runs in short, as manifests and tables have them, without their ledgers."""
    return [
        {"reason": run["reason"], "message": str(run["message"])[:300], "seconds": run["seconds"]}
        for run in discarded_runs(row)
    ]


def discarded_count(row: Row) -> int:
    """How many runs do not count: tries of its last start, and starts before that one."""
    return discarded_tries(row) + further_starts(row)


def discarded_tries(row: Row) -> int:
    """How many tries of its last start do not count."""
    return max(0, int(row.get("attempts") or 1) - 1)


def further_starts(row: Row) -> int:
    """How often it was started again: an executor was lost or had to go, or it was slow."""
    starts = row.get("starts")
    return max(0, (1 if starts is None else int(starts)) - 1)


def quarantine_of(row: Row) -> Mapping[str, Any] | None:
    """The rule by which the row's case is in quarantine: `cases`, `reason`, `until`."""
    found = row.get("quarantine")
    return found if isinstance(found, Mapping) else None


def quarantine_words(row: Row) -> str:
    """Until when and why the row's case is in quarantine; empty where it is not."""
    rule = quarantine_of(row)
    return f"in quarantine until {rule.get('until')}: {rule.get('reason')}" if rule else ""


def tally(row: Row) -> dict[str, int]:
    """What the row adds to the job's counts."""
    reason = row.get("reason")
    return {
        str(row["outcome"]): 1,
        "crashed": int(reason in CRASHES),
        "lost": int(reason in LOSSES),
        "discarded": discarded_count(row),
        "quarantined": int(quarantine_of(row) is not None and row["outcome"] != "passed"),
    }


# In the order in which a reader wants to know them; crashes and losses are among the others.
_LABELS = (
    ("failed", "failed"), ("regressed", "regressed"), ("crashed", "crashed"),
    ("lost", "lost messages"), ("invalid", "lack evidence"), ("errored", "errored"),
    ("quarantined", "of these in quarantine"),
)  # fmt: skip


def verdict_words(verdict: str, counts: Mapping[str, int]) -> str:
    """The verdict with all that speaks against it, for a page, a table and a terminal alike."""
    counted = [f"{counts[word]:,} {label}" for word, label in _LABELS if counts.get(word)]
    return f"{verdict or 'No verdict'}{': ' if counted else ''}{', '.join(counted)}"


def counts_of(manifest: Mapping[str, Any]) -> dict[str, int]:
    """A manifest's counts with all that a job counts today; an earlier one has `retried`."""
    counts = dict(manifest["counts"])
    earlier = counts.pop("retried", 0)
    return dict.fromkeys((*TALLIES, "regressed"), 0) | {"discarded": earlier} | counts


def key_of(row: Row) -> Key:
    """What makes two rows the same case of two versions; names of jobs and variants are not in it.

    An earlier job's fragments are named after its bags, as this one's are. A number is the same
    value as an integer and as a float: an API server and a matrix of ranges write either.
    """
    values = json.dumps(_of_one_form(row.get("values") or {}), sort_keys=True)
    return (str(row.get("fragment") or row["case"]), values, int(row.get("seed") or 0))


def _of_one_form(value: Any) -> Any:
    """The value with whole numbers as integers."""
    if isinstance(value, Mapping):
        return {name: _of_one_form(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_of_one_form(each) for each in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def pair_of(row: Row) -> str:
    """What makes two rows the same round of the same case of two versions, as one text."""
    return json.dumps([*key_of(row), int(row.get("round") or 0)])


def recorded_names(row: Row) -> list[str]:
    """What a row's case left behind: names below the job's results."""
    recorded = row.get("recorded")
    if recorded is None:
        return []
    return [recorded] if isinstance(recorded, str) else list(recorded)
