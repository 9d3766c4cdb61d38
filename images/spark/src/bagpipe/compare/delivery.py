"""What was lost on the way to a result, as figures: beside the criteria, compared as they are.

A criterion's name has no colon, so none can be taken for one of these.
"""

import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from bagpipe.row_facts import discarded_runs, discarded_tries

Row = Mapping[str, Any]

LOSS = "delivery: loss"
DISCARDED = "delivery: discarded runs"
# Unit, and the direction that is better.
FIGURES = {LOSS: ("%", "lower"), DISCARDED: ("runs", "lower")}
# Strengths that say nothing of what a node took, in rows of before such lines were marked.
_UNCOUNTED = frozenset({"sent", "received"})


def delivery(row: Row) -> dict[str, float]:
    """The share of messages that did not arrive, in all runs of the case, and tries thrown away.

    The tries that were thrown away count: what is lossy in nine of ten is not lossless. Starts that
    were lost with their executor don't: a version is not worse for nodes that were drained. Of a
    node that nobody counts nothing is measured, whatever became of the case.
    """
    found = {DISCARDED: float(discarded_tries(row))}
    sent = lost = 0
    for topic, node in _lines(row):
        if _is_counted(node, row):
            sent += int(topic["sent"])
            missing = int(topic["sent"]) - int(node["received"])
            # An earlier job's results are a file that people may edit.
            lost += max(missing, int(node.get("dropped") or 0), 0)
    if sent:
        found[LOSS] = 100 * min(1.0, lost / sent)
    return found


def left_out(row: Row) -> str:
    """How many nodes nobody counts, by topic and strength, empty where all are counted: a share of
    what others lost is compared with one that as many are left out of.

    They are not named: a node may have another name in each run, as listeners of tf2 do.
    """
    most: Counter[tuple[str, str]] = Counter()
    for ledger in _ledgers(row):
        most |= Counter(
            (str(topic.get("topic")), str(node.get("strength")))
            for topic, node in _lines_of(ledger)
            if topic["sent"] and not _is_counted(node, row)
        )
    found = (f"{number} of {topic} ({how})" for (topic, how), number in sorted(most.items()))
    return sys.intern(", ".join(found))  # it is the same text in nearly all rows


def _is_counted(node: Mapping[str, Any], row: Row) -> bool:
    if node.get("proved") is False:
        return False
    return node.get("strength") not in _UNCOUNTED or not _allows_unproved(row)


def _allows_unproved(row: Row) -> bool:
    return any(each.get("cause") == "DeliveryUnproved" for each in row.get("allowed") or [])


def _lines(row: Row) -> Iterator[tuple[Mapping[str, Any], Mapping[str, Any]]]:
    """Topics and their subscribers, of all ledgers."""
    for ledger in _ledgers(row):
        yield from _lines_of(ledger)


def _lines_of(ledger: Mapping[str, Any]) -> Iterator[tuple[Mapping[str, Any], Mapping[str, Any]]]:
    for topic in ledger.get("topics") or []:
        for node in topic.get("subscribers") or []:
            yield topic, node


def _ledgers(row: Row) -> Iterator[Mapping[str, Any]]:
    """Those of the run that counts, of a case that was given up, and of what was discarded."""
    for run in (row.get("result"), row.get("evidence"), *discarded_runs(row)):
        if run and run.get("ledger"):
            yield run["ledger"]
