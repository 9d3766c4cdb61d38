"""Versions compared on the same cases: regressions, repairs, flaky cases, and the whole's word."""

from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bagpipe.compare.compare import compare
from tests.unit.compare.rows import only, rounds, row


def test_a_case_that_fails_now_is_a_regression_and_named() -> None:
    rows = [row(n, v) for n in range(4) for v in ("released", "pr-812")]
    rows[3] = row(1, "pr-812", "failed")
    found = only(rows)
    assert (found.verdict, found.baseline) == ("worse", "released")
    assert found.regressed == [{"case": "a-0001-pr-812", "to": "failed", "reason": "Bad"}]
    assert found.counts == {
        "regressed": 1, "fixed": 0, "flaky": 0, "same": 3, "unknown": 0, "missing": 0, "new": 0,
        "quarantined": 0,
    }  # fmt: skip
    assert found.became == {"failed": 1, "invalid": 0, "errored": 0, "missing": 0}
    assert found.message == "1 regressed of 4 cases"


@pytest.mark.parametrize("to", ["failed", "invalid", "errored"])
def test_whatever_a_passed_case_comes_to_it_has_regressed(to: str) -> None:
    found = only([row(0, "released"), row(0, "pr-812", to, reason="Why")])
    assert (found.verdict, found.counts["regressed"]) == ("worse", 1)
    assert found.regressed == [{"case": "a-0000-pr-812", "to": to, "reason": "Why"}]
    assert found.became[to] == 1


def test_three_of_four_cases_that_crash_now_are_worse_and_not_the_same() -> None:
    rows = [row(n, "released") for n in range(4)] + [row(0, "pr-812")]
    rows += [row(n, "pr-812", "errored", reason="StackExited") for n in (1, 2, 3)]
    found = only(rows)
    assert (found.verdict, found.became["errored"]) == ("worse", 3)
    assert found.message == "3 regressed (3 errored) of 4 cases"


def test_a_case_that_passed_and_is_missing_has_regressed() -> None:
    rows = [row(n, "released") for n in range(10)] + [row(n, "pr-812") for n in (0, 10, 11)]
    found = only(rows)
    assert found.verdict == "worse"
    assert (found.counts["regressed"], found.became["missing"]) == (9, 9)
    assert (found.counts["missing"], found.counts["new"]) == (9, 2)
    assert found.missing == [f"a-{n:04d}-released" for n in range(1, 10)]
    assert found.regressed[0] == {"case": "a-0001-released", "to": "missing", "reason": ""}
    assert found.message == "9 regressed (9 missing) of 1 case; 9 missing, 2 new"


def test_a_case_that_failed_and_is_missing_is_missed_alone() -> None:
    rows = [row(0, "released"), row(0, "pr-812"), row(1, "released", "failed")]
    found = only(rows)
    assert (found.verdict, found.counts["regressed"], found.counts["missing"]) == ("same", 0, 1)


def test_cases_that_the_baseline_lacks_are_new_and_no_evidence() -> None:
    found = only([row(n, "pr-812") for n in range(2)] + [row(0, "released")])
    assert (found.missing, found.message) == ([], "no case changed of 1 case; 1 new")
    found = only([row(0, "pr-812", "failed")])
    sentence = "no case of both could be compared; 1 new (1 not passed)"
    assert (found.verdict, found.message) == ("unknown", sentence)


def test_new_cases_that_fail_and_criteria_that_are_gone_are_mentioned() -> None:
    rows = [row(0, "released", figure=1.0), row(0, "pr-812")]
    rows += [row(n, "pr-812", "failed") for n in (1, 2)] + [row(3, "pr-812")]
    found = only(rows)
    sentence = "no case changed of 1 case; 3 new (2 not passed); measured no more: latency"
    assert (found.verdict, found.message) == ("same", sentence)


def test_a_figure_of_too_little_evidence_is_compared_with_nothing() -> None:
    """Twelve cases that failed, and are invalid now with a figure that looks better."""
    before = [row(n, "released", "failed", 1.0 + n / 100) for n in range(12)]
    now = [row(n, "pr-812", "invalid", 0.01) for n in range(12)]
    kept = [row(12, each, "passed", 0.1) for each in ("released", "pr-812")]
    found = only([*before, *now, *kept])
    assert (found.verdict, found.counts["unknown"]) == ("same", 12)
    assert found.message.endswith("measured no more: latency in 12 cases")
    assert [each.pairs for each in found.criteria] == [1]
    # Of a baseline without evidence there was no figure before.
    turned = [dict(each, variant="released") for each in now]
    other = [dict(each, variant="pr-812") for each in before]
    found = only([*turned, *other, *kept])
    assert "measured no more" not in found.message
    assert [each.pairs for each in found.criteria] == [1]


def test_a_case_with_a_figure_in_one_round_has_one() -> None:
    before = [row(0, "released", figure=1.0, round=n) for n in range(2)]
    now = [row(0, "pr-812", figure=1.0), row(0, "pr-812", "invalid", 9.0, round=1)]
    found = only([*before, *now])
    assert [each.variant for each in found.criteria if each.name == "latency"] == [1.0]
    assert "measured no more" not in found.message


@pytest.mark.parametrize(
    ("before", "now", "gone"),
    [
        (["CPUs", "CPUs"], ["B", "B"], "usage (CPUs)"),
        (["CPUs", "B"], ["B", "B"], "usage (CPUs)"),
        (["B", "B"], ["CPUs", "B"], ""),
        (["CPUs", "CPUs"], ["CPUs"], ""),
        (["CPUs"], [""], "usage (CPUs)"),
    ],
)
def test_a_bound_that_decides_no_case_any_more_is_mentioned(
    before: list[str], now: list[str], gone: str
) -> None:
    def rows(variant: str, units: list[str]) -> list[dict[str, Any]]:
        finding = {"name": "usage", "outcome": "passed", "figure": 1.0, "direction": "lower"}
        return [
            row(n, variant, criteria=[finding | {"unit": unit}]) for n, unit in enumerate(units)
        ]

    message = only(rows("released", before) + rows("pr-812", now)).message
    assert message.partition("measured no more: ")[2] == gone


def test_a_case_of_the_same_name_that_was_played_from_another_recording_is_mentioned() -> None:
    earlier = [row(n, "", bag=f"s3://fleet/monday/{n}.bag") for n in range(3)]
    now = [row(n, "", bag=f"s3://fleet/{'monday' if n else 'tuesday'}/{n}.bag") for n in range(3)]
    [found] = compare(now, [], earlier)
    sentence = "no case changed of 3 cases; 1 played from another recording than there"
    assert (found.verdict, found.message) == ("same", sentence)
    [same] = compare(earlier, [], earlier)
    assert same.message == "no case changed of 3 cases"


def test_a_case_that_passes_now_is_fixed() -> None:
    rows = [row(0, "released", "failed"), row(0, "pr-812"), row(1, "released"), row(1, "pr-812")]
    found = only(rows)
    assert (found.verdict, found.fixed) == ("better", ["a-0000-pr-812"])


def test_the_same_is_the_same() -> None:
    found = only([row(n, v) for n in range(3) for v in ("released", "pr-812")])
    assert (found.verdict, found.message) == ("same", "no case changed of 3 cases")


@pytest.mark.parametrize("now", ["passed", "failed", "invalid", "errored"])
def test_a_case_without_evidence_before_is_undecided(now: str) -> None:
    found = only([row(0, "released", "errored"), row(0, "pr-812", now)])
    assert (found.verdict, found.counts["unknown"]) == ("unknown", 1)


def test_the_same_scenario_is_compared_whatever_its_number() -> None:
    rows = [
        row(0, "released", values={"rain": "on"}, scenario=1),
        row(0, "pr-812", "failed", values={"rain": "on"}, scenario=7),
        row(0, "released", "failed", values={"rain": "off"}),
        row(0, "pr-812", "failed", values={"rain": "off"}),
    ]
    assert only(rows).counts["regressed"] == 1


def test_an_earlier_job_is_a_baseline() -> None:
    before = [row(n, "", "passed") for n in range(3)]
    now = [row(n, "", "failed" if n == 2 else "passed") for n in range(3)]
    [found] = compare(now, [], earlier=before)
    assert (found.verdict, found.baseline, found.variant) == ("worse", "the earlier job", "")
    assert [case["case"] for case in found.regressed] == ["a-0002-"]


def test_many_are_counted_and_some_named() -> None:
    rows = [row(n, "released") for n in range(80)] + [row(n, "pr-812", "failed") for n in range(80)]
    found = only(rows)
    assert (found.counts["regressed"], len(found.regressed)) == (80, 50)
    found = only([row(n, "released") for n in range(80)] + [row(0, "pr-812")])
    assert (found.counts["missing"], len(found.missing)) == (79, 50)


@pytest.mark.parametrize(
    ("before", "after", "word"),
    [
        ("PPPPPPPPPP", "PFFFFFFFFF", "regressed"),  # chance 0.00012
        ("PFFFFFFFFF", "PPPPPPPPPP", "fixed"),
        ("PPPPPPPPPP", "PPPPFFFFFF", "regressed"),  # 0.011
        ("PPPPPPPPPP", "PPPPPFFFFF", "regressed"),  # 0.033
        ("PPPPPPPPPP", "PPPPPPFFFF", "flaky"),  # 0.087
        ("PPPPPPPPPP", "PPPPPPPPPF", "flaky"),
        ("PF", "FF", "flaky"),
        ("PPP", "PPF", "flaky"),
        ("PFPFPFPFPF", "FPFPFPFPFP", "flaky"),
        ("PP", "FF", "regressed"),  # all agree: no chance is asked for
        ("PPPPPPPPPP", "PEEEEEEEEE", "regressed"),
        ("FFFFFFFFFF", "FFFFFFFFFF", "same"),
    ],
)
def test_rounds_that_disagree_are_compared_by_fisher_s_exact_test(
    before: str, after: str, word: str
) -> None:
    found = only([*rounds(0, "released", before), *rounds(0, "pr-812", after)])
    assert {name: n for name, n in found.counts.items() if n} == {word: 1}
    assert found.verdict == {"regressed": "worse", "fixed": "better"}.get(word, "same")


def test_what_a_case_regressed_to_is_what_most_of_its_rounds_did() -> None:
    found = only([*rounds(0, "released", "P" * 10), *rounds(0, "pr-812", "PFEEEEEEEE")])
    assert found.regressed == [{"case": "a-0000-pr-812", "to": "errored", "reason": "Bad"}]


def test_many_flaky_cases_are_asked_with_holm_s_correction() -> None:
    """One of chance 0.011 is a find; of five together none, but for one that is clearer."""
    steady, four_left = "PPPPPPPPPP", "PPPPFFFFFF"
    rows = [r for n in range(5) for r in rounds(n, "released", steady)]
    found = only(rows + [r for n in range(5) for r in rounds(n, "pr-812", four_left)])
    assert (found.counts["regressed"], found.counts["flaky"]) == (0, 5)
    now = [*rounds(0, "pr-812", "PFFFFFFFFF"), *(r for n in (1, 2, 3, 4) for r in
           rounds(n, "pr-812", four_left))]  # fmt: skip
    found = only(rows + now)
    # The clear one takes one question from the others: 4 x 0.0108 is below 0.05.
    assert (found.counts["regressed"], found.counts["flaky"]) == (5, 0)


def test_many_cases_that_lose_too_few_rounds_each_are_worse_together() -> None:
    """No case of these is significant alone, but their rounds are."""
    rows = [r for n in range(8) for r in rounds(n, "released", "PPPP")]
    found = only(rows + [r for n in range(8) for r in rounds(n, "pr-812", "PPPF")])
    assert (found.counts["flaky"], found.counts["regressed"]) == (8, 0)
    [shares] = [one for one in found.criteria if one.name == "rounds: passed"]
    assert (shares.verdict, shares.baseline, shares.variant) == ("worse", 100.0, 75.0)
    assert found.verdict == "worse"


GRAVITY = ("unknown", "same", "better", "worse")
WORDS = {"P": "passed", "F": "failed", "I": "invalid", "E": "errored"}
# What a case did in both versions; - where a version lacks it.
both = st.sampled_from([before + now for before in "PFIE-" for now in "PFIE-"][:-1])


def verdict(cases: list[str]) -> str:
    rows = [
        row(n, variant, WORDS[letter])
        for n, case in enumerate(cases)
        for letter, variant in zip(case, ("released", "pr-812"), strict=True)
        if letter != "-"
    ]
    return only(rows).verdict


@pytest.mark.parametrize(
    ("case", "word"),
    [("PF", "worse"), ("P-", "worse"), ("FP", "better"), ("PP", "same"), ("FF", "same"),
     ("EP", "unknown"), ("-P", "unknown"), ("F-", "unknown")],
)  # fmt: skip
def test_the_verdict_of_one_case(case: str, word: str) -> None:
    assert verdict([case]) == word


@given(st.lists(both, min_size=1, max_size=10))
@example(["PF", "FP"])
@example(["FP", "FP", "FP", "P-"])
def test_the_gravest_case_is_the_verdict_whatever_got_better(cases: list[str]) -> None:
    assert verdict(cases) == max((verdict([case]) for case in cases), key=GRAVITY.index)


def criteria_of(**changes: float) -> list[dict[str, Any]]:
    """Eight recordings of both versions, with a figure of each name that moves so."""
    return [
        row(n, variant, criteria=[
            {"name": name, "figure": 1.0 + (variant == "pr-812") * change, "direction": "lower"}
            for name, change in changes.items()
        ])
        for n in range(8)
        for variant in ("released", "pr-812")
    ]  # fmt: skip


# Promise: worse-whatever-is-better
def test_a_worse_criterion_is_worse_whatever_got_better() -> None:
    repaired = [row(9, "released", "failed", criteria=[]), row(9, "pr-812", criteria=[])]
    better = only(criteria_of(jerk=-1.0) + repaired)
    assert (better.verdict, [one.verdict for one in better.criteria]) == ("better", ["better"])
    mixed = only(criteria_of(jerk=-1.0, delay=1.0) + repaired)
    assert [one.verdict for one in mixed.criteria] == ["better", "worse"]
    assert (mixed.verdict, mixed.counts["fixed"]) == ("worse", 1)


# Promise: worse-whatever-is-better
def test_a_regressed_case_is_worse_whatever_criterion_got_better() -> None:
    regressed = [row(9, "released", criteria=[]), row(9, "pr-812", "failed", criteria=[])]
    found = only(criteria_of(jerk=-1.0) + regressed)
    assert (found.verdict, [one.verdict for one in found.criteria]) == ("worse", ["better"])


def rounds_named(fragment: int, variant: str, outcomes: str) -> list[dict[str, Any]]:
    """Rounds as a job names them: each has a name of its own."""
    made = rounds(fragment, variant, outcomes)
    return [each | {"case": f"{each['case']}-r{n}"} for n, each in enumerate(made)]


def test_a_case_of_several_rounds_goes_by_the_name_of_its_first_one() -> None:
    before = {0: "PP", 1: "FF", 2: "PF", 3: "PP", 4: "FF"}
    now = {0: "FF", 1: "PP", 2: "FP"}
    rows = [each for n, o in before.items() for each in rounds_named(n, "released", o)]
    found = only(rows + [each for n, o in now.items() for each in rounds_named(n, "pr-812", o)])
    assert [(case["case"], case["to"]) for case in found.regressed] == [
        ("a-0000-pr-812-r0", "failed"), ("a-0003-released-r0", "missing"),
    ]  # fmt: skip
    assert (found.fixed, found.flaky) == (["a-0001-pr-812-r0"], ["a-0002-pr-812-r0"])
    assert found.missing == ["a-0003-released-r0", "a-0004-released-r0"]
    assert found.message == (
        "2 regressed (1 failed, 1 missing), 1 fixed, 1 flaky of 3 cases;"
        " undecided in rounds: passed; 2 missing"
    )


def test_the_message_names_the_criteria_that_moved() -> None:
    found = only(criteria_of(jerk=-1.0, delay=1.0, gap=0.0))
    assert found.message == "no case changed of 8 cases; worse in delay; better in jerk"
    few = only([each for each in criteria_of(delay=1.0) if int(each["fragment"][2:]) < 3])
    assert (few.verdict, few.message) == (
        "same",
        "no case changed of 3 cases; undecided in delay",
    )


def with_loss(before: int, after: int) -> list[dict[str, Any]]:
    """Eight recordings whose nodes lost so many of 100 messages, and braked not once."""
    criteria = [{"name": "braking", "figure": 0.0, "direction": "lower"}]
    return [
        row(n, variant, criteria=criteria, result={
            "ledger": {"topics": [{"sent": 100, "subscribers": [{"received": 100 - lost}]}]}
        })
        for n in range(8)
        for variant, lost in (("released", before), ("pr-812", after))
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        (0, 0, [("braking", "same")]),
        (0, 2, [("braking", "same"), ("delivery: loss", "worse")]),
        (2, 0, [("braking", "same"), ("delivery: loss", "better")]),
        (2, 2, [("braking", "same"), ("delivery: loss", "same")]),
    ],
)
def test_losses_are_compared_where_either_version_has_one(
    before: int, after: int, expected: list[tuple[str, str]]
) -> None:
    found = only(with_loss(before, after))
    assert [(one.name, one.verdict) for one in found.criteria] == expected
