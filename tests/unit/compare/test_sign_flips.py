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


def test_so_few_recordings_give_no_end() -> None:
    test = SignFlips(np.array([1.0, 2.0, 3.0]))
    assert test.ends(0.04, 0.2) == (None, 3.0)
    assert test.ends(0.2, 0.04) == (1.0, None)
    # One of eight ways is just an eighth, and a little less is none.
    assert test.ends(0.125, 0.125) == (1.0, 3.0)
    assert test.ends(0.1249, 0.1249) == (None, None)


def test_the_means_that_are_left_out_are_counted_from_both_ends() -> None:
    # Of 1, 2 and 3 alone and together: 1, 1.5, 2, 2, 2, 2.5, 3.
    test = SignFlips(np.array([1.0, 2.0, 3.0]))
    found = [test.ends(ways / 8, ways / 8) for ways in (1, 2, 3, 6, 7)]
    assert found == [(1.0, 3.0), (1.5, 2.5), (2.0, 2.0), (2.5, 1.5), (3.0, 1.0)]


def test_up_to_fourteen_recordings_are_exact_and_more_to_one_in_as_many_ways() -> None:
    for recordings in (13, 14, 17):
        ways = 2 ** min(recordings, 14)
        test = SignFlips(np.arange(1.0, recordings + 1))
        assert (test.least_chance, test.chance_above()) == (1 / ways, 1 / ways)
        assert SignFlips(-np.ones(recordings)).chance_above() == 1.0


def test_a_random_way_that_leaves_all_recordings_out_gives_no_mean_that_is_no_number() -> None:
    """Of 15 recordings one of the 16,384 random ways does: it counts as a mean of zero."""
    test = SignFlips(np.ones(15))
    assert (test.least_chance, test.chance_above()) == (1 / 16_384, 2 / 16_384)
    assert test.ends(1 / 16_384, 1 / 16_384) == (0.0, 1.0)


def test_amounts_that_cancel_out_but_for_their_rounding_are_as_much_as_nothing() -> None:
    """0.1 + 0.2 - 0.3 is 5.6e-17 to a computer. Of eight ways five give zero or more."""
    for scale in (1.0, 1e-9, 1e9):
        test = SignFlips(scale * np.array([0.1, 0.2, -0.3]))
        assert (test.chance_above(), test.chance_below()) == (5 / 8, 5 / 8)
    # What differs by more than rounding does is another sum.
    assert SignFlips(np.array([0.1, 0.2, -0.3 + 1e-9])).chance_above() == 4 / 8


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
