"""Jobs without room, by namespace: a loop of them is one crowd."""

from datetime import datetime, timedelta

import pytest

from bagpipe_operator.jobs.pools.crowds import Crowds
from bagpipe_operator.jobs.pools.warm import Crowd, Pooling, WarmDriver, leaving
from tests.unit.operator.builders import START


def after(seconds: float) -> datetime:
    return START + timedelta(seconds=seconds)


def others(idle_since: float) -> WarmDriver:
    return WarmDriver("uid", "depths", "lane", "shape", after(idle_since))


def ended(crowds: Crowds, idle_since: float, at: float) -> bool:
    """Whether another namespace's driver that has waited since then gives its room."""
    pooling = Pooling(enabled=True, idle_seconds=300.0, per_namespace=2)
    return bool(leaving([others(idle_since)], crowds.now(), pooling, after(at)))


def test_jobs_that_come_one_after_the_other_end_the_pools_of_others_once_in_a_while() -> None:
    crowds = Crowds(300.0)
    found = []
    for number in range(100):
        crowds.note(f"job-{number}", "lanes", on_nodes=True, now=after(10 * number))
        crowds.forget(f"job-{number - 1}")
        found += [crowd.since for crowd in crowds.now()]
    assert sorted(set(found)) == [after(0), after(310), after(620), after(930)]
    crowds.forget("job-99")
    assert crowds.now() == []


@pytest.mark.parametrize("on_nodes", [False, True])
def test_a_job_that_waits_for_ever_is_no_crowd_to_those_that_come_later(on_nodes: bool) -> None:
    crowds = Crowds(300.0)
    for second in range(0, 36_000, 30):
        crowds.note("waits", "lanes", on_nodes=on_nodes, now=after(second))
    assert not ended(crowds, 35_900, at=36_000)
    crowds.note("fits", "lanes", on_nodes=True, now=after(36_000))
    assert ended(crowds, 35_900, at=36_001)


def test_each_namespace_has_its_own_and_a_quota_s_is_another_than_the_nodes() -> None:
    crowds = Crowds(300.0)
    crowds.note("a", "lanes", on_nodes=True, now=after(1))
    crowds.note("b", "lanes", on_nodes=False, now=after(2))
    crowds.note("c", "depths", on_nodes=False, now=after(3))
    quota, nodes = Crowd("lanes", after(2)), Crowd("lanes", after(1), on_nodes=True)
    assert crowds.now() == [Crowd("depths", after(3)), quota, nodes]


def test_a_clock_that_was_ahead_is_no_reason_to_remember_for_ever() -> None:
    crowds = Crowds(300.0)
    crowds.note("a", "lanes", on_nodes=True, now=after(1e6))
    crowds.note("b", "lanes", on_nodes=True, now=after(0))
    assert crowds.now() == [Crowd("lanes", after(0), on_nodes=True)]


def test_what_is_over_is_forgotten() -> None:
    crowds = Crowds(300.0)
    for number in range(1000):
        crowds.note("job", f"namespace-{number}", on_nodes=True, now=after(301 * number))
    assert len(crowds._since) <= 2
