"""Jobs of a schedule that can't be deleted keep no run, no Event and no status from coming."""

import asyncio
from datetime import datetime, timedelta
from typing import Any

import pytest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.fence import NotLeadingError
from bagpipe_operator.runtime.metrics import Metrics
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.runtime.work import work
from bagpipe_operator.schedules.alarms import Alarms
from bagpipe_operator.schedules.reconcile import ScheduleReconciler
from tests.unit.operator import virtual_time
from tests.unit.operator.schedules.world import CREATED, UID, World, make_job, minute, name_of

DENIED = ApiError(403, "Forbidden", "webhook denies")


async def test_an_old_job_that_can_t_be_deleted_keeps_no_event_and_no_other_from_going() -> None:
    world = World(successfulJobsHistoryLimit=0)
    for count in (1, 2, 3):
        await world.at(count)
        world.end(name_of(count))
        world.api.fail(f"delete {name_of(1)}", DENIED)
    await world.at(3, 1)
    assert world.events() == ["Normal/JobStarted"] * 3
    assert world.names == [name_of(1)]
    world.clock = minute(3) + timedelta(seconds=2.9)
    assert world.alarms.ring() == 0
    world.clock = minute(3) + timedelta(seconds=3)
    assert world.alarms.ring() == 1
    await world.at(3, 3)
    assert world.names == []
    world.clock = minute(4) - timedelta(seconds=1)
    assert world.alarms.ring() == 0


async def test_old_jobs_that_can_t_be_deleted_are_tried_a_few_at_a_time_in_turn() -> None:
    world = World(successfulJobsHistoryLimit=0, schedule="0 * * * *")
    jobs = [name_of(count) for count in range(12)]
    for name in jobs:
        world.api.jobs[name] = make_job(name, "Complete")
        world.api.fail(f"delete {name}", *[DENIED] * 9)
    pauses = []
    for _ in range(4):
        before = world.now()
        await world.reconciler.reconcile(UID)
        while not world.alarms.ring():
            world.clock += timedelta(seconds=0.5)
        pauses.append((world.now() - before).total_seconds())
    tried = [call.split()[1] for call in world.api.calls if call.startswith("delete")]
    assert tried == [*jobs, *jobs[:8]]
    assert pauses == [0.5, 1, 2, 4]


async def test_nothing_is_deleted_by_who_does_not_lead_any_more() -> None:
    world = World(successfulJobsHistoryLimit=0)
    await world.at(1)
    world.end(name_of(1))
    world.api.fail(f"delete {name_of(1)}", NotLeadingError())
    with pytest.raises(NotLeadingError):
        await world.at(1, 1)


@pytest.mark.parametrize("error", [DENIED, ApiError(0, "Timeout", "no answer in time")])
async def test_a_job_that_can_t_be_deleted_is_named_where_it_is_to_be_replaced(
    error: ApiError,
) -> None:
    world = World(concurrencyPolicy="Replace")
    await world.at(1)
    world.api.fail(f"delete {name_of(1)}", error)
    with pytest.raises(ApiError, match="can't be deleted"):
        await world.at(2)
    assert world.names == [name_of(1)]
    assert world.condition("OnTime") == ("False", "CreationRefused")
    words = f"{name_of(1)}, which it replaces, can't be deleted: {error.message}"
    assert words in world.message("OnTime")
    assert world.events() == ["Normal/JobStarted", "Warning/CreationRefused"]
    await world.at(2, 5)
    assert (world.names, world.condition("OnTime")) == ([name_of(2)], ("True", "JobReplaced"))


async def test_who_does_not_lead_any_more_refuses_no_run() -> None:
    world = World(concurrencyPolicy="Replace")
    await world.at(1)
    world.api.fail(f"delete {name_of(1)}", NotLeadingError())
    with pytest.raises(NotLeadingError):
        await world.at(2)
    assert world.condition("OnTime") == ("True", "JobStarted")


def now() -> datetime:
    """By the event loop's clock."""
    return CREATED + timedelta(seconds=asyncio.get_running_loop().time())


class Operator:
    """A world whose clock is the event loop's, with the queue, the alarms and a worker."""

    def __init__(self, **spec: Any) -> None:
        self.world = World(**spec)
        self.queue = WorkQueue()
        self.alarms = Alarms(self.queue, now)
        self.reconciler = ScheduleReconciler(
            self.world.api, self.world.view, self.alarms, self.world.metrics, now
        )
        self.made: dict[str, float] = {}  # how late, in seconds, by the job
        create = self.world.api.create_job

        async def create_job(manifest: dict[str, Any]) -> dict[str, Any]:
            made = await create(manifest)
            name = made["metadata"]["name"]
            run = datetime.fromtimestamp(60 * int(name.rpartition("-")[2]), CREATED.tzinfo)
            self.made[name] = (now() - run).total_seconds()
            self.world.end(name)
            return made

        self.world.api.create_job = create_job  # type: ignore[method-assign]

    async def run(self, minutes: float) -> None:
        """Goes on for so long."""
        metrics = Metrics()
        self.queue.add(UID)
        tasks = [
            asyncio.create_task(self.alarms.run()),
            asyncio.create_task(work(self.queue, self.reconciler.reconcile, metrics)),
        ]
        await asyncio.sleep(60 * minutes)
        for task in tasks:
            task.cancel()


@pytest.mark.parametrize("seconds", [0.0, 20.0])
def test_no_run_is_late_where_old_jobs_can_t_be_deleted(seconds: float) -> None:
    async def runs() -> dict[str, float]:
        operator = Operator(successfulJobsHistoryLimit=0)

        async def denied(*_: str) -> None:
            await asyncio.sleep(seconds)
            raise DENIED

        operator.world.api.delete_job = denied  # type: ignore[assignment]
        await operator.run(30.25)
        return operator.made

    made = virtual_time.run(runs())
    assert list(made) == [name_of(count) for count in range(1, 31)]
    assert max(made.values()) <= 1


def test_the_next_run_waits_for_no_pause_after_refusals() -> None:
    """Of a run that is refused the pauses grow to two minutes."""

    async def runs() -> dict[str, float]:
        operator = Operator(schedule="*/10 * * * *")
        full = ApiError(403, "Forbidden", "exceeded quota: jobs, used: 1, limited: 1")
        run = name_of(10)
        operator.world.api.fail(f"create {run}", *[full] * 99)
        await operator.run(21)
        return operator.made

    made = virtual_time.run(runs())
    assert list(made) == [name_of(20)]
    assert made[name_of(20)] <= 1
