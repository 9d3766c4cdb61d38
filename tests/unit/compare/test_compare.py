"""Versions compared on the same cases: regressions, repairs, flaky cases, differences."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe.compare.compare import Comparison, compare
from bagpipe.compare.statistics import chance_of, difference


def row(
    fragment: int,
    variant: str,
    outcome: str = "passed",
    figure: float | None = None,
    direction: str = "lower",
    **more: Any,
) -> dict[str, Any]:
    made = {
        "case": f"a-{fragment:04d}-{variant}",
        "fragment": f"a-{fragment:04d}",
        "variant": variant,
        "values": {},
        "seed": 0,
        "round": 0,
        "outcome": outcome,
        "criteria": [
            {"name": "latency", "outcome": outcome, "figure": figure, "unit": "s",
             "direction": direction}
        ],
    }  # fmt: skip
    return made | more


def only(rows: list[dict[str, Any]]) -> Comparison:
    [comparison] = compare(rows, ["released", "pr-812"])
    return comparison


def test_a_case_that_fails_now_is_a_regression_and_named() -> None:
    rows = [row(n, v) for n in range(4) for v in ("released", "pr-812")]
    rows[3] = row(1, "pr-812", "failed")
    found = only(rows)
    assert (found.verdict, found.baseline) == ("worse", "released")
    assert found.regressed == ["a-0001-pr-812"]
    assert found.counts == {
        "regressed": 1, "fixed": 0, "flaky": 0, "same": 3, "unknown": 0, "unpaired": 0,
        "missing": 0,
    }  # fmt: skip
    assert found.message == "1 regressed of 4 cases"


def test_a_case_that_passes_now_is_fixed() -> None:
    rows = [row(0, "released", "failed"), row(0, "pr-812"), row(1, "released"), row(1, "pr-812")]
    found = only(rows)
    assert (found.verdict, found.fixed) == ("better", ["a-0000-pr-812"])


def test_the_same_is_the_same() -> None:
    found = only([row(n, v) for n in range(3) for v in ("released", "pr-812")])
    assert (found.verdict, found.message) == ("same", "no case changed of 3 cases")


@pytest.mark.parametrize("flaky", ["released", "pr-812"])
def test_a_flaky_case_is_told_apart_from_a_regression(flaky: str) -> None:
    steady = "pr-812" if flaky == "released" else "released"
    rows = [
        row(0, flaky, "passed", round=0),
        row(0, flaky, "failed", round=1),
        row(0, steady, "failed" if steady == "pr-812" else "passed", round=0),
        row(0, steady, "failed" if steady == "pr-812" else "passed", round=1),
    ]
    found = only(rows)
    assert (found.verdict, found.regressed) == ("same", [])
    assert found.flaky == ["a-0000-pr-812"]


def test_a_case_without_a_verdict_is_unknown_and_not_the_same() -> None:
    found = only([row(0, "released"), row(0, "pr-812", "errored")])
    assert (found.verdict, found.counts["unknown"]) == ("unknown", 1)
    found = only([row(0, "released"), row(1, "pr-812")])
    assert (found.verdict, found.counts["unpaired"]) == ("unknown", 2)


def test_cases_that_one_of_the_two_lacks_are_counted_and_told() -> None:
    rows = [row(n, "released") for n in range(10)] + [row(n, "pr-812") for n in (0, 10, 11)]
    found = only(rows)
    assert (found.counts["missing"], found.counts["unpaired"]) == (9, 11)
    assert found.missing == [f"a-{n:04d}-released" for n in range(1, 10)]
    # The word is of the cases that both have.
    assert found.verdict == "same"
    assert found.message == "no case changed of 1 cases; 9 missing, 2 new"
    found = only([row(n, "pr-812") for n in range(2)] + [row(0, "released")])
    assert (found.missing, found.message) == ([], "no case changed of 1 cases; 1 new")


def test_what_has_no_case_in_common_says_what_is_missing() -> None:
    found = only([row(0, "released"), row(1, "pr-812")])
    assert found.message == "no case of both could be compared; 1 missing, 1 new"


def test_many_missing_cases_are_counted_and_some_named() -> None:
    found = only([row(n, "released") for n in range(80)] + [row(0, "pr-812")])
    assert (found.counts["missing"], len(found.missing)) == (79, 50)


def with_latency(change: float, spread: float = 0.01, cases: int = 20, **more: Any) -> Comparison:
    rows = []
    for n in range(cases):
        wobble = spread * (n % 5 - 2)
        rows.append(row(n, "released", figure=0.1, **more))
        rows.append(row(n, "pr-812", figure=0.1 + change + wobble, **more))
    return only(rows)


@pytest.mark.parametrize(
    ("change", "direction", "verdict"),
    [
        (0.05, "lower", "worse"),
        (-0.05, "lower", "better"),
        (0.05, "higher", "better"),
        (-0.05, "higher", "worse"),
        (0.0, "lower", "same"),
        (0.001, "lower", "same"),
    ],
)
def test_a_figure_is_better_or_worse_by_its_direction(
    change: float, direction: str, verdict: str
) -> None:
    found = with_latency(change, direction=direction)
    [criterion] = found.criteria
    assert (criterion.verdict, criterion.pairs, criterion.unit) == (verdict, 20, "s")
    assert criterion.difference == pytest.approx(change, abs=1e-9)
    assert criterion.low is not None
    assert criterion.high is not None
    assert criterion.low <= change <= criterion.high
    assert found.verdict == verdict


def test_few_pairs_are_no_evidence() -> None:
    [criterion] = with_latency(0.5, cases=4).criteria
    assert criterion.verdict == "unknown"
    assert "4 pairs of figures" in criterion.message


def test_rounds_of_a_case_are_one_pair() -> None:
    rows = [
        row(n, v, figure=0.1 + (0.05 if v == "pr-812" else 0.0) * r, round=r)
        for n in range(6)
        for v in ("released", "pr-812")
        for r in range(3)
    ]
    [criterion] = only(rows).criteria
    assert criterion.pairs == 6
    assert criterion.variant == pytest.approx(0.15)


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
    assert found.regressed == ["a-0002-"]


def test_many_regressions_are_counted_and_some_named() -> None:
    rows = [row(n, "released") for n in range(80)] + [row(n, "pr-812", "failed") for n in range(80)]
    found = only(rows)
    assert (found.counts["regressed"], len(found.regressed)) == (80, 50)
    assert found.chance < 1e-20


@pytest.mark.parametrize(
    ("worse", "better", "chance"),
    [(0, 0, 1.0), (1, 0, 1.0), (5, 0, 0.0625), (6, 0, 0.03125), (3, 3, 1.0), (9, 1, 0.021484375)],
)
def test_mcnemar_s_exact_test(worse: int, better: int, chance: float) -> None:
    assert chance_of(worse, better) == pytest.approx(chance)
    assert chance_of(better, worse) == pytest.approx(chance)


@given(st.integers(0, 120), st.integers(0, 120))
def test_the_chance_is_the_sum_of_the_binomial_s_tail(worse: int, better: int) -> None:
    changed, few = worse + better, min(worse, better)
    tail = sum(math.comb(changed, k) for k in range(few + 1))
    assert chance_of(worse, better) == min(1.0, 2 * tail / 2**changed)


def test_the_chance_of_a_hundred_thousand_changed_cases_is_found_in_one_pass() -> None:
    """Each term of the sum anew would take the better part of an hour."""
    worse, better = 49_900, 50_100
    normal = math.erfc((better - worse - 1) / math.sqrt(2 * (worse + better)))
    assert chance_of(worse, better) == pytest.approx(normal, rel=1e-3)


figures = st.lists(st.floats(-1e6, 1e6), min_size=5, max_size=40)


@given(figures)
def test_the_interval_holds_the_mean_and_turns_with_the_sides(values: list[float]) -> None:
    zeros = [0.0] * len(values)
    forth, back = difference(zeros, values), difference(values, zeros)
    assert forth is not None
    assert back is not None
    slack = 1e-6 * max(1.0, *map(abs, values))
    assert forth.low - slack <= forth.mean <= forth.high + slack
    assert back.mean == pytest.approx(-forth.mean)
    assert back.low == pytest.approx(-forth.high, abs=slack)


def test_a_figure_that_is_not_finite_is_no_difference() -> None:
    assert difference([0.0] * 5, [1.0, 1.0, 1.0, 1.0, float("inf")]) is None
