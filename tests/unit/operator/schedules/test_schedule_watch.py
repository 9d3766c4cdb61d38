"""What reaches the queue of schedules, what wakes them, and what is counted."""

import asyncio
from datetime import datetime, timedelta

import pytest
from prometheus_client import CollectorRegistry, generate_latest

from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.schedules.alarms import Alarms
from bagpipe_operator.schedules.loop import WORKERS, ScheduleLoop
from bagpipe_operator.schedules.metrics import ScheduleMetrics
from bagpipe_operator.schedules.view import ScheduledJob, Schedules, ScheduleView
from bagpipe_operator.schedules.watch import ScheduleWatch
from tests.unit.operator.schedules.world import (
    UID,
    World,
    make_job,
    make_schedule,
    minute,
    name_of,
)


@pytest.fixture
def watcher() -> ScheduleWatch:
    return ScheduleWatch(Schedules(), WorkQueue(), JobMetrics(View(), WorkQueue()))


async def test_a_schedule_and_its_jobs_ask_for_the_same_key(watcher: ScheduleWatch) -> None:
    watcher.schedule_event({"type": None, "object": make_schedule()})
    watcher.job_event({"type": "ADDED", "object": make_job(name_of(1))})
    assert len(watcher.queue) == 1
    assert await watcher.queue.get() == UID


async def test_a_job_s_progress_asks_for_nothing_and_its_end_does(watcher: ScheduleWatch) -> None:
    watcher.schedule_event({"type": None, "object": make_schedule()})
    watcher.job_event({"type": "ADDED", "object": make_job(name_of(1))})
    watcher.queue.done(await watcher.queue.get())
    running = make_job(name_of(1))
    running["status"] = {"cases": {"passed": 3}}
    watcher.job_event({"type": "MODIFIED", "object": running})
    assert len(watcher.queue) == 0
    watcher.job_event({"type": "MODIFIED", "object": make_job(name_of(1), "Complete")})
    assert len(watcher.queue) == 1


def test_a_job_whose_owner_is_written_again_and_again_is_kept_once(
    watcher: ScheduleWatch,
) -> None:
    """Owners are anybody's to write, and each would stay in the operator's memory."""
    job = make_job(name_of(1), "Complete")
    job["status"]["results"] = "s3://results/a"
    job["status"]["conditions"].append({"type": "Passed", "status": "True"})
    for number in range(100):
        job["metadata"]["resourceVersion"] = str(1000 + number)
        job["metadata"]["ownerReferences"][0]["uid"] = f"uid-{number}"
        watcher.job_event({"type": "MODIFIED", "object": job})
    view = watcher.view
    assert (len(view._jobs), view.uids()) == (1, ["uid-99"])
    job["metadata"]["ownerReferences"] = []
    watcher.job_event({"type": "MODIFIED", "object": job})
    assert (len(view._jobs), view.uids()) == (0, [])


def test_what_was_before_does_not_come_back(watcher: ScheduleWatch) -> None:
    """The API server's own list was ahead of the watch."""
    ended, begun = make_job(name_of(1), "Complete"), make_job(name_of(1))
    ended["metadata"]["resourceVersion"], begun["metadata"]["resourceVersion"] = "1000", "999"
    watcher.view.replace_jobs(UID, [ScheduledJob.from_object(ended)])
    watcher.job_event({"type": "MODIFIED", "object": begun})
    (job,) = watcher.view.jobs(UID)
    assert job.complete
    assert len(watcher.queue) == 0
    again = make_job(name_of(1), "Failed")
    again["metadata"]["resourceVersion"] = "1001"
    watcher.job_event({"type": "MODIFIED", "object": again})
    (job,) = watcher.view.jobs(UID)
    assert job.failed


def test_a_list_that_was_read_before_a_job_s_end_does_not_take_it_back(
    watcher: ScheduleWatch,
) -> None:
    """Nothing would report the end again: a weekly schedule would call it active for days."""
    ended, begun, other = make_job(name_of(1), "Complete"), make_job(name_of(1)), make_job("o")
    ended["metadata"]["resourceVersion"], begun["metadata"]["resourceVersion"] = "1000", "999"
    watcher.job_event({"type": "MODIFIED", "object": ended})
    watcher.job_event({"type": "ADDED", "object": other})
    watcher.view.replace_jobs(UID, [ScheduledJob.from_object(begun)])
    (job,) = watcher.view.jobs(UID)
    assert job.complete


def test_deletions_are_forgotten_and_strangers_ignored(watcher: ScheduleWatch) -> None:
    labelled = make_job("labelled-by-hand")
    del labelled["metadata"]["ownerReferences"]
    watcher.job_event({"type": "ADDED", "object": labelled})
    watcher.schedule_event({"type": "ADDED", "object": make_schedule()})
    watcher.job_event({"type": "ADDED", "object": make_job(name_of(1))})
    assert [job.name for job in watcher.view.jobs(UID)] == [name_of(1)]
    watcher.job_event({"type": "DELETED", "object": make_job(name_of(1))})
    watcher.schedule_event({"type": "DELETED", "object": make_schedule()})
    assert watcher.view.jobs(UID) == ()
    assert watcher.view.schedule(UID) is None


async def test_an_alarm_rests_after_a_fault() -> None:
    seconds = 0.0
    queue = WorkQueue(lambda: seconds)
    alarms = Alarms(queue, lambda: minute(0) + timedelta(seconds=seconds))
    alarms.set(UID, minute(0))
    alarms.ring()
    queue.retry(await queue.get())
    alarms.ring()
    assert len(queue) == 0
    seconds = 0.5
    alarms.ring()
    assert len(queue) == 1


@pytest.mark.looptime
async def test_the_loop_starts_a_job_when_its_minute_comes() -> None:
    """asyncio's clock is the operator's: what rings is the alarm, and no event of a watch."""
    world = World()
    loop = asyncio.get_running_loop()

    def now() -> datetime:
        return world.clock + timedelta(seconds=loop.time())

    schedules = ScheduleLoop(world.api, JobMetrics(View(), WorkQueue()), now=now)
    schedules._view.put_schedule(ScheduleView.from_object(make_schedule()))
    schedules._queue.add(UID)
    tasks = schedules.start()
    assert len(tasks) == WORKERS + 1
    await asyncio.sleep(29)
    assert world.names == []
    await asyncio.sleep(2)
    assert world.names == [name_of(1)]
    await asyncio.sleep(180)
    assert world.names == [name_of(count) for count in (1, 2, 3, 4)]
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def test_metrics_count_schedules_by_state_without_naming_them() -> None:
    registry, view = CollectorRegistry(), Schedules()
    metrics = ScheduleMetrics(view, registry)
    view.put_schedule(ScheduleView.from_object(make_schedule(suspend=True)))
    metrics.started.inc()
    text = generate_latest(registry).decode()
    assert 'bagpipe_schedules{state="Suspended"} 1.0' in text
    assert 'bagpipe_schedules{state="Scheduled"} 0.0' in text
    assert "bagpipe_schedule_jobs_started_total 1.0" in text
    assert "nightly" not in text
