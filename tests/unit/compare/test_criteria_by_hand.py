"""What a few recordings come to, each figure worked out by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bagpipe.compare.criteria import CriterionComparison, Measured, judged
from bagpipe.compare.sign_flips import SignFlips
from tests.unit.compare.rows import only, row


def of(*differences: float, name: str = "delay", direction: str = "lower") -> Measured:
    """Of a baseline of 10 s in each recording."""
    count = len(differences)
    variant = [10.0 + change for change in differences]
    return Measured(name, "s", direction, count, [10.0] * count, variant)


def alone(*differences: float, direction: str = "lower") -> CriterionComparison:
    [found] = judged([of(*differences, direction=direction)])
    return found


EFFECT = float(np.mean([1, 2, 3, 4, 5]) / np.std([1, 2, 3, 4, 5], ddof=1))
UP = CriterionComparison(
    "delay", "worse", 5, 5, 10.0, 13.0, 3.0, 1.0, None, EFFECT, 1.25 / 32, "s",
    "+3 s in 5 pairs of 5 recordings (at least +1, chance 0.039)",
)  # fmt: skip


def test_five_recordings_that_all_got_worse_are_just_enough() -> None:
    assert alone(1, 2, 3, 4, 5) == UP
    assert alone(-1, -2, -3, -4, -5, direction="higher") == replace(
        UP, variant=7.0, difference=-3.0, low=None, high=-1.0, effect=-EFFECT,
        message="-3 s in 5 pairs of 5 recordings (at most -1, chance 0.039)",
    )  # fmt: skip


@pytest.mark.parametrize(("direction", "sign"), [("lower", -1), ("higher", 1)])
def test_to_be_better_takes_seven_recordings(direction: str, sign: int) -> None:
    """Of the level, a fifth is for `better`: 1/64 is too much of it, and 1/128 is not."""
    six = alone(*(sign * n for n in range(1, 7)), direction=direction)
    assert (six.verdict, six.chance) == ("same", 1.0)
    assert six.message.startswith(f"{sign * 3.5:+.4g} s in 6 pairs of 6 recordings (at ")
    assert six.message.endswith(", chance 1)")
    seven = alone(*(sign * n for n in range(1, 8)), direction=direction)
    assert seven.verdict == "better"
    assert seven.chance == pytest.approx(5 / 128)


def test_an_interval_is_written_from_its_lower_to_its_upper_end() -> None:
    found = alone(*range(1, 9))
    assert (found.low, found.high) == SignFlips(np.arange(1.0, 9.0)).ends(0.04, 0.01)
    assert found.message == (
        f"+4.5 s in 8 pairs of 8 recordings ({found.low:+.4g} to {found.high:+.4g}, chance 0.0049)"
    )
    turned = alone(*(-n for n in range(1, 9)), direction="higher")
    assert (turned.low, turned.high) == (-(found.high or 0), -(found.low or 0))


def test_one_recording_is_written_in_the_singular_and_has_no_effect() -> None:
    found = alone(1)
    assert found == CriterionComparison(
        "delay", "unknown", 1, 1, 10.0, 11.0, 1.0, None, None, None, None, "s",
        "+1 s in 1 pair of 1 recording: 5 recordings are needed to rule out chance",
    )  # fmt: skip


def test_as_many_recordings_as_are_needed_can_say_that_it_is_the_same() -> None:
    assert alone(1, -1, 2, -2, 3).verdict == "same"
    assert alone(1, -1, 2, -2).verdict == "unknown"


def test_where_nothing_differs_two_recordings_are_enough_to_say_so() -> None:
    found = alone(0, 0)
    assert (found.verdict, found.chance, found.effect) == ("same", 1.0, None)
    assert found.message == "no figure differs in 2 pairs of 2 recordings"


def test_more_criteria_take_more_recordings() -> None:
    """Of 5 recordings none can show that one of two is worse; of 6 both are, at 2/64."""
    five = judged([of(1, 2, 3, 4, 5), of(2, 2, 2, 2, 2)])
    assert [one.verdict for one in five] == ["unknown"] * 2
    assert five[0].message == (
        "+3 s in 5 pairs of 5 recordings: 6 recordings are needed to rule out chance"
    )
    six = judged([of(1, 2, 3, 4, 5, 6), of(2, 2, 2, 2, 2, 2)])
    assert [one.verdict for one in six] == ["worse"] * 2
    assert [one.chance for one in six] == [pytest.approx(1.25 * 2 / 64)] * 2
    # One that differs in a single recording is a question, too.
    for others in ((0, 0, 0, 1), (4, 3, 2, 1)):
        two = judged([of(1, 2, 3, 4), of(*others)])
        assert "6 recordings are needed" in two[0].message
    # Of four recordings, one that does not differ takes none from the other.
    four = judged([of(1, 2, 3, 4), of(0, 0, 0, 0)])
    assert [one.verdict for one in four] == ["unknown", "same"]
    assert "5 recordings are needed" in four[0].message


@pytest.mark.parametrize("alike", [0, 8, 56])
def test_where_few_of_many_recordings_differ_no_find_is_possible(alike: int) -> None:
    """All four are much worse, which is chance in one of 16 comparisons, however many are alike."""
    found = alone(*[0] * alike, 9, 9, 9, 9)
    assert found.verdict == "unknown"
    differ = ", of which 4 differ" if alike else ""
    assert found.message.endswith(
        f" recordings{differ}: 5 recordings are needed to rule out chance"
    )
    assert alone(*[0] * alike, 9, 9, 9, 9, 9).verdict == "worse"


@pytest.mark.parametrize("rounds", [3, 5, 7])
def test_the_rounding_of_means_is_no_difference(rounds: int) -> None:
    """The mean of three times 0.05 is not 0.05 to the last bit."""
    figures = [0.05, 0.07, 0.35, 0.1, 0.3, 1e9 / 7]
    means = [sum([figure] * rounds) / rounds for figure in figures]
    [found] = judged([Measured("delay", "s", "lower", 6, figures, means)])
    assert (found.verdict, found.message[:17]) == ("same", "no figure differs")
    [found] = judged(
        [Measured("delay", "s", "lower", 6, figures, [f * (1 + 1e-9) for f in figures])]
    )
    assert found.verdict == "worse"


def test_the_effect_is_in_deviations_of_the_recordings_differences() -> None:
    found = judged([of(1, 2, 3, 4, 5), of(1, 1, 1, 1, 2)])
    assert (found[0].effect, found[1].effect) == (None, None)  # unknown
    assert alone(1, 2, 3, 4, 5, 9).effect == pytest.approx(4 / math.sqrt(8))
    assert alone(1, 1, 1, 1, 2).effect == pytest.approx(1.2 / math.sqrt(0.2))
    assert alone(1, 1, 1, 1, 1).effect is None
    assert alone(0).effect is None


TO_AND_FRO = (1.0, -2.0, 3.0, -4.0, 5.0, -6.0, 7.0, -8.0)


def ends(differences: tuple[float, ...], worse: float, better: float) -> object:
    return SignFlips(np.array(differences)).ends(worse, better)


def test_the_interval_s_tails_are_what_the_correction_leaves_each_criterion() -> None:
    up = tuple(float(n) for n in range(1, 9))
    few = (0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0)  # its chance is 1/16 at least: it is not asked
    found = judged([of(*TO_AND_FRO), of(*up), of(*few)])
    assert [one.verdict for one in found] == ["same", "worse", "unknown"]
    # The find has half of the level, and leaves all of it to the other one.
    assert (found[1].low, found[1].high) == ends(up, 0.02, 0.005)
    assert (found[0].low, found[0].high) == ends(TO_AND_FRO, 0.04, 0.005)
    assert [one.chance for one in found] == [
        pytest.approx(1.25 * SignFlips(np.array(TO_AND_FRO)).chance_above()),
        pytest.approx(1.25 * 2 / 256),
        None,
    ]


def test_where_nothing_is_found_all_that_are_asked_share_the_level() -> None:
    fro_and_to = tuple(-each for each in TO_AND_FRO)
    found = judged([of(*TO_AND_FRO), of(*fro_and_to)])
    assert [one.verdict for one in found] == ["same", "same"]
    assert (found[0].low, found[0].high) == ends(TO_AND_FRO, 0.02, 0.005)
    assert (found[1].low, found[1].high) == ends(fro_and_to, 0.02, 0.005)


def test_a_figure_without_a_number_has_no_means() -> None:
    assert alone(1, math.nan) == CriterionComparison(
        "delay", "unknown", 2, 2, None, None, None, None, None, None, None, "s",
        "not every figure is a finite number",
    )  # fmt: skip


def test_a_pair_counts_where_both_versions_have_the_figure() -> None:
    rows = [row(n, v, figure=1.0 + n) for n in range(3) for v in ("released", "pr-812")]
    rows[1] = row(0, "pr-812", criteria=[])
    rows[2] = row(1, "released", criteria=[])
    [found] = only(rows).criteria
    assert (found.pairs, found.recordings, found.baseline, found.variant) == (1, 1, 3.0, 3.0)
    [nothing] = only(rows[:4]).criteria
    assert nothing == CriterionComparison(
        "latency", "unknown", 0, 0, None, None, None, None, None, None, None, "s",
        "no pair has it",
    )  # fmt: skip


def test_a_recording_s_figure_is_the_mean_of_its_pairs_means() -> None:
    rows = []
    for fragment, bag, before, after in (
        (0, "pvc://r/a", (1.0, 3.0), (5.0, 7.0)),  # 2 and 6
        (1, "pvc://r/a", (4.0, 4.0), (4.0, 4.0)),
        (2, "pvc://r/b", (9.0, 9.0), (1.0, 2.0)),
    ):
        for variant, figures in (("released", before), ("pr-812", after)):
            rows += [
                row(fragment, variant, figure=figure, bag=bag, round=n)
                for n, figure in enumerate(figures)
            ]
    found = only(rows).criteria[0]
    assert (found.pairs, found.recordings) == (3, 2)
    assert (found.baseline, found.variant, found.difference) == (6.0, 3.25, -2.75)


@pytest.mark.parametrize("most", [1.7e308, -1.7e308])
def test_figures_that_overflow_are_undecided(most: float) -> None:
    """An own evaluator may say any number; sums of these are none."""
    turned = Measured("own", "", "lower", 5, [-most, 0, 0, 0, 0], [most, 1.0, 1.0, 1.0, 1.0])
    added = Measured("own", "", "lower", 5, [0.0] * 5, [most, most, 1.0, 1.0, 1.0])
    for one in (turned, added):
        [found] = judged([one])
        assert (found.verdict, found.variant) == ("unknown", None)
        assert found.message == "not every figure is a finite number"
