"""A burst through the operator's own queue, fence, pace and loop, at an API server that is slow.

The API server, the drivers and the clock are models; what is measured is who waits for whom: 150
jobs whose counts change every second, and twenty writes a second; in some, new jobs beside them.
tests/bench has the real ones.
"""

import asyncio
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.fence import Fence, FencedApi
from bagpipe_operator.jobs.driver.progress import Progress, ProgressReader, parse
from bagpipe_operator.jobs.inquiry import Inquiry
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.reconcile import Reconciler
from bagpipe_operator.jobs.sweep import Sweeper
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import Lane, WorkQueue
from bagpipe_operator.runtime.work import work
from bagpipe_operator.settings import Settings
from tests.unit.operator import virtual_time
from tests.unit.operator.builders import account, make_driver, make_job
from tests.unit.operator.fakes import FakeApi

JOBS = 150
NEW_JOBS = 400  # more than twenty writes a second begin in that time
WRITE_SECONDS = 0.05  # of the API server's one processor
CREATION = 0.3  # of what a status costs: of a pod, a ConfigMap, an Event
RUN_SECONDS = 60
NEW_AT = 18  # when the beginnings of those that run are written
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

    async def create(self, resource: str, manifest: Json) -> Json:
        async with self.processor:
            await asyncio.sleep(CREATION * self.seconds)
        return await super().create(resource, manifest)

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


class CountingDrivers(ProgressReader):
    """Each counts a case every second, and one fault; its address ends with its number."""

    def __init__(self) -> None:
        session: Any = None
        super().__init__(session, 2.0)
        self.asked = 0

    async def _ask(self, ip: str) -> Progress | None:
        self.asked += 1
        failed = int(now() >= fault_at(int(ip.removeprefix("10.0.0."))))
        cases = {"planned": 1000, "running": 2, "passed": int(now()), "failed": failed}
        return parse(account(cases=cases))


@dataclass
class Found:
    """Seconds, sorted, and how many writes a second there were."""

    counts: list[float]
    faults: list[float]
    writes: float
    asked: float


async def burst(
    settings: Settings,
    jobs: int = JOBS,
    seconds: float = WRITE_SECONDS,
    new_jobs: int = 0,
    inquires: bool = True,
) -> Found:
    """All jobs run from the first moment on, and nothing is written of them yet.

    `new_jobs` come then, whose drivers never run; `inquires`: drivers are asked beside visits.
    """
    api, view, fence = SlowApi(seconds=seconds), View(), Fence()
    fence.open_until(float("inf"))
    for number in range(jobs):
        name = f"x-{number}"
        api.put("jobs", make_job(name).object)
        driver = make_driver(name).running(f"10.0.0.{number}")
        api.put("pods", driver.object())
        view.put_pod(driver.view())
        view.put_job(JobView.from_object(api.objects["jobs", name]))
    queue = WorkQueue(tenant_of=view.namespace_of, workers=settings.workers)
    clock = lambda: BEGUN + timedelta(seconds=now())  # noqa: E731
    drivers = CountingDrivers()
    reconciler = Reconciler(FencedApi(api, fence), view, drivers, settings, clock)
    sweeper, metrics = Sweeper(view, queue, settings.sweep_seconds), JobMetrics(view, queue)
    inquiry = Inquiry(drivers, settings.sweep_seconds, view.namespace_of, queue.add)
    tasks = [asyncio.create_task(sweeper.run())]
    tasks += [asyncio.create_task(inquiry.run())] if inquires else []
    tasks += [
        asyncio.create_task(work(queue, reconciler.reconcile, metrics))
        for _ in range(settings.workers)
    ]
    tasks += [asyncio.create_task(_come(new_jobs, api, view, queue))]
    ages = await _ages(api)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    reported = [api.fault_reported.get(f"x-{n}", now()) - fault_at(n) for n in range(jobs)]
    return Found(
        sorted(ages), sorted(reported), api.writes / RUN_SECONDS, drivers.asked / RUN_SECONDS
    )


async def _come(count: int, api: SlowApi, view: View, queue: WorkQueue) -> None:
    """So many new jobs at once."""
    await asyncio.sleep(NEW_AT)
    for number in range(count):
        new = make_job(f"new-{number}")
        api.put("jobs", new.object)
        view.put_job(new.view())
        queue.add(f"uid-of-new-{number}", Lane.START)


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


def test_in_a_burst_of_new_jobs_faults_of_those_that_run_are_reported_as_soon() -> None:
    found = virtual_time.run(burst(Settings(), new_jobs=NEW_JOBS))
    assert p99(found.faults) < 5
    assert found.asked <= JOBS / 1.5


def test_where_drivers_are_asked_by_visits_alone_faults_wait_for_what_all_visits_write() -> None:
    """What the above is for: a round of visits takes as long as all that they write."""
    found = virtual_time.run(burst(Settings(), new_jobs=NEW_JOBS, inquires=False))
    assert p99(found.faults) > 5.5
    unpaced = Settings(progress_wait_seconds=0.001)
    assert p99(virtual_time.run(burst(unpaced, inquires=False)).faults) > 7
    assert p99(virtual_time.run(burst(unpaced, new_jobs=NEW_JOBS, inquires=False)).faults) > 15


def test_where_the_api_server_has_time_nothing_is_slower_than_it_was() -> None:
    quick = [
        virtual_time.run(burst(Settings(progress_wait_seconds=longest), 20, 0.005))
        for longest in (0.001, 30.0)
    ]
    assert quick[0] == quick[1]
    assert quick[1].counts[-1] == pytest.approx(2, abs=1.2)
