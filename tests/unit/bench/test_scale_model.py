"""The simulated fleet: known answers, and that more workers never take longer."""

import random
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.bench.scale_model import Costs, efficiency, makespan, tail

FREE = Costs(0.0, 0.0)


def test_without_costs_a_fleet_is_linear() -> None:
    assert makespan([2.0] * 8, 1, FREE) == 16
    assert makespan([2.0] * 8, 4, FREE) == 4
    assert efficiency([2.0] * 8, 4, FREE) == 1


def test_a_workers_cost_is_paid_for_each_case() -> None:
    assert makespan([2.0] * 4, 2, Costs(0.0, 0.5)) == 5
    assert efficiency([2.0] * 4, 2, Costs(0.0, 0.5)) == pytest.approx(0.8)


def test_a_driver_hands_out_one_case_at_a_time() -> None:
    # Ten workers wait for a driver that needs a second for each case.
    assert makespan([1.0] * 10, 10, Costs(1.0, 0.0)) == 11


def test_a_straggler_ends_the_job() -> None:
    assert makespan([1.0, 1.0, 9.0], 2, FREE) == 10


@given(
    st.lists(st.floats(0.1, 100), min_size=1, max_size=30),
    st.integers(1, 10),
    st.floats(0, 2),
    st.floats(0, 2),
)
def test_bounds(cases: list[float], workers: int, driver: float, worker: float) -> None:
    costs = Costs(driver, worker)
    took = makespan(cases, workers, costs)
    assert took <= sum(cases) + len(cases) * (driver + worker) + 1e-6
    assert took >= max(cases) + driver + worker - 1e-6
    assert 0 < efficiency(cases, workers, costs) <= 1 + 1e-9


def test_the_tail_is_what_the_last_twentieth_takes() -> None:
    assert tail([1.0] * 19 + [5.0], 20, FREE) == 4
    assert tail([1.0] * 20, 20, FREE) == 0


def test_begun_longest_first_a_job_has_half_the_tail_or_less() -> None:
    # Drawn, not recorded: seconds that no recording's length foretells, as of stacks that search.
    shares = []
    for seed in range(20):
        chance = random.Random(seed)  # noqa: S311  no secret
        cases = [chance.lognormvariate(2.5, 0.8) for _ in range(400)]
        # The next run of a case takes about as long, and what is expected is the earlier one.
        again = [seconds * chance.uniform(0.9, 1.1) for seconds in cases]
        order = sorted(range(400), key=lambda n: -cases[n])
        shares.append(tail([again[n] for n in order], 16, FREE) / tail(again, 16, FREE))
    assert statistics.median(shares) <= 0.5
