"""With how many digits what is drawn is kept."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe.evaluate.rounding import digits_for, rounded, rounded_within


@pytest.mark.parametrize(
    ("values", "digits"),
    [
        ([], 3),
        ([7.0], 3),
        ([-7.0, -7.0], 3),
        ([0.0, 7.0], 3),
        ([-7.0, 7.0], 3),
        # A range of a tenth of the size needs one digit more, just less than that none.
        ([10.0, 9.0], 4),
        ([10.0, 8.9], 3),
        ([-10.0, -9.0], 4),
        # Metres of a map, of which a drive changes the last hundred.
        ([5_000_000.0, 5_000_100.0], 7),
        # As many as a float has.
        ([1e12, 1e12 + 0.001], 15),
        ([1e300, 1e300 * (1 + 2e-16)], 15),
        ([0.0, math.inf], 3),
        ([-1e308, 1e308], 3),
        ([0.0, math.nan], 3),
    ],
)
def test_a_small_range_far_from_zero_has_more_digits(values: list[float], digits: int) -> None:
    assert digits_for(values, 3) == digits


def test_as_many_digits_as_are_asked_for_but_what_a_float_has() -> None:
    assert (digits_for([0.0, 7.0], 5), digits_for([0.0, 7.0], 15)) == (5, 15)
    assert digits_for([100.0, 99.0], 14) == 15


@pytest.mark.parametrize(
    ("value", "digits", "kept"),
    [(1234.567, 6, 1234.57), (-0.00123456, 3, -0.00123), (5_000_049.0, 3, 5e6), (9.996, 3, 10.0)],
)
def test_a_value_is_kept_with_so_many_digits(value: float, digits: int, kept: float) -> None:
    assert rounded(value, digits) == kept


@pytest.mark.parametrize(
    ("value", "low", "high", "kept"),
    [
        (9.996, None, None, 10.0),
        # 10 would not be below the least any more, nor above the most.
        (9.996, 10.0, None, 9.996),
        (10.04, None, 10.0, 10.04),
        # A bound itself is inside: what comes to lie on it from inside stays so.
        (10.04, 10.0, None, 10.0),
        (9.996, None, 10.0, 10.0),
        (9.996, 9.0, 11.0, 10.0),
        (9.996, 10.0, 11.0, 9.996),
        (-0.001234, 0.0, None, -0.00123),
    ],
)
def test_what_is_kept_lies_on_the_same_side_of_a_bound(
    value: float, low: float | None, high: float | None, kept: float
) -> None:
    assert rounded_within(value, 3, low, high) == kept


FINITE = st.floats(allow_nan=False, allow_infinity=False)


@given(FINITE, FINITE, FINITE)
def test_no_bound_is_crossed(value: float, low: float, high: float) -> None:
    kept = rounded_within(value, 3, low, high)
    assert (kept < low, kept > high) == (value < low, value > high)


@given(st.lists(st.floats(-1e9, 1e9), min_size=2))
def test_what_differs_by_a_hundredth_of_the_range_stays_different(values: list[float]) -> None:
    span = max(values) - min(values)
    digits = digits_for(values, 3)
    for one in values:
        if abs(one - values[0]) >= 0.01 * span > 1e-3:
            assert rounded(one, digits) != rounded(values[0], digits)
