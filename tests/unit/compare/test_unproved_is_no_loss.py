"""What nobody counts is no loss that was measured: a job that allows it is not made red by it."""

import json
from pathlib import Path
from typing import Any

from bagpipe.compare.compare import compare
from bagpipe.compare.delivery import LOSS, delivery, left_out
from bagpipe.driver.baseline import baseline_rows
from bagpipe.storage import Storage


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


def test_a_baseline_of_which_nothing_is_known_lost_nothing_either(tmp_path: Path) -> None:
    earlier = [row(n, "", "sent", 0) for n in range(12)]
    now = [row(n, "", "called", 30) for n in range(12)]
    (tmp_path / "results.jsonl").write_text("".join(json.dumps(each) + "\n" for each in earlier))
    (found,) = compare(now, [], baseline_rows(tmp_path.as_uri(), Storage({})))
    assert found.verdict == "same", found.message


def test_a_case_that_fails_for_another_s_loss_has_no_loss_of_what_nobody_counts() -> None:
    """Nothing is `allowed` in it: a loss that is known goes before one that is only possible."""

    def both(number: int, variant: str, strength: str, received: int) -> dict[str, Any]:
        found = row(number, variant, strength, received)
        (topic,) = found["result"]["ledger"]["topics"]
        if strength == "sent":
            topic["subscribers"][0]["proved"] = False
        lost = {"node": "/a", "received": 99, "dropped": 1, "strength": "called"}
        topic["subscribers"].append(lost)
        return found | {"outcome": "failed", "reason": "MessagesLost", "allowed": []}

    rows = [both(n, "released", "called", 100) for n in range(12)]
    rows += [both(n, "static", "sent", 0) for n in range(12)]
    (found,) = compare(rows, ["released", "static"])
    assert found.verdict == "same", found.message
    # Of two versions in which the same node is not counted the others are compared.
    rows = [both(n, variant, "sent", 0) for variant in ("released", "static") for n in range(12)]
    for each in rows[12:]:
        each["result"]["ledger"]["topics"][0]["subscribers"][1] |= {"received": 90, "dropped": 10}
    (found,) = compare(rows, ["released", "static"])
    assert found.verdict == "worse", found.message
    # Nor is a share of what one node lost compared with one of what two did.
    rows = [both(n, "released", "called", 100) for n in range(12)] + rows[12:]
    (found,) = compare(rows, ["released", "static"])
    assert [each.name for each in found.criteria if each.pairs and each.variant] == []


def test_many_nodes_that_nobody_counts_are_some_names_and_a_number() -> None:
    lines = [{"node": f"/n{n}", "received": 0, "strength": "sent", "proved": False}
             for n in range(5)]  # fmt: skip
    ledger = {"topics": [{"topic": "/scan", "sent": 9, "subscribers": lines}]}
    assert left_out({"result": {"ledger": ledger}}) == "without /n0, /n1, /n2 and 2 more"
    assert LOSS not in delivery({"result": {"ledger": ledger}})


def test_a_node_of_ros_1_that_does_not_answer_has_lost_what_it_was_sent() -> None:
    assert delivery(row(0, "", "sent", 0) | {"allowed": []})[LOSS] == 100.0
