"""Workers: a fault costs its own job a delay, and no other job anything."""

import asyncio
import logging
from collections.abc import Awaitable, Callable

import pytest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.fence import Fence, FencedApi, NotLeadingError
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.sweep import Sweeper
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.runtime.work import RECONCILE_SECONDS, work
from tests.unit.operator.builders import account, make_driver, make_executor, make_job
from tests.unit.operator.fakes import FakeApi
from tests.unit.operator.test_life import edit
from tests.unit.operator.world import UID, World


class Bench:
    def __init__(self) -> None:
        self.queue = WorkQueue()
        self.metrics = JobMetrics(View(), self.queue)
        self.seen: list[str] = []
        self.leads = True

    async def reconcile(self, key: str) -> None:
        self.seen.append(key)
        match key:
            case "refused":
                raise ApiError(500, "InternalError", "no")
            case "bug":
                raise KeyError("status")
            case "fenced":
                self.leads = False
                raise NotLeadingError
            case "renewed meanwhile":
                raise NotLeadingError
            case "hangs":
                await asyncio.Event().wait()

    async def run(self, *keys: str, seconds: float = 1.0) -> None:
        worker = asyncio.create_task(
            work(self.queue, self.reconcile, self.metrics, leads=lambda: self.leads)
        )
        for key in keys:
            self.queue.add(key)
        await asyncio.sleep(seconds)
        worker.cancel()
        with pytest.raises(asyncio.CancelledError):
            await worker

    def count(self, result: str) -> float | None:
        return self.metrics.registry.get_sample_value(
            "bagpipe_reconciles_total", {"result": result}
        )


@pytest.mark.looptime
async def test_faults_are_counted_and_the_rest_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench()
    with caplog.at_level(logging.WARNING):
        await bench.run("refused", "bug", "fine")
    assert bench.seen == ["refused", "bug", "fine"]
    assert [bench.count(r) for r in ("done", "retried", "faulted")] == [1, 1, 1]
    assert "job refused: 500 InternalError: no; tried again in 0.5 s" in caplog.text
    assert "KeyError: 'status'" in caplog.text


@pytest.mark.looptime
async def test_a_reconcile_that_hangs_is_given_up() -> None:
    bench = Bench()
    await bench.run("hangs", "fine", seconds=RECONCILE_SECONDS + 1)
    assert bench.seen == ["hangs", "fine"]
    assert bench.count("retried") == 1


@pytest.mark.looptime
async def test_a_replica_that_stands_by_drops_its_keys() -> None:
    bench = Bench()
    bench.leads = False
    await bench.run("fine", "bug")
    assert bench.seen == []
    assert (len(bench.queue), bench.count("done")) == (0, 0)


@pytest.mark.looptime
async def test_what_the_fence_stops_is_not_tried_again_once_the_lead_is_lost() -> None:
    bench = Bench()
    await bench.run("fenced", "fine", seconds=60)
    assert bench.seen == ["fenced"]
    assert bench.queue.rested() == []
    assert [bench.count(r) for r in ("done", "retried", "fenced")] == [0, 0, 1]


@pytest.mark.looptime
async def test_what_the_fence_stops_is_tried_again_by_a_replica_that_still_leads() -> None:
    """A write ends with the time that was left when it began, also if the Lease was renewed."""
    bench = Bench()
    await bench.run("renewed meanwhile", "fine")
    assert bench.queue.rested() == ["renewed meanwhile"]
    assert [bench.count(r) for r in ("done", "retried", "fenced")] == [1, 1, 0]


async def at_work(world: World, queue: WorkQueue, seconds: float = 5.0) -> None:
    """The loop as main ties it together, for a while; nothing happens but time."""
    sweeper = Sweeper(world.view, queue, 2.0, now=world.clock.now)
    reconcile = world.reconciler.reconcile
    parts = [sweeper.run(), work(queue, reconcile, JobMetrics(world.view, queue))]
    tasks = [asyncio.create_task(part) for part in parts]
    await asyncio.sleep(seconds)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def ended(world: World) -> None:
    """The driver has ended, and an executor is left; no reconcile has seen it."""
    await world.reconcile()
    done = account("Complete", reason="AllCasesRan", cases={"planned": 4, "passed": 4})
    world.deliver(make_driver("x").ended(0, done), make_executor("x").running())


async def edited_after_its_end(world: World) -> None:
    await ended(world)
    await world.reconcile()
    await world.reconcile()
    edit(world, ttlAfterFinished="600s")


async def just_suspended(world: World) -> None:
    """Nothing but an event would bring a job that rests forward again."""
    edit(world, suspend=True)


def is_reported(world: World) -> bool:
    return "AllCasesRan" in world.api.event_reasons()


def is_alone(world: World) -> bool:
    return world.api.named("pods") == ["x-1-driver"]


def is_acknowledged(world: World) -> bool:
    return bool(world.status()["observedGeneration"] == 2)


def is_reported_suspended(world: World) -> bool:
    return world.api.event_reasons() == ["JobSuspended"]


# The call, what happens before it, and whether it has been made.
LastCall = tuple[str, Callable[[World], Awaitable[None]], Callable[[World], bool]]
LAST_CALLS: dict[str, LastCall] = {
    "the Event": ("create events", ended, is_reported),
    "the deletion": ("delete x-1-exec-1", ended, is_alone),
    "the acknowledgement": ("patch status", edited_after_its_end, is_acknowledged),
    "the Event of a rest": ("create events", just_suspended, is_reported_suspended),
}


@pytest.mark.looptime
@pytest.mark.parametrize("status", [0, 429, 500])
@pytest.mark.parametrize("case", LAST_CALLS)
async def test_what_fails_when_the_end_is_written_is_tried_again(case: str, status: int) -> None:
    call, happens, is_done = LAST_CALLS[case]
    world, queue = World(make_job("x")), WorkQueue()
    await happens(world)
    world.api.fail(call, ApiError(status, "", "not now"))
    queue.add(UID)
    await at_work(world, queue)
    assert world.api.faults == {call: []}
    assert is_done(world)
    assert queue.rested() == []


@pytest.mark.looptime
async def test_a_write_that_outlasts_a_renewal_is_made_again() -> None:
    class Slow(FakeApi):
        """Its first deletion gets no answer."""

        async def delete_pod(
            self, namespace: str, name: str, uid: str, grace_seconds: int | None = None
        ) -> bool:
            self._called("slow delete")
            if self.calls.count("slow delete") == 1:
                await asyncio.Event().wait()
            return await super().delete_pod(namespace, name, uid, grace_seconds)

    world, loop = World(), asyncio.get_running_loop()
    await ended(world)
    slow, fence = Slow(world.api.objects), Fence(loop.time)
    world.api, world.reconciler.api = slow, FencedApi(slow, fence)
    fence.open_until(loop.time() + 2.0)
    loop.call_later(1.0, fence.open_until, loop.time() + 60.0)
    queue = WorkQueue()
    queue.add(UID)
    await at_work(world, queue, seconds=10.0)
    assert is_alone(world)


async def test_a_key_that_another_queue_takes_is_not_worked_on_here() -> None:
    bench = Bench()
    taken: list[str] = []
    over = asyncio.Event()

    async def reconcile(key: str) -> None:
        await bench.reconcile(key)
        over.set()

    def take(key: str) -> bool:
        taken.append(key)
        return key == "large"

    worker = asyncio.create_task(work(bench.queue, reconcile, bench.metrics, passed_on=take))
    for key in ("large", "small"):
        bench.queue.add(key)
    await asyncio.wait_for(over.wait(), 60)
    worker.cancel()
    await asyncio.gather(worker, return_exceptions=True)
    assert (taken, bench.seen) == (["large", "small"], ["small"])
    assert bench.count("done") == 1
