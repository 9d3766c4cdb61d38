"""Each step of a handover; tests/unit/between has it with drivers, in any order."""

from datetime import datetime, timedelta

import pytest

from bagpipe_operator.jobs.pools.claim import Act, Claim, Received, State, Step, step
from tests.unit.operator.builders import START

STEPS: list[tuple[State, Received, State | None, Act]] = [
    ("offered", "taken", "taken", "run"),
    ("offered", "ended", None, "read"),
    ("offered", "refused", None, "cold"),
    ("offered", "gone", None, "cold"),
    ("offered", "silent", "offered", "offer"),
    ("taken", "taken", "taken", "run"),
    ("taken", "ended", None, "read"),
    ("taken", "silent", "taken", "run"),
    ("taken", "refused", "taken", "run"),
    ("taken", "gone", None, "replace"),
    ("fenced", "ended", None, "read"),
    ("fenced", "silent", "fenced", "delete"),
    ("fenced", "taken", "fenced", "delete"),
    ("fenced", "refused", None, "cold"),
    ("fenced", "gone", None, "cold"),
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
    if (state, received) == ("offered", "silent"):
        then, act = "fenced", "delete"
    expected = Step(Claim("d", START, then) if then else None, act)
    assert step(Claim("d", START, state), received, after(late)) == expected


def test_a_claim_begins_as_an_offer() -> None:
    assert Claim("d", START).state == "offered"
