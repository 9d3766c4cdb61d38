"""What nobody counts is no loss that was measured: a job that allows it is not made red by it."""

from typing import Any

from bagpipe.compare.compare import compare


def row(number: int, variant: str, strength: str, received: int) -> dict[str, Any]:
    line = {"node": "/lane", "received": received, "dropped": 100 - received, "strength": strength}
    ledger = {"topics": [{"topic": "/scan", "sent": 100, "subscribers": [line]}]}
    unproved = strength in ("sent", "received")
    return {
        "case": f"d{number}-{variant}",
        "fragment": f"d{number}-0000",
        "variant": variant,
        "values": {},
        "seed": 0,
        "round": 0,
        "bag": f"pvc://r/d{number}.mcap",
        "outcome": "passed",
        "reason": "",
        "criteria": [],
        "attempts": 1,
        "result": {"ledger": ledger},
        "allowed": [{"cause": "DeliveryUnproved", "message": "m"}] if unproved else [],
    }


def test_a_version_whose_node_nobody_counts_is_not_worse_for_that() -> None:
    """The same node, linked statically in the second image (or ROS 1 before, ROS 2 now)."""
    rows = [row(n, "released", "called", 100) for n in range(12)]
    rows += [row(n, "static", "sent", 0) for n in range(12)]
    (found,) = compare(rows, ["released", "static"])
    assert found.verdict != "worse", found.message


def test_a_version_that_loses_most_is_not_better_than_one_of_which_nothing_is_known() -> None:
    rows = [row(n, "static", "sent", 0) for n in range(12)]
    rows += [row(n, "counted", "called", 30) for n in range(12)]
    (found,) = compare(rows, ["static", "counted"])
    assert found.verdict != "better", found.message
