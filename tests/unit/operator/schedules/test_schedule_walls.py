"""Who may create jobs in one namespace, and knows a schedule's UID, steers no other's schedule.

The API server takes any owner; the garbage collector removes a job whose owner is in another
namespace after some seconds, or never, where the job has a finalizer.
"""

import contextlib

import pytest
from aiohttp import web

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.schedules.view import ScheduledJob, Schedules
from bagpipe_operator.schedules.watch import ScheduleWatch
from tests.unit.operator.schedules.world import (
    UID,
    World,
    make_job,
    make_schedule,
    name_of,
)
from tests.unit.operator.test_api import server


def forged(count: int, end: str = "") -> Json:
    """A job elsewhere that calls itself that run's."""
    job = make_job(name_of(count), end)
    job["metadata"] |= {"namespace": "attackers", "uid": f"uid-of-forged-{count}"}
    return job


def passed(job: Json) -> Json:
    job["status"]["results"] = "s3://attackers/results"
    job["status"]["conditions"].append({"type": "Passed", "status": "True"})
    return job


async def listed(**spec: str | int) -> World:
    """A schedule whose jobs the operator has listed just before the run of minute 1."""
    world = World(**spec)
    await world.at(0, seconds=45)
    return world


async def test_a_job_of_another_namespace_is_not_a_run_that_was_started() -> None:
    world = await listed()
    world.view.put_job(ScheduledJob.from_object(forged(1)))
    await world.at(1)
    assert world.names == [name_of(1)]
    assert world.condition("OnTime") == ("True", "JobStarted")
    assert world.status["active"] == [name_of(1)]


async def test_a_job_of_another_namespace_is_not_waited_for_nor_deleted() -> None:
    for policy in ("Forbid", "Replace"):
        world = await listed(concurrencyPolicy=policy, successfulJobsHistoryLimit=0)
        world.view.put_job(ScheduledJob.from_object(forged(0)))
        world.view.put_job(ScheduledJob.from_object(forged(-1, "Complete")))
        await world.at(1)
        assert world.names == [name_of(1)]
        assert not [call for call in world.api.calls if call.startswith("delete")]


async def test_the_results_of_another_namespace_are_nobody_s_baseline() -> None:
    world = await listed()
    world.view.put_job(ScheduledJob.from_object(passed(forged(0, "Complete"))))
    await world.at(1)
    assert "lastPassed" not in world.status
    assert "lastPassedTime" not in world.status
    assert "lastSuccessfulTime" not in world.status
    own = passed(make_job(name_of(1), "Complete"))
    world.view.put_job(ScheduledJob.from_object(own))
    await world.at(1, seconds=5)
    assert world.status["lastPassed"]["job"] == name_of(1)


async def test_a_namesake_elsewhere_neither_hides_nor_takes_away_a_run() -> None:
    world = World(concurrencyPolicy="Forbid")
    await world.at(1)
    namesake = ScheduledJob.from_object(forged(1, "Complete"))
    world.view.put_job(namesake)
    (own,) = world.view.jobs(UID)
    assert (own.namespace, own.finished) == ("lanes", False)
    world.view.drop_job(namesake)
    assert world.view.jobs(UID) == (own,)


async def test_a_job_of_another_namespace_wakes_no_schedule() -> None:
    watcher = ScheduleWatch(Schedules(), WorkQueue(), JobMetrics(View(), WorkQueue()))
    watcher.schedule_event({"type": None, "object": make_schedule()})
    watcher.queue.done(await watcher.queue.get())
    watcher.job_event({"type": "ADDED", "object": forged(1)})
    assert len(watcher.queue) == 0
    watcher.job_event({"type": "ADDED", "object": make_job(name_of(1))})
    assert len(watcher.queue) == 1


def strangers(count: int) -> dict[str, Json]:
    """Jobs that anybody may give the schedule's label."""
    jobs = [make_job(f"stranger-{number}", uid="of-nobody") for number in range(count)]
    return {job["metadata"]["name"]: job for job in jobs}


async def test_jobs_with_the_schedule_s_label_are_listed_up_to_a_bound() -> None:
    """Twenty are in a page: 5,000 took 250 calls of each visit, up to its 60 s."""
    world = await listed()
    jobs = [*strangers(5_000).values()]
    asked = 0

    async def answer(request: web.Request) -> web.Response:
        nonlocal asked
        begin = int(request.query.get("continue", "0"))
        asked += 1
        end = begin + int(request.query["limit"])
        more = {"continue": str(end)} if end < len(jobs) else {}
        return web.json_response({"items": jobs[begin:end], "metadata": more})

    async with server(answer) as api:
        world.api.list_jobs = api.list_jobs  # type: ignore[method-assign]
        with contextlib.suppress(ApiError):
            await world.at(1)
    assert asked == 51
    assert world.condition("OnTime") == ("False", "CreationRefused")


@pytest.mark.parametrize("policy", ["Allow", "Forbid", "Replace"])
async def test_a_schedule_among_too_many_jobs_starts_nothing_until_they_are_gone(
    policy: str,
) -> None:
    world = await listed(concurrencyPolicy=policy)
    await world.at(1)
    world.end(name_of(1), at="2026-11-20T04:01:30Z")
    world.api.jobs |= strangers(1_000)
    for seconds in (0, 10, 30):
        with pytest.raises(ApiError, match="more than 1,000 jobs"):
            await world.at(2, seconds)
    assert name_of(1) in world.names, "what it had is neither forgotten nor replaced"
    assert name_of(2) not in world.names
    assert "delete those that the schedule did not make" in world.message("OnTime")
    del world.api.jobs["stranger-0"]
    await world.at(2, 40)
    assert name_of(2) in world.names
    assert world.condition("OnTime") == ("True", "JobStarted")
