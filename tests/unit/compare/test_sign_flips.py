"""The exact test by sign flips, held to scipy's and to its own interval."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from bagpipe.compare.correction import family_size, holm
from bagpipe.compare.sign_flips import EXACT_BELOW, SignFlips


def test_the_chance_is_the_share_of_sign_flips_that_give_as_much() -> None:
    test = SignFlips(np.array([1.0, 2.0, 3.0, 4.0, -0.5]))
    # Of 32 ways these two give as much: all as they are, and the smallest one turned.
    assert test.chance_above() == 2 / 32
    assert test.chance_below() == 31 / 32
    assert test.least_chance == 1 / 32


def test_a_difference_of_zero_is_no_evidence() -> None:
    test = SignFlips(np.array([0.0, 0.0, 1.0, 1.0, 1.0]))
    assert (test.differing, test.least_chance, test.chance_above()) == (3, 1 / 8, 1 / 8)


values = st.lists(st.integers(-50, 50).map(lambda n: n / 8), min_size=2, max_size=9)


@given(values)
@settings(max_examples=40, deadline=None)
def test_scipy_s_permutation_test_says_the_same(differences: list[float]) -> None:
    given_ = np.array(differences)
    test = SignFlips(given_)
    for alternative, ours in (("greater", test.chance_above()), ("less", test.chance_below())):
        theirs = stats.permutation_test(
            (given_,), np.mean, permutation_type="samples", alternative=alternative,
            n_resamples=np.inf,
        ).pvalue  # fmt: skip
        assert ours == pytest.approx(theirs)


@given(st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=30))
@settings(max_examples=40, deadline=None)
def test_the_interval_holds_the_mean_turns_with_the_sides_and_agrees(given_: list[float]) -> None:
    differences = np.array(given_)
    forth, back = SignFlips(differences), SignFlips(-differences)
    low, high = forth.ends(0.04, 0.04)
    turned_low, turned_high = back.ends(0.04, 0.04)
    assert low is not None
    assert high is not None
    slack = 1e-6 * max(1.0, *map(abs, given_))
    assert low - slack <= differences.mean() <= high + slack
    assert turned_low == pytest.approx(-high, abs=slack)
    assert turned_high == pytest.approx(-low, abs=slack)
    # Zero is outside of the interval just if the test refuses it.
    assert (low > 0) == (forth.chance_above() <= 0.04)
    assert (high < 0) == (forth.chance_below() <= 0.04)


def test_so_few_recordings_give_no_end() -> None:
    assert SignFlips(np.array([1.0, 2.0, 3.0])).ends(0.04, 0.2) == (None, 3.0)


def test_many_recordings_are_resampled_the_same_way_each_time() -> None:
    differences = np.linspace(-1.0, 1.5, EXACT_BELOW + 10)
    first, again = SignFlips(differences), SignFlips(differences)
    assert first.chance_above() == again.chance_above()
    exact = stats.permutation_test(
        (differences,), np.mean, permutation_type="samples", alternative="greater",
        n_resamples=50_000, rng=np.random.default_rng(1),
    ).pvalue  # fmt: skip
    assert first.chance_above() == pytest.approx(exact, abs=0.01)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12))
def test_holm_s_correction_steps_down(chances: list[float]) -> None:
    corrected = holm(chances)
    order = sorted(range(len(chances)), key=chances.__getitem__)
    assert corrected[order[0]] == min(1.0, len(chances) * chances[order[0]])
    assert all(one >= raw for one, raw in zip(corrected, chances, strict=True))
    assert [corrected[at] for at in order] == sorted(corrected)


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([]) == []


def test_questions_that_can_t_be_answered_don_t_share_the_level() -> None:
    assert family_size([1 / 4096] * 10, 0.04) == 10
    assert family_size([1.0] * 9 + [1 / 64], 0.04) == 1
    # 1/64 is below 0.04 / 2 and above 0.04 / 3.
    assert family_size([1 / 64] * 10, 0.04) == 3
    # One of just its share can be answered.
    assert family_size([0.02] * 3, 0.04) == 3
    assert family_size([0.0201] * 3, 0.04) == 2
    assert family_size([], 0.04) == 1
