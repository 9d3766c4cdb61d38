"""What nobody counts is no loss that was measured: a job that allows it is not made red by it."""

import json
from pathlib import Path
from typing import Any

from bagpipe.compare.compare import compare
from bagpipe.compare.delivery import LOSS, delivery, left_out
from bagpipe.compare.pairing import Versions
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


def test_nodes_that_nobody_counts_are_as_many_of_a_topic_in_any_of_the_runs() -> None:
    lines = [{"node": f"/n{n}", "received": 0, "strength": "sent", "proved": False}
             for n in range(5)]  # fmt: skip
    ledger = {"topics": [{"topic": "/scan", "sent": 9, "subscribers": lines},
                         {"topic": "/map", "sent": 0, "subscribers": lines}]}  # fmt: skip
    assert left_out({"result": {"ledger": ledger}}) == "5 of /scan (sent)"
    runs = {"result": {"ledger": ledger}, "discarded": [{"ledger": ledger}, {"ledger": ledger}]}
    assert left_out(runs) == "5 of /scan (sent)"
    assert LOSS not in delivery({"result": {"ledger": ledger}})


def beside(number: int, variant: str, lost: int, listeners: int = 1) -> dict[str, Any]:
    """The counted /lane loses so many of 100, beside listeners that have a name of this run."""
    found = row(number, variant, "called", 100 - lost)
    (topic,) = found["result"]["ledger"]["topics"]
    for n in range(listeners):
        name = f"/transform_listener_impl_{number}{variant}{n}"
        line = {"node": name, "received": 0, "dropped": 0, "strength": "sent", "proved": False}
        topic["subscribers"].append(line)
    return found | {"allowed": [{"cause": "DeliveryUnproved", "message": "m"}]}


def test_a_loss_is_seen_though_what_nobody_counts_has_another_name_in_each_run() -> None:
    rows = [beside(n, "a", 0) for n in range(12)] + [beside(n, "b", 60) for n in range(12)]
    (found,) = compare(rows, ["a", "b"])
    assert found.verdict == "worse", found.message
    assert "not compared" not in found.message
    # However many rows there are, their figures are those of few series.
    assert len(Versions.read(rows).series) == 3


def test_it_is_named_where_losses_are_not_compared() -> None:
    rows = [beside(n, "a", 0, listeners=1 + (n < 3)) for n in range(12)]
    rows += [beside(n, "b", 60) for n in range(12)]
    (found,) = compare(rows, ["a", "b"])
    assert found.verdict == "worse", found.message
    sentence = "; losses not compared in {}, in which not as many nodes are counted as there"
    assert found.message.endswith(sentence.format("3 cases"))
    # Also where nothing is counted in one of them, and not where nothing was to be counted.
    rows = [row(n, "a", "sent", 0) for n in range(12)] + [
        row(n, "b", "called", 9) for n in range(9)
    ]
    (found,) = compare(rows, ["a", "b"])
    assert sentence.format("9 cases") in found.message
    rows = [row(n, "a", "called", 9) | {"result": None} for n in range(9)] + rows[12:]
    (found,) = compare(rows, ["a", "b"])
    assert "not compared" not in found.message


def test_of_rounds_those_are_compared_that_leave_out_as_many() -> None:
    rows = [beside(n, "a", 0) | {"round": r} for n in range(12) for r in range(2)]
    rows += [beside(n, "b", 90, listeners=2) for n in range(12)]
    rows += [beside(n, "b", 0) | {"round": 1} for n in range(12)]
    (found,) = compare(rows, ["a", "b"])
    assert [each.name for each in found.criteria if each.name == LOSS] == []
    assert found.verdict == "same", found.message


def test_a_node_of_ros_1_that_does_not_answer_has_lost_what_it_was_sent() -> None:
    assert delivery(row(0, "", "sent", 0) | {"allowed": []})[LOSS] == 100.0
