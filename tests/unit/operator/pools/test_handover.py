"""Each step of a handover; tests/unit/between has it with drivers, in any order."""

from datetime import datetime, timedelta

import pytest

from bagpipe_operator.jobs.claim import Claim, State
from bagpipe_operator.jobs.pools.handover import Act, Received, Step, step
from tests.unit.operator.builders import START

STEPS: list[tuple[State, Received, State | None, Act]] = [
    ("Offered", "taken", "Taken", "run"),
    ("Offered", "ended", "Taken", "read"),
    ("Offered", "refused", None, "cold"),
    ("Offered", "gone", None, "cold"),
    ("Offered", "silent", "Offered", "offer"),
    ("Taken", "taken", "Taken", "run"),
    ("Taken", "ended", "Taken", "read"),
    ("Taken", "silent", "Taken", "run"),
    ("Taken", "refused", "Taken", "run"),
    ("Taken", "gone", None, "replace"),
    ("Fenced", "ended", "Taken", "read"),
    ("Fenced", "silent", "Fenced", "delete"),
    ("Fenced", "taken", "Fenced", "delete"),
    ("Fenced", "refused", None, "cold"),
    ("Fenced", "gone", None, "cold"),
]


def after(seconds: float) -> datetime:
    return START + timedelta(seconds=seconds)


@pytest.mark.parametrize(("state", "received", "then", "act"), STEPS)
def test_a_step_within_the_deadline(
    state: State, received: Received, then: State | None, act: Act
) -> None:
    expected = Step(Claim("d", START, then) if then else None, act)
    assert step(Claim("d", START, state), received, after(9.999)) == expected


@pytest.mark.parametrize("late", [10, 10.5, 999])
@pytest.mark.parametrize(("state", "received", "then", "act"), STEPS)
def test_past_it_only_silence_is_another_matter(
    state: State, received: Received, then: State | None, act: Act, late: float
) -> None:
    if (state, received) == ("Offered", "silent"):
        then, act = "Fenced", "delete"
    expected = Step(Claim("d", START, then) if then else None, act)
    assert step(Claim("d", START, state), received, after(late)) == expected


@pytest.mark.parametrize(("ahead", "then"), [(9.9, "Offered"), (10.0, "Fenced"), (9e5, "Fenced")])
def test_a_claim_of_a_clock_that_was_ahead_is_not_waited_for(ahead: float, then: State) -> None:
    claim = Claim("d", after(ahead), "Offered")
    found = step(claim, "silent", START).claim
    assert found is not None
    assert found.state == then


def test_a_claim_begins_as_an_offer() -> None:
    assert Claim("d", START).state == "Offered"
