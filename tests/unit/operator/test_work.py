"""Workers: a fault costs its own job a delay, and no other job anything."""

import asyncio
import logging

import pytest

from bagpipe_operator.api import ApiError
from bagpipe_operator.fence import NotLeadingError
from bagpipe_operator.metrics import Metrics
from bagpipe_operator.queue import WorkQueue
from bagpipe_operator.view import View
from bagpipe_operator.work import RECONCILE_SECONDS, work


class Bench:
    def __init__(self) -> None:
        self.queue = WorkQueue()
        self.metrics = Metrics(View(), self.queue)
        self.seen: list[str] = []

    async def reconcile(self, key: str) -> None:
        self.seen.append(key)
        match key:
            case "refused":
                raise ApiError(500, "InternalError", "no")
            case "bug":
                raise KeyError("status")
            case "fenced":
                raise NotLeadingError
            case "hangs":
                await asyncio.Event().wait()

    async def run(self, *keys: str, seconds: float = 1.0, leads: bool = True) -> None:
        worker = asyncio.create_task(
            work(self.queue, self.reconcile, self.metrics, leads=lambda: leads)
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
    await bench.run("fine", "bug", leads=False)
    assert bench.seen == []
    assert (len(bench.queue), bench.count("done")) == (0, 0)


@pytest.mark.looptime
async def test_what_the_fence_stops_is_not_tried_again() -> None:
    bench = Bench()
    await bench.run("fenced", "fine", seconds=60)
    assert bench.seen == ["fenced", "fine"]
    assert [bench.count(r) for r in ("done", "retried", "fenced")] == [1, 0, 1]
