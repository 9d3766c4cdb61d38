"""A burst through the operator's own queue, fence, pace and loop, at an API server that is slow.

The API server, the drivers and the clock are models; what is measured is who waits for whom: 150
jobs whose counts change every second, and twenty writes a second. tests/bench has the real ones.
"""

import asyncio
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.fence import Fence, FencedApi
from bagpipe_operator.jobs.driver.progress import Progress, parse
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.reconcile import Reconciler
from bagpipe_operator.jobs.sweep import Sweeper
from bagpipe_operator.jobs.view import JobView, View
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.runtime.work import work
from bagpipe_operator.settings import Settings
from tests.unit.operator import virtual_time
from tests.unit.operator.builders import account, make_driver, make_job
from tests.unit.operator.fakes import FakeApi

JOBS = 150
WRITE_SECONDS = 0.05  # of the API server's one processor
RUN_SECONDS = 60
BEGUN = datetime(2026, 11, 20, 4, 0, 0, tzinfo=UTC)


def now() -> float:
    return asyncio.get_running_loop().time()


def fault_at(number: int) -> float:
    """When a driver's one case fails: spread over the seconds in which all is under way."""
    return 25 + number * 0.618 % 1 * 25


@dataclass
class SlowApi(FakeApi):
    """One write after the other; notes since when each count and each fault was not reported."""

    seconds: float = WRITE_SECONDS
    processor: asyncio.Lock = field(default_factory=asyncio.Lock)
    counts: dict[str, int] = field(default_factory=dict)
    fault_reported: dict[str, float] = field(default_factory=dict)
    writes: int = 0

    async def patch_status(
        self,
        namespace: str,
        name: str,
        patch: Json,
        urgent: bool = True,  # noqa: ARG002
    ) -> Json:
        async with self.processor:
            await asyncio.sleep(self.seconds)
            written = await super().patch_status(namespace, name, patch)
        self.writes += 1
        cases = written["status"].get("cases") or {}
        self.counts[name] = cases.get("passed", 0)
        if cases.get("failed"):
            self.fault_reported.setdefault(name, now())
        return written


class CountingDrivers:
    """Each counts a case every second, and one fault."""

    async def read(self, uid: str, ip: str, whose: tuple[str, int]) -> Progress | None:  # noqa: ARG002
        number = int(uid.split("-")[3])
        failed = int(now() >= fault_at(number))
        cases = {"planned": 1000, "running": 2, "passed": int(now()), "failed": failed}
        return parse(account(cases=cases))

    async def works(self, ip: str) -> bool | None:  # noqa: ARG002
        return True

    def silent_seconds(self, uid: str) -> float:  # noqa: ARG002
        return 0.0

    def forget(self, uid: str) -> None:
        pass


@dataclass
class Found:
    """Seconds, sorted, and how many writes a second there were."""

    counts: list[float]
    faults: list[float]
    writes: float


async def burst(settings: Settings, jobs: int = JOBS, seconds: float = WRITE_SECONDS) -> Found:
    """All jobs run from the first moment on, and nothing is written of them yet."""
    api, view, fence = SlowApi(seconds=seconds), View(), Fence()
    fence.open_until(float("inf"))
    for number in range(jobs):
        name = f"x-{number}"
        api.put("jobs", make_job(name).object)
        driver = make_driver(name).running()
        api.put("pods", driver.object())
        view.put_pod(driver.view())
        view.put_job(JobView.from_object(api.objects["jobs", name]))
    queue = WorkQueue(tenant_of=view.namespace_of, workers=settings.workers)
    clock = lambda: BEGUN + timedelta(seconds=now())  # noqa: E731
    reconciler = Reconciler(FencedApi(api, fence), view, CountingDrivers(), settings, clock)
    sweeper, metrics = Sweeper(view, queue, settings.sweep_seconds), JobMetrics(view, queue)
    tasks = [asyncio.create_task(sweeper.run())]
    tasks += [
        asyncio.create_task(work(queue, reconciler.reconcile, metrics))
        for _ in range(settings.workers)
    ]
    ages = await _ages(api)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    reported = [api.fault_reported[f"x-{n}"] - fault_at(n) for n in range(jobs)]
    return Found(sorted(ages), sorted(reported), api.writes / RUN_SECONDS)


async def _ages(api: SlowApi) -> list[float]:
    """In the same seconds, how old each job's count was, once a second."""
    ages: list[float] = []
    for second in range(RUN_SECONDS):
        await asyncio.sleep(1)
        if 25 <= second < 50:
            ages += [max(0.0, now() - 1 - count) for count in api.counts.values()]
    return ages


def p99(values: list[float]) -> float:
    return values[int(0.99 * len(values))]


def test_in_a_burst_faults_are_reported_within_five_seconds_and_counts_within_their_bound() -> None:
    found = virtual_time.run(burst(Settings()))
    assert len(found.faults) == JOBS
    assert p99(found.faults) < 5
    assert found.counts[-1] < 30 + 2 * 2 + 1


def test_where_no_count_waits_a_fault_does() -> None:
    """What the above is for: without it each fault waits for the counts of all."""
    found = virtual_time.run(burst(Settings(progress_wait_seconds=0.001)))
    assert p99(found.faults) > 8


def test_where_the_api_server_has_time_nothing_is_slower_than_it_was() -> None:
    quick = [
        virtual_time.run(burst(Settings(progress_wait_seconds=longest), 20, 0.005))
        for longest in (0.001, 30.0)
    ]
    assert quick[0] == quick[1]
    assert quick[1].counts[-1] == pytest.approx(2, abs=1.2)
