"""What is gone stays gone, whichever answer about it is processed after its end."""

from typing import Any

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.departed import MOST_DEPARTED, Departed
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.view import View
from bagpipe_operator.jobs.watch import Watch
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.schedules.view import ScheduledJob, Schedules, ScheduleView
from tests.unit.operator.builders import make_driver, make_job
from tests.unit.operator.fakes import FakeApi
from tests.unit.operator.schedules.world import UID as SCHEDULE_UID
from tests.unit.operator.schedules.world import make_job as made_by_schedule
from tests.unit.operator.schedules.world import make_schedule, name_of
from tests.unit.operator.world import UID, World


class OvertakenApi(FakeApi):
    """A deletion's event is delivered while the answer to a call is on its way."""

    overtaken: str = ""
    watch: Watch

    async def patch_status(self, *args: Any, **more: Any) -> Json:
        return self._overtaken("patch", await super().patch_status(*args, **more))

    async def get_job(self, namespace: str, name: str) -> Json:
        return self._overtaken("get", await super().get_job(namespace, name))

    def _overtaken(self, call: str, answer: Json) -> Json:
        if call == self.overtaken:
            gone = self.objects.pop(("jobs", "x"))
            self.watch.job_event({"type": "DELETED", "object": gone})
        return answer


def overtaken_world(call: str) -> World:
    world, queue = World(), WorkQueue()
    api = OvertakenApi(dict(world.api.objects))
    api.watch, api.overtaken = Watch(world.view, queue, JobMetrics(world.view, queue)), call
    world.api = api
    world.restart()
    return world


async def test_a_write_that_is_answered_after_the_deletion_s_event_brings_no_job_back() -> None:
    world = overtaken_world("patch")
    await world.reconcile()
    assert world.view.job(UID) is None
    await world.reconcile()
    assert list(world.view.jobs()) == []


async def test_a_look_that_is_answered_after_the_deletion_s_event_brings_no_job_back() -> None:
    world = overtaken_world("get")
    world.api.fail("patch status", ApiError(409, "Conflict", "the object has been modified"))
    with pytest.raises(ApiError, match="409"):
        await world.reconcile()
    assert world.view.job(UID) is None


def test_a_job_that_the_census_missed_stays_away_too() -> None:
    view, job = View(), make_job("x").view()
    view.put_job(job)
    view.forget(UID)
    assert (view.put_job(job), view.job(UID)) == (False, None)


def test_a_pod_s_label_keeps_no_job_away() -> None:
    """Anybody may write any UID, also of a job in a namespace that can't be listed for a time."""
    view = View()
    view.put_pod(make_driver("x").view())
    view.forget(UID)
    assert view.put_job(make_job("x").view())


def test_a_job_of_the_same_name_is_another_one() -> None:
    view, job = View(), make_job("x").view()
    view.put_job(job)
    view.drop_job(UID)
    other = make_job("x")
    other.object["metadata"]["uid"] = "uid-of-another"
    assert view.put_job(JobView.from_object(other.object))


def test_the_latest_that_are_gone_are_remembered_and_no_more() -> None:
    gone = Departed()
    for number in range(MOST_DEPARTED + 1):
        gone.add(f"uid-{number}")
    gone.add("uid-1")  # a second word of it: it is the latest one now
    gone.add("uid-new")
    remembered = [uid in gone for uid in ("uid-0", "uid-1", "uid-2", "uid-3", "uid-new")]
    assert remembered == [False, True, False, True, True]


def test_a_list_that_is_older_than_a_deletion_brings_no_job_of_a_schedule_back() -> None:
    view, job = Schedules(), ScheduledJob.from_object(made_by_schedule(name_of(1)))
    view.put_job(job)
    view.remove_job(job)
    view.replace_jobs(SCHEDULE_UID, [job])
    assert view.jobs(SCHEDULE_UID) == ()
    assert view.put_job(job) is False


def test_a_job_that_has_lost_its_schedule_may_find_it_again() -> None:
    view, job = Schedules(), ScheduledJob.from_object(made_by_schedule(name_of(1)))
    view.put_job(job)
    view.drop_job(job)
    assert view.put_job(job) is True


def test_a_schedule_that_is_gone_stays_away() -> None:
    view, schedule = Schedules(), ScheduleView.from_object(make_schedule())
    view.put_schedule(schedule)
    view.drop_schedule(schedule.uid)
    assert (view.put_schedule(schedule), view.schedule(schedule.uid)) == (False, None)
