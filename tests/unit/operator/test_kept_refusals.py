"""How long a refusal stands before the same is asked again, on a clock that the test turns."""

import pytest

from bagpipe_operator.jobs.pods.refusal import Refusal
from bagpipe_operator.jobs.troubles.lookout import LOOK_EVERY_SECONDS
from bagpipe_operator.jobs.troubles.refusals import Refusals
from tests.unit.operator.builders import make_job

QUOTA = Refusal("QuotaExceeded", "used up")
ACCOUNT = Refusal("ServiceAccountMissing", "no such account")
BUSY = Refusal("QuotaExceeded", "used up", lasting=False)
JOB = make_job("x").view()
STUCK = 30.0


class Asked:
    """Refusals of which each is asked when the test says so."""

    def __init__(self) -> None:
        self.now = 100.0
        self.refusals = Refusals(STUCK, lambda: self.now)

    def refused(self, after: float, refusal: Refusal = QUOTA, attempt: int = 1) -> None:
        self.now += after
        self.refusals.keep(JOB, attempt, refusal)

    def stands(self, after: float = 0.0, attempt: int = 1) -> bool:
        self.now += after
        return self.refusals.standing(JOB, attempt) is not None


def test_it_stands_until_the_next_look_is_due() -> None:
    asked = Asked()
    assert not asked.stands()
    asked.refused(after=0.0)
    assert asked.stands(after=LOOK_EVERY_SECONDS - 0.5)
    assert not asked.stands(after=0.5)
    assert not asked.stands(after=0.5)
    asked.refused(after=0.0)
    assert asked.stands()
    assert not asked.stands(attempt=2)


@pytest.mark.parametrize("over", [0.0, 0.5])
def test_one_that_lasts_is_asked_once_more_before_it_ends_its_job(over: float) -> None:
    asked = Asked()
    asked.refused(after=0.0)
    asked.refused(after=STUCK - 0.5)
    assert asked.stands()
    asked.now += 0.5 + over
    assert not asked.stands()


@pytest.mark.parametrize("other", [ACCOUNT, BUSY])
def test_another_refusal_has_a_time_of_its_own(other: Refusal) -> None:
    asked = Asked()
    asked.refused(after=0.0, refusal=other)
    asked.refused(after=STUCK - 0.5)
    asked.now += 0.5
    assert asked.stands()


def test_the_refusal_of_another_attempt_has_a_time_of_its_own() -> None:
    asked = Asked()
    asked.refused(after=0.0, attempt=1)
    asked.refused(after=STUCK - 0.5, attempt=2)
    asked.now += 0.5
    assert asked.stands(attempt=2)


def test_one_that_passes_by_itself_never_ends_a_job() -> None:
    asked = Asked()
    asked.refused(after=0.0, refusal=BUSY)
    asked.refused(after=10 * STUCK, refusal=BUSY)
    assert asked.stands()


def test_a_job_with_its_driver_has_no_refusal_any_more() -> None:
    asked = Asked()
    asked.refused(after=0.0)
    assert asked.refusals.asked(JOB.uid)
    asked.refusals.forget(JOB.uid)
    assert (asked.stands(), asked.refusals.asked(JOB.uid)) == (False, False)
