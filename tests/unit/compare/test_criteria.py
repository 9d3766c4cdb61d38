"""Figures of two versions: by recording, corrected for the number of criteria."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from bagpipe.compare.compare import Comparison
from bagpipe.compare.criteria import CriterionComparison, Measured, judged
from tests.unit.compare.rows import only, row


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
    assert criterion.recordings == 20
    assert criterion.difference == pytest.approx(change, abs=1e-9)
    assert criterion.low is not None
    assert criterion.high is not None
    assert criterion.low <= change <= criterion.high
    assert found.verdict == verdict
    # The chance decides, and the interval agrees with it.
    assert criterion.chance is not None
    assert (criterion.chance <= 0.05) == (verdict != "same")
    assert (criterion.low <= 0 <= criterion.high) == (verdict == "same")


# Promise: too-few-are-unknown
def test_few_recordings_are_no_evidence_and_say_how_many_would_be() -> None:
    [criterion] = with_latency(0.5, cases=4).criteria
    assert criterion.verdict == "unknown"
    assert criterion.message == (
        "+0.495 s in 4 pairs of 4 recordings: 5 recordings are needed to rule out chance"
    )
    [criterion] = with_latency(0.5, cases=5).criteria
    # All five have gone up: by chance in one of 32 comparisons, which counts 5/4 of itself since
    # four fifths of the level are for `worse`.
    assert criterion.verdict == "worse"
    assert criterion.chance == pytest.approx(1.25 / 32)


def test_rounds_of_a_case_are_one_pair() -> None:
    rows = [
        row(n, v, figure=0.1 + (0.05 if v == "pr-812" else 0.0) * r, round=r)
        for n in range(6)
        for v in ("released", "pr-812")
        for r in range(3)
    ]
    latency = only(rows).criteria[0]
    assert latency.pairs == 6
    assert latency.variant == pytest.approx(0.15)


def of_recordings(recordings: int, fragments: int, worse_in: set[int]) -> CriterionComparison:
    """Each recording's fragments all go the same way: up in those of `worse_in`, else down."""
    rows = []
    for n in range(recordings * fragments):
        at = n // fragments
        bag = f"pvc://bags/{at}.bag"
        rows.append(row(n, "released", figure=1.0, bag=bag))
        change = 0.2 if at in worse_in else -0.1
        rows.append(row(n, "pr-812", figure=1.0 + change + n / 1e4, bag=bag))
    [criterion] = only(rows).criteria
    return criterion


# Promise: unit-is-the-recording
def test_fragments_of_one_recording_are_one_piece_of_evidence() -> None:
    """Sixty pairs look overwhelming; they are six recordings, of which four went up."""
    found = of_recordings(6, 10, worse_in={0, 1, 2, 3})
    assert (found.pairs, found.recordings, found.verdict) == (60, 6, "same")
    alone = of_recordings(60, 1, worse_in=set(range(40)))
    assert (alone.pairs, alone.recordings, alone.verdict) == (60, 60, "worse")


def test_pieces_of_several_bags_are_a_recording_of_their_own() -> None:
    parts = [{"bag": "b"}, {"bag": "a"}]
    rows = [
        row(n, v, figure=1.0 + (v == "pr-812"), bag="sequence", parts=parts)
        for n in range(9)
        for v in ("released", "pr-812")
    ]
    [criterion] = only(rows).criteria
    assert (criterion.pairs, criterion.recordings, criterion.verdict) == (9, 1, "unknown")


def ten_criteria(up: set[int], recordings: int = 8) -> list[CriterionComparison]:
    """Ten figures; those of `up` go up in all recordings but one, the others to and fro."""
    rows = []
    for n in range(recordings):
        for variant in ("released", "pr-812"):
            now = variant == "pr-812"
            criteria = []
            for k in range(10):
                change = 0.1 + n / 100 if k in up else 0.1 * (-1) ** n + k / 100
                if k in up and n == 0:
                    change = -0.01
                figure = 1.0 + now * change
                criteria.append(
                    {"name": f"c{k}", "figure": figure, "unit": "m", "direction": "lower"}
                )
            rows.append(row(n, variant, criteria=criteria))
    return only(rows).criteria


def test_what_is_a_find_alone_is_none_among_ten_criteria() -> None:
    """Of 256 ways to flip eight signs two give as much: 0.0078; ten criteria make 0.078 of it."""
    found = ten_criteria({3})
    assert found[3].chance == pytest.approx(10 * 2 / 256 * 1.25)
    assert found[3].verdict == "same"
    [alone] = one_criterion()
    assert alone.verdict == "worse"
    assert alone.chance == pytest.approx(2 / 256 * 1.25)


def one_criterion() -> list[CriterionComparison]:
    rows = []
    for n in range(8):
        change = -0.01 if n == 0 else 0.1 + n / 100
        for variant in ("released", "pr-812"):
            figure = 1.0 + (variant == "pr-812") * change
            criteria = [{"name": "c3", "figure": figure, "unit": "m", "direction": "lower"}]
            rows.append(row(n, variant, criteria=criteria))
    return only(rows).criteria


def test_a_criterion_that_nothing_moved_takes_nothing_from_the_others() -> None:
    rows = []
    for n in range(6):
        for variant in ("released", "pr-812"):
            now = variant == "pr-812"
            criteria = [
                {"name": f"c{k}", "figure": 1.0 + now * (k == 0) * (1 + n), "direction": "lower"}
                for k in range(10)
            ]
            rows.append(row(n, variant, criteria=criteria))
    found = only(rows).criteria
    assert [one.verdict for one in found] == ["worse"] + ["same"] * 9
    assert found[0].chance == pytest.approx(1.25 / 64)
    assert found[1].message == "no figure differs in 6 pairs of 6 recordings"


def test_a_figure_that_is_not_finite_is_undecided() -> None:
    rows = [row(n, v, figure=1.0) for n in range(6) for v in ("released", "pr-812")]
    rows[3] = row(1, "pr-812", figure=float("nan"))
    [criterion] = only(rows).criteria
    assert (criterion.verdict, criterion.message) == (
        "unknown",
        "not every figure is a finite number",
    )


def ledger(sent: int, received: int) -> dict[str, Any]:
    node = {"node": "/n", "received": received, "dropped": 0}
    return {"topics": [{"topic": "/in", "sent": sent, "subscribers": [node]}]}


def test_loss_is_compared_like_any_other_figure_also_that_of_discarded_runs() -> None:
    rows = []
    for n in range(6):
        rows.append(row(n, "released", result={"ledger": ledger(100, 100)}))
        discarded = [{"reason": "MachineBusy", "message": "", "ledger": ledger(100, 60)}]
        rows.append(
            row(n, "pr-812", result={"ledger": ledger(100, 100)}, attempts=2, discarded=discarded)
        )
    found = {one.name: one for one in only(rows).criteria}
    loss, runs = found["delivery: loss"], found["delivery: discarded runs"]
    assert (loss.verdict, loss.baseline, loss.variant) == ("worse", 0.0, 20.0)
    assert (runs.verdict, runs.baseline, runs.variant) == ("worse", 0.0, 1.0)


def compared(differences: NDArray[np.float64], direction: str = "lower") -> CriterionComparison:
    """Of one criterion alone, in which the recordings differ so."""
    baseline = np.linspace(2.0, 3.0, len(differences))
    variant = baseline + differences
    one = Measured("delay", "s", direction, len(differences), baseline.tolist(), variant.tolist())
    [found] = judged([one])
    return found


# Of chance, what each side of the interval leaves out: 4 % where the variant is worse.
TAILS = {"lower": (0.04, 0.01), "higher": (0.01, 0.04)}


# Promise: interval-and-chance
@pytest.mark.parametrize("direction", ["lower", "higher"])
@pytest.mark.parametrize("seed", range(4))
def test_the_interval_ends_where_scipy_s_test_begins_to_refuse(direction: str, seed: int) -> None:
    """Each end parts the true differences that the figures refute from those that they don't."""
    differences = np.random.default_rng(seed).normal(0.3, 1.0, 9)
    found = compared(differences, direction)
    below, above = TAILS[direction]

    def chance(true_difference: float, alternative: str) -> float:
        return float(stats.permutation_test(
            (differences - true_difference,), np.mean, permutation_type="samples",
            alternative=alternative, n_resamples=np.inf,
        ).pvalue)  # fmt: skip

    assert found.low is not None
    assert found.high is not None
    assert chance(found.low - 1e-6, "greater") <= below < chance(found.low + 1e-6, "greater")
    assert chance(found.high + 1e-6, "less") <= above < chance(found.high - 1e-6, "less")


@pytest.mark.parametrize("direction", ["lower", "higher"])
def test_the_interval_is_student_s_where_that_one_is_right(direction: str) -> None:
    differences = np.random.default_rng(5).normal(0.1, 1.0, 200)
    found = compared(differences, direction)
    below, above = TAILS[direction]
    student = stats.t(199, differences.mean(), stats.sem(differences))
    assert found.low == pytest.approx(student.ppf(below), abs=0.01)
    assert found.high == pytest.approx(student.ppf(1 - above), abs=0.01)


@given(
    st.lists(st.integers(-40, 40).map(lambda n: n / 8), min_size=5, max_size=20),
    st.sampled_from(["lower", "higher"]),
)
def test_the_effect_is_scipy_s_paired_t_freed_of_the_number_of_recordings(
    differences: list[float], direction: str
) -> None:
    """It points where the difference does, whichever direction is better."""
    baseline = [float(n) for n in range(len(differences))]
    variant = [n + change for n, change in zip(baseline, differences, strict=True)]
    [found] = judged([Measured("delay", "s", direction, len(baseline), baseline, variant)])
    few = 0 < sum(map(bool, differences)) < 5  # nothing is decided by so few that differ
    if len(set(differences)) == 1 or few:
        assert found.effect is None
    else:
        paired = stats.ttest_rel(variant, baseline).statistic
        assert found.effect == pytest.approx(paired / math.sqrt(len(differences)))
