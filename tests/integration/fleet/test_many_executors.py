"""What the bench of fleets measures with: executors, real and simulated, of which a third goes."""

import pytest

from tests.bench.fleet.driver import in_its_own_process

pytestmark = pytest.mark.integration

CASES = 200


def test_simulated_executors_end_what_the_driver_gives_them_and_no_more() -> None:
    """`measure` itself refuses a run in which not each case has one row."""
    found = in_its_own_process("simulated", 20, CASES)
    assert (found.executors, found.cases, found.again, found.lost) == (20, CASES, 0, 0)
    assert found.used > 0
    assert found.jvm > found.python > 0


@pytest.mark.parametrize(("kind", "count", "lost"), [("real", 3, 1), ("simulated", 20, 6)])
def test_a_third_is_lost_at_once_and_no_case_with_it(kind: str, count: int, lost: int) -> None:
    found = in_its_own_process(kind, count, 6 * count, case_seconds=0.5, lose=True)
    assert found.lost == lost
    assert found.noticed > 0
    assert found.after_the_loss > 0
