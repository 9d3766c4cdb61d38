"""What a new operator costs where thousands of jobs have ended: nothing of the API server's."""

import gc
from collections.abc import Iterator

import pytest

from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.reconcile import Reconciler
from bagpipe_operator.jobs.view import View
from bagpipe_operator.jobs.watch import Watch
from bagpipe_operator.main import COLLECT_AFTER_ALLOCATIONS, spare_the_collector
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import Clock, make_driver, make_executor, make_job
from tests.unit.operator.fakes import FakeApi, FakeDrivers

ENDED = 200
CONDITIONS = [
    {
        "type": kind,
        "status": status,
        "reason": "CasesPassed",
        "message": "",
        "lastTransitionTime": "2026-11-20T03:00:00Z",
    }
    for kind, status in (("Complete", "True"), ("Failed", "False"), ("Passed", "True"))
]


@pytest.fixture
def collector() -> Iterator[None]:
    before = gc.get_threshold()
    yield
    gc.set_threshold(*before)
    gc.unfreeze()


async def test_jobs_that_have_ended_cost_no_call() -> None:
    api, view, queue, clock = FakeApi(), View(), WorkQueue(), Clock()
    watch = Watch(view, queue, JobMetrics(view, queue))
    reconciler = Reconciler(
        api, view, FakeDrivers(), Settings(), clock.now, monotonic=clock.monotonic
    )
    for number in range(ENDED):
        name = f"job-{number}"
        status = {"phase": "Complete", "observedGeneration": 1, "lostDrivers": 0}
        job = make_job(name).with_status(conditions=CONDITIONS, **status)
        watch.job_event({"type": None, "object": job.object})
        watch.pod_event({"type": None, "object": make_driver(name).ended(0).object()})
    assert len(queue) == ENDED
    for _ in range(ENDED):
        key = await queue.get()
        await reconciler.reconcile(key)
        queue.done(key)
    assert api.calls == []
    assert len(queue) == 0


async def test_a_running_job_with_many_pods_is_asked_for_once() -> None:
    view, queue = View(), WorkQueue()
    watch = Watch(view, queue, JobMetrics(view, queue))
    job = make_job("x").with_status(driver="x-1-driver", phase="Running")
    pods = [make_driver("x").running(), *(make_executor("x", n).running() for n in range(9))]
    events = [{"type": None, "object": pod.object()} for pod in pods]
    watch.job_event({"type": None, "object": job.object})
    for event in events:
        watch.pod_event(event)
    assert len(queue) == 1
    queue.done(await queue.get())
    for event in events:  # the watch broke, and all is listed again
        watch.pod_event(event)
    assert len(queue) == 0


@pytest.mark.usefixtures("collector")
def test_the_collector_leaves_alone_what_stays() -> None:
    spare_the_collector()
    assert gc.get_threshold()[0] == COLLECT_AFTER_ALLOCATIONS == 10_000
    assert gc.get_freeze_count() > 10_000
