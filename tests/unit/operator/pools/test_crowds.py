"""Jobs without room, by namespace: a loop of them is one crowd."""

from datetime import datetime, timedelta

from bagpipe_operator.jobs.pools.crowds import Crowds
from bagpipe_operator.jobs.pools.warm import Crowd
from tests.unit.operator.builders import START


def after(seconds: float) -> datetime:
    return START + timedelta(seconds=seconds)


def test_jobs_that_come_one_after_the_other_have_lacked_room_since_the_first() -> None:
    crowds = Crowds(300.0)
    for number in range(100):
        crowds.note(f"job-{number}", "lanes", on_nodes=True, now=after(10 * number))
        crowds.forget(f"job-{number - 1}")
        assert crowds.now() == [Crowd("lanes", START, on_nodes=True)]
    crowds.forget("job-99")
    assert crowds.now() == []


def test_a_namespace_that_had_room_for_long_enough_begins_again() -> None:
    crowds = Crowds(300.0)
    for at, since in ((0, 0), (300, 0), (600.1, 600.1), (700, 600.1)):
        crowds.note("job", "lanes", on_nodes=True, now=after(at))
        assert crowds.now() == [Crowd("lanes", after(since), on_nodes=True)], at


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
    crowds.note("a", "lanes", on_nodes=True, now=after(0))
    assert crowds.now() == [Crowd("lanes", after(0), on_nodes=True)]
