"""What was lost on the way to a result, as figures: beside the criteria, compared as they are.

A criterion's name has no colon, so none can be taken for one of these.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from bagpipe.row_facts import discarded_runs, discarded_tries

Row = Mapping[str, Any]

LOSS = "delivery: loss"
DISCARDED = "delivery: discarded runs"
# Unit, and the direction that is better.
FIGURES = {LOSS: ("%", "lower"), DISCARDED: ("runs", "lower")}
# Strengths of a ledger's line that say nothing of what a node took.
_UNCOUNTED = frozenset({"sent", "received"})


def delivery(row: Row) -> dict[str, float]:
    """The share of messages that did not arrive, in all runs of the case, and tries thrown away.

    The tries that were thrown away count: what is lossy in nine of ten is not lossless. Starts that
    were lost with their executor don't: a version is not worse for nodes that were drained. Where
    the job allows that delivery is not proved, nothing is measured of a node that nobody counts.
    """
    uncounted = _UNCOUNTED if _allows_unproved(row) else frozenset()
    found = {DISCARDED: float(discarded_tries(row))}
    sent = lost = 0
    for ledger in _ledgers(row):
        for topic in ledger.get("topics") or []:
            for node in topic.get("subscribers") or []:
                if node.get("strength") in uncounted:
                    continue
                sent += int(topic["sent"])
                missing = int(topic["sent"]) - int(node["received"])
                # An earlier job's results are a file that people may edit.
                lost += max(missing, int(node.get("dropped") or 0), 0)
    if sent:
        found[LOSS] = 100 * min(1.0, lost / sent)
    return found


def _allows_unproved(row: Row) -> bool:
    return any(each.get("cause") == "DeliveryUnproved" for each in row.get("allowed") or [])


def _ledgers(row: Row) -> Iterator[Mapping[str, Any]]:
    """Those of the run that counts, of a case that was given up, and of what was discarded."""
    for run in (row.get("result"), row.get("evidence"), *discarded_runs(row)):
        if run and run.get("ledger"):
            yield run["ledger"]
