"""Quarantine: its cases run and are reported, and what they say decides no verdict. Nothing else
gets better by it: not a job of which no case counts, not a case that no rule names.
"""

from collections import Counter
from datetime import date, timedelta
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bagpipe.driver.comparing import Compared
from bagpipe.driver.progress import Progress
from bagpipe.driver.verdict import verdict_of
from bagpipe.quarantine import (
    MOST_DAYS,
    Quarantine,
    QuarantineRule,
    QuarantineTally,
    planned,
    remarks,
    too_long,
)
from bagpipe.row_facts import OUTCOMES, verdict_words
from tests.unit.bagpipe.jobs import make_row

TODAY = date(2026, 11, 23)
YESTERDAY, TOMORROW = TODAY - timedelta(days=1), TODAY + timedelta(days=1)
GRAVITY = {"Passed": 0, "Invalid": 1, "Failed": 2, "": 3}

outcomes = st.lists(st.sampled_from(OUTCOMES), max_size=8)
patterns = st.sampled_from(["*", "case-0", "case-[0-3]", "case-?", "*-7", "nothing", "case-"])
rules_of_a_job = st.lists(
    st.tuples(patterns, st.integers(-2, 2)), max_size=4, unique_by=lambda r: r[0]
)


def rule(cases: str, until: date = TODAY, reason: str = "issue 17") -> QuarantineRule:
    return QuarantineRule(cases=cases, reason=reason, until=until)


def ended(outcomes: list[str], rules: list[QuarantineRule] | None = None) -> Progress:
    quarantine = Quarantine(rules or [], TODAY)
    progress = Progress("pvc://results/r")
    progress.look_at(quarantine)
    progress.begin(len(outcomes))
    for number, outcome in enumerate(outcomes):
        reason = "" if outcome == "passed" else f"Why{number}"
        row = make_row(f"case-{number}", outcome, reason, result=None)
        progress.add(quarantine.marked(row))
    progress.finish()
    return progress


def made(rules: list[tuple[str, int]]) -> list[QuarantineRule]:
    return [rule(cases, TODAY + timedelta(days=days)) for cases, days in rules]


# Promise: quarantine-hides-nothing
@given(outcomes, rules_of_a_job)
@example(["passed", "failed"], [("case-1", 0)])
@example(["passed", "failed"], [("case-1", -1)])
@example(["failed", "failed"], [("*", 0)])
@example(["passed", "errored"], [("case-1", 0)])
def test_a_verdict_is_that_of_the_cases_which_count(
    outcomes: list[str], rules: list[tuple[str, int]]
) -> None:
    progress = ended(outcomes, made(rules))
    names = Quarantine(made(rules), TODAY)
    counting = [o for n, o in enumerate(outcomes) if names.rule_of(f"case-{n}") is None]
    if counting or not outcomes:
        alone = ended(counting)
        assert (progress.phase, progress.verdict, progress.verdict_reason) == (
            alone.phase, alone.verdict, alone.verdict_reason
        )  # fmt: skip
    else:
        assert (progress.verdict, progress.verdict_reason) == ("Invalid", "AllQuarantined")
    if progress.verdict == "Passed":
        assert set(counting) == {"passed"}


@given(outcomes, rules_of_a_job)
def test_counts_are_of_all_cases_and_say_how_many_did_not_count(
    outcomes: list[str], rules: list[tuple[str, int]]
) -> None:
    cases = ended(outcomes, made(rules)).snapshot()["cases"]
    assert {word: cases[word] for word in OUTCOMES} == {o: outcomes.count(o) for o in OUTCOMES}
    names = Quarantine(made(rules), TODAY)
    inside = [o for n, o in enumerate(outcomes) if names.rule_of(f"case-{n}") is not None]
    assert cases["quarantined"] == len(inside) - inside.count("passed")


@given(outcomes, rules_of_a_job, rules_of_a_job)
def test_a_rule_makes_nothing_better_but_by_the_cases_that_it_names(
    outcomes: list[str], rules: list[tuple[str, int]], more: list[tuple[str, int]]
) -> None:
    few, many = Quarantine(made(rules), TODAY), Quarantine(made(rules + more), TODAY)
    before, after = ended(outcomes, list(few.rules)), ended(outcomes, list(many.rules))
    if GRAVITY[after.verdict] < GRAVITY[before.verdict]:
        named = [
            outcome
            for n, outcome in enumerate(outcomes)
            if many.rule_of(f"case-{n}") is not None and few.rule_of(f"case-{n}") is None
        ]
        assert set(named) - {"passed"}


@given(st.lists(st.sampled_from(OUTCOMES), max_size=6))
def test_without_a_case_that_counts_nothing_is_passed(outcomes: list[str]) -> None:
    assert verdict_of(Counter(), Compared()).word == "Invalid"
    assert ended(outcomes, [rule("*")]).verdict in ("Invalid", "")


@pytest.mark.parametrize(
    ("until", "verdict"), [(YESTERDAY, "Failed"), (TODAY, "Passed"), (TOMORROW, "Passed")]
)
def test_it_holds_through_its_last_day(until: date, verdict: str) -> None:
    assert ended(["passed", "failed"], [rule("case-1", until)]).verdict == verdict


def test_another_rule_may_hold_where_one_has_ended() -> None:
    rules = [rule("case-1", YESTERDAY), rule("case-*1", TODAY, "issue 18")]
    row = Quarantine(rules, TODAY).marked(make_row("case-1", "failed"))
    assert row["quarantine"] == {"cases": "case-*1", "reason": "issue 18", "until": "2026-11-23"}


def test_ninety_days_are_the_most() -> None:
    last = TODAY + timedelta(days=MOST_DAYS)
    assert too_long([rule("a", last), rule("b", YESTERDAY)], TODAY) == []
    [sentence] = too_long([rule("a", last + timedelta(days=1))], TODAY)
    assert sentence == (
        "spec.quarantine of 'a' holds until 2027-02-22, and the job's day is 2026-11-23: a"
        " quarantine lasts at most 90 days, so write 2027-02-21 or an earlier day"
    )


def test_a_pattern_matches_whole_names_and_case_counts() -> None:
    names = Quarantine([rule("night-000?")], TODAY)
    cases = ("night-0001", "night-00010", "a-night-0001", "Night-0001", "night-000")
    assert [bool(names.rule_of(name)) for name in cases] == [True, False, False, False, False]


def test_the_mark_of_another_job_is_left_out() -> None:
    row = make_row("case-1") | {"quarantine": {"cases": "*", "reason": "x", "until": "2020-01-01"}}
    assert "quarantine" not in Quarantine([], TODAY).marked(row)


def test_what_a_manifest_has_marks_rows_as_the_job_did() -> None:
    rules = [rule("case-0", YESTERDAY), rule("case-*"), rule("nothing")]
    tally = QuarantineTally(Quarantine(rules, TODAY))
    again = Quarantine.decided(tally.as_json())
    assert (again.day, list(again.rules)) == (TODAY, rules)
    assert Quarantine.decided(None).rules == ()


def test_the_sentence_says_what_is_in_quarantine_and_what_to_do_about_it() -> None:
    rules = [
        rule("case-0", YESTERDAY), rule("case-[12]"), rule("case-3"), rule("day-*"),
    ]  # fmt: skip
    progress = ended(["passed", "failed", "passed", "passed"], rules)
    assert progress.verdict == "Passed"
    assert progress.message == (
        "4 of 4 cases ran, verdict Passed; 1 of 3 cases in quarantine did not pass; quarantine of"
        " 'case-0': ended with 2026-11-22: its 1 case counts again; quarantine of 'case-3': its"
        " 1 case passed in this job: `bagpipe history` says whether it could end; quarantine of"
        " 'day-*': names no case of this job: correct its pattern, or remove it"
    )
    counts: dict[str, Any] = progress.snapshot()["cases"]
    assert verdict_words("Passed", counts) == "Passed: 1 failed, 1 of these in quarantine"
    assert len(remarks(progress.quarantine)) == 3


def test_a_rule_that_has_ended_counts_no_case_that_another_keeps_inside() -> None:
    rules = [rule("case-?", YESTERDAY), rule("case-[12]"), rule("case-3", YESTERDAY)]
    progress = ended(["passed", "failed", "failed", "passed"], rules)
    both = "2 of its cases count, and 2 are in quarantine by another rule"
    assert remarks(progress.quarantine) == [
        f"quarantine of 'case-?': ended with 2026-11-22: {both}",
        "quarantine of 'case-3': ended with 2026-11-22: its 1 case counts again",
    ]
    names = [f"case-{number}" for number in range(4)]
    assert [each["toDo"] for each in planned(rules, names, TODAY)["rules"]] == [
        f"ended with 2026-11-22: {both}",
        "",
        "ended with 2026-11-22: its cases count",
    ]
    [all_kept, _] = planned([rule("a", YESTERDAY), rule("a*")], ["a"], TODAY)["rules"]
    assert all_kept["toDo"] == (
        "ended with 2026-11-22: 0 of its cases count, and 1 is in quarantine by another rule"
    )


def test_failures_that_count_are_named_first() -> None:
    failed = ["failed"] * 6 + ["errored"]
    progress = ended(failed, [rule("case-[0-5]")])
    found = progress.snapshot()["failures"]
    assert [each["case"] for each in found] == ["case-6", *(f"case-{n}" for n in range(4))]
    assert found[1]["message"] == "why case-0 (in quarantine until 2026-11-23: issue 17)"
    assert progress.message == "1 of 7 cases errored; case-6: Why6: why case-6"


def test_what_is_in_quarantine_does_not_break_a_job_off() -> None:
    progress = ended(["failed", "errored", "failed"], [rule("case-[01]")])
    assert progress.failed() == 1


@given(st.text(max_size=12), st.text(max_size=12))
def test_any_pattern_can_be_looked_for(pattern: str, name: str) -> None:
    if pattern:
        Quarantine([rule(pattern)], TODAY).matching(name)
        assert Quarantine([rule("*")], TODAY).matching(name) == [0]
