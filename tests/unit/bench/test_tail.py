"""What the bench of the tail reckons with."""

import pytest

from tests.bench.tail import SLOTS, durations, in_any_order, simulated, tail


def test_the_tail_is_from_the_95th_of_100_to_the_last() -> None:
    assert tail([float(n) for n in range(1, 101)]) == 5.0
    assert tail([100.0, *map(float, range(1, 20))]) == 81.0


def test_the_next_case_goes_to_the_slot_that_is_free_first() -> None:
    assert simulated([3.0, 1.0, 1.0, 2.0], 2) == [3.0, 1.0, 2.0, 4.0]


def test_of_2000_orders_none_has_as_short_a_tail_as_the_longest_first() -> None:
    seconds = durations()
    first = tail(simulated(sorted(seconds, reverse=True), SLOTS))
    others = sorted(in_any_order(seconds))
    assert (first, others[0], others[len(others) // 2]) == pytest.approx(
        (0.285, 0.596, 4.942), abs=1e-3
    )
