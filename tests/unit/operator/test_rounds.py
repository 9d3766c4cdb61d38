"""Which drivers can be asked, and when those that can't are looked for."""

import pytest

from bagpipe_operator.jobs.driver.rounds import Rounds, serves
from tests.unit.operator.builders import Clock, PodBuilder, make_driver
from tests.unit.operator.world import UID


@pytest.mark.parametrize(
    ("driver", "can_be_asked"),
    [
        (make_driver("x"), False),
        (make_driver("x").running(ip=""), False),
        (make_driver("x").running(), True),
        (make_driver("x").running().ended(1), False),
    ],
)
def test_a_driver_can_be_asked_while_it_runs_and_has_an_address(
    driver: PodBuilder, can_be_asked: bool
) -> None:
    assert serves(driver.view()) is can_be_asked


def test_a_driver_that_waits_is_looked_for_thirty_seconds_after_it_was_last() -> None:
    clock = Clock()
    rounds, driver = Rounds(clock.monotonic), make_driver("x").view()
    for _ in range(2):
        assert not rounds.due(driver)
        clock.advance(29.5)
        assert not rounds.due(driver)
        clock.advance(0.5)
        assert rounds.due(driver)
        clock.advance(7)
        assert rounds.due(driver)
        rounds.forget(UID)


def test_the_driver_of_another_attempt_waits_for_its_own_thirty_seconds() -> None:
    clock = Clock()
    rounds = Rounds(clock.monotonic)
    assert not rounds.due(make_driver("x").view())
    clock.advance(30)
    assert not rounds.due(make_driver("x", attempt=2).view())


def test_a_driver_that_needs_no_look_takes_none_of_the_others_turns() -> None:
    """Of 600 that wait each is looked for once in 60 s; of 300 in 30 s."""
    clock = Clock()
    rounds = Rounds(clock.monotonic)
    drivers = [make_driver(f"j{number}").view() for number in range(600)]
    assert not any(rounds.due(driver) for driver in drivers)
    clock.advance(30)
    assert not any(rounds.due(driver) for driver in drivers)
    for driver in drivers[300:]:
        rounds.forget(driver.job_uid)
    assert all(rounds.due(driver) for driver in drivers[:300])


def test_a_silent_driver_is_looked_for_at_once_and_then_as_those_that_wait() -> None:
    clock = Clock()
    rounds, driver = Rounds(clock.monotonic), make_driver("x").running().view()
    assert rounds.due(driver, at_once=True)
    for _ in range(3):
        rounds.looked(driver)
        clock.advance(29.5)
        assert not rounds.due(driver, at_once=True)
        clock.advance(0.5)
        assert rounds.due(driver, at_once=True)
    rounds.forget(UID)
    assert rounds.due(driver, at_once=True)
