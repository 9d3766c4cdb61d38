"""The moments at which something becomes true of a job or a pod, to the second."""

from dataclasses import replace
from datetime import timedelta

import pytest

from bagpipe_operator.api.conditions import timestamp
from bagpipe_operator.jobs.driver.ending import Ending
from bagpipe_operator.jobs.policies import places, replacement, suspend
from tests.unit.operator.builders import START, PodBuilder, make_driver, make_job


@pytest.mark.parametrize(
    ("lost", "seconds"),
    [(1, 10), (2, 20), (3, 40), (4, 80), (5, 160), (6, 300), (7, 300), (10**9, 300)],
)
def test_each_lost_driver_doubles_the_pause_before_the_next_up_to_five_minutes(
    lost: int, seconds: float
) -> None:
    assert replacement.pause_seconds(lost) == seconds


@pytest.mark.parametrize(
    ("left", "pauses"),
    [
        (-1, False),
        (-0.5, False),
        (0, False),
        (0.5, True),
        (1, True),
        (300, True),
        (303, True),
        (600, True),
        # Of a clock that was ahead: nothing to wait for.
        (600.5, False),
        (86400, False),
    ],
)
def test_a_pause_lasts_until_its_moment_unless_no_pause_is_that_long(
    left: float, pauses: bool
) -> None:
    job = make_job("x").with_status(nextAttemptTime=timestamp(START)).view()
    assert replacement.pausing(job, START - timedelta(seconds=left)) is pauses


@pytest.mark.parametrize(
    ("lost", "replaced"), [(0, True), (1, True), (2, True), (3, False), (4, False)]
)
def test_as_many_lost_drivers_are_replaced_as_the_limit_says_and_who_is_evicted_always(
    lost: int, replaced: bool
) -> None:
    job = make_job("x").with_status(lostDrivers=lost).view()
    crashed = Ending(False, "DriverFailed", "It crashed.", lost=True)
    assert replacement.may_be_replaced(job, crashed, 3) is replaced
    assert replacement.may_be_replaced(job, replace(crashed, voluntary=True), 3)


def test_a_job_that_lost_no_driver_has_no_pause() -> None:
    assert not replacement.pausing(make_job("x").view(), START)


def beside_a_proxy(finished: bool = True) -> PodBuilder:
    """A driver that ended at START, in a pod in which another container runs on."""
    state = {"exitCode": 0, "reason": "Completed", "finishedAt": timestamp(START)}
    pod = make_driver("x").with_container("proxy", {"running": {}})
    pod.phase = "Running"
    return pod.with_container("driver", {"terminated": state} if finished else {"running": {}})


@pytest.mark.parametrize(
    ("seconds", "lingers"), [(0, False), (29.5, False), (30, True), (30.5, True), (3600, True)]
)
def test_a_pod_lingers_30_s_after_its_driver_ended(seconds: float, lingers: bool) -> None:
    now = START + timedelta(seconds=seconds)
    pod = beside_a_proxy().view()
    assert places.lingers(pod, now) is places.needs_stop(pod, now) is lingers


def test_a_pod_that_goes_or_has_a_driver_that_runs_does_not_linger() -> None:
    late = START + timedelta(seconds=3600)
    ended = beside_a_proxy()
    ended.phase = "Succeeded"
    for pod in (ended, beside_a_proxy().deleting()):
        assert not places.lingers(pod.view(), late)
        assert not places.needs_stop(pod.view(), late)
    for pod in (beside_a_proxy(finished=False), make_driver("x")):
        assert not places.lingers(pod.view(), late)
        assert places.needs_stop(pod.view(), late)


@pytest.mark.parametrize(
    ("suspended", "generation", "reported"),
    [("True", 1, True), ("True", 0, False), ("False", 1, False), ("False", 0, False)],
)
def test_a_suspension_is_reported_when_the_status_states_it_of_the_job_as_it_is(
    suspended: str, generation: int, reported: bool
) -> None:
    job = make_job("x").with_spec("suspend", True)
    job = job.with_status(
        conditions=[{"type": "Suspended", "status": suspended}], observedGeneration=generation
    )
    assert suspend.is_reported(job.view()) is suspend.rests(job.view()) is reported
    assert not suspend.rests(job.with_spec("suspend", False).view())
