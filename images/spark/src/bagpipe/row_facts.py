"""What is read off a row of results, each fact in one place for all who tell it. Pure."""

from collections.abc import Mapping
from typing import Any

Row = Mapping[str, Any]

OUTCOMES = ("passed", "failed", "invalid", "errored")
# Reasons by which the stack, or a part of it, ended or began anew where it should not have.
CRASHES = frozenset({"StackCrashed", "StackExited", "NodeGone", "NodeRespawned"})
LOSSES = frozenset({"MessagesLost"})
# What a job counts of its rows, beside how many were planned and are running.
TALLIES = (*OUTCOMES, "crashed", "lost", "discarded")


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
    """A discarded run in one line, for all who tell it."""
    seconds = run.get("seconds")
    after = f" after {seconds:.1f} s" if isinstance(seconds, int | float) else ""
    message = f": {run['message']}" if run.get("message") else ""
    return f"{run['reason']}{after}{message}"


def discarded_count(row: Row) -> int:
    """How many runs do not count: tries of its last start, and starts before that one."""
    return max(0, int(row["attempts"]) - 1) + max(0, int(row.get("starts", 1)) - 1)


def tally(row: Row) -> dict[str, int]:
    """What the row adds to the job's counts."""
    reason = row.get("reason")
    return {
        str(row["outcome"]): 1,
        "crashed": int(reason in CRASHES),
        "lost": int(reason in LOSSES),
        "discarded": discarded_count(row),
    }


def counts_of(manifest: Mapping[str, Any]) -> dict[str, int]:
    """A manifest's counts with all that a job counts today; an earlier one said `retried`."""
    counts = dict(manifest["counts"])
    earlier = counts.pop("retried", 0)
    return dict.fromkeys((*TALLIES, "regressed"), 0) | {"discarded": earlier} | counts
