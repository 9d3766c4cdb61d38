"""A comparison leaves out what is in quarantine now, and names what of it would have regressed."""

from typing import Any

from bagpipe.compare.compare import compare
from bagpipe.compare.gate import objections
from tests.unit.compare.rows import only, row

MARK = {"cases": "*", "reason": "issue 17", "until": "2026-12-31"}


def quarantined(made: dict[str, Any]) -> dict[str, Any]:
    return made | {"quarantine": MARK}


def test_a_case_in_quarantine_regresses_nothing_and_is_named() -> None:
    rows = [row(n, v) for n in range(3) for v in ("released", "pr-812")]
    rows[3] = quarantined(row(1, "pr-812", "failed"))
    found = only(rows)
    assert (found.verdict, found.regressed, found.missing) == ("same", [], [])
    assert found.quarantined == [{"case": "a-0001-pr-812", "to": "failed", "reason": "Bad"}]
    assert (found.counts["regressed"], found.counts["quarantined"], found.counts["same"]) == (
        0, 1, 2,
    )  # fmt: skip
    assert found.message == "no case changed of 2 cases; 1 worse in quarantine"
    assert objections(found.as_json()) == []


def test_others_regress_beside_it() -> None:
    rows = [row(n, v) for n in range(2) for v in ("released", "pr-812")]
    rows[1] = quarantined(row(0, "pr-812", "failed"))
    rows[3] = row(1, "pr-812", "failed")
    found = only(rows)
    assert [case["case"] for case in found.regressed] == ["a-0001-pr-812"]
    assert [each.cause for each in objections(found.as_json())] == ["Regressed"]


def test_its_figures_make_no_criterion_worse() -> None:
    rows = [row(n, v, figure=1.0) for n in range(12) for v in ("released", "pr-812")]
    slow = [
        made | {"criteria": [made["criteria"][0] | {"figure": 9.0}]}
        if made["variant"] == "pr-812" and index < 16
        else made
        for index, made in enumerate(rows)
    ]
    assert only(slow).verdict == "worse"
    hidden = [quarantined(made) if index < 16 else made for index, made in enumerate(slow)]
    assert only(hidden).verdict == "same"


def test_some_rounds_in_quarantine_leave_the_others_to_count() -> None:
    rows = [row(0, "released", round=n) for n in range(2)]
    rows += [quarantined(row(0, "pr-812", "failed", round=0)), row(0, "pr-812", "failed", round=1)]
    found = only(rows)
    assert found.counts["regressed"] == 1
    assert found.counts["quarantined"] == 1


def test_all_in_quarantine_says_nothing() -> None:
    rows = [row(0, "released"), quarantined(row(0, "pr-812"))]
    found = only(rows)
    assert found.verdict == "unknown"
    assert [each.cause for each in objections(found.as_json())] == ["Unknown"]


def test_what_was_in_quarantine_before_counts_as_what_it_did() -> None:
    before = [quarantined(row(0, "", "passed")), quarantined(row(1, "", "failed")), row(2, "")]
    now = [row(0, "", "failed"), row(1, "", "failed"), row(2, "")]
    [found] = compare(now, [], before)
    assert [case["case"] for case in found.regressed] == ["a-0000-"]
    assert (found.counts["same"], found.counts["missing"]) == (2, 0)


def test_the_baseline_s_own_rounds_are_put_together() -> None:
    before = [
        row(0, "", "passed", round=0, figure=1.0),
        quarantined(row(0, "", "failed", round=1, figure=3.0)),
    ]
    [found] = compare([row(0, "", "failed", figure=2.0)], [], before)
    # One of two rounds passed: what fails now may be chance.
    assert (found.counts["flaky"], found.counts["regressed"]) == (1, 0)


def test_the_first_variant_is_the_baseline_though_its_first_rows_are_in_quarantine() -> None:
    before = [quarantined(row(0, "released")), row(0, "pr-811", "failed")]
    [found] = compare([row(0, "", "failed")], [], before)
    assert found.counts["regressed"] == 1
