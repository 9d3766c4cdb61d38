"""Large jobs are visited one at a time, tenants take turns, and small jobs never wait for them."""

import asyncio

from bagpipe_operator.cluster.large_objects import LARGE, SIZE
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.large_jobs import LargeJobs
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.sweep import Sweeper
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.runtime.work import work
from tests.unit.operator.builders import make_job


def put(view: View, name: str, size: int, namespace: str = "lanes") -> str:
    job = make_job(name)
    job.object["metadata"]["namespace"] = namespace
    view.put_job(JobView.from_object(job.object | {SIZE: size}))
    return f"uid-of-{name}"


async def test_tenants_take_turns_and_none_is_turned_away() -> None:
    view = View()
    large = LargeJobs(view)
    greedy = [put(view, f"a{n}", LARGE + 1, "aaa") for n in range(3)]
    other = put(view, "b", LARGE + 1, "bbb")
    assert [large.take(uid) for uid in (*greedy, other)] == [True] * 4
    found = [await large.queue.get() for _ in range(4)]
    assert found == [greedy[0], other, *greedy[1:]]


def test_what_is_not_large_or_not_there_is_worked_on_at_once() -> None:
    view = View()
    large = LargeJobs(view)
    assert not large.take(put(view, "a", LARGE))
    assert not large.take("uid-of-nobody")
    assert len(large.queue) == 0


async def test_small_jobs_pass_while_a_large_one_takes_its_time() -> None:
    view = View()
    queue, large = WorkQueue(), LargeJobs(view)
    metrics = JobMetrics(view, queue)
    begun, go_on, passed, over = (asyncio.Event() for _ in range(4))
    heavy = [put(view, f"x{n}", LARGE + 1) for n in range(9)]
    light = [put(view, f"y{n}", 10) for n in range(9)]
    seen: list[str] = []
    at_once = most = 0

    async def reconcile(uid: str) -> None:
        nonlocal at_once, most
        seen.append(uid)
        if set(light) <= set(seen):
            passed.set()
        if len(seen) == len(heavy + light):
            over.set()
        job = view.job(uid)
        if job is None or not job.large:
            return
        at_once += 1
        most = max(most, at_once)
        begun.set()
        await go_on.wait()
        at_once -= 1

    workers = [work(queue, reconcile, metrics, passed_on=large.take) for _ in range(8)]
    tasks = [
        asyncio.create_task(each) for each in (*workers, work(large.queue, reconcile, metrics))
    ]
    for uid in heavy + light:
        queue.add(uid)
    await asyncio.wait_for(begun.wait(), 60)
    await asyncio.wait_for(passed.wait(), 60)
    assert (sorted(set(seen)), most) == (sorted([heavy[0], *light]), 1)
    go_on.set()
    await asyncio.wait_for(over.wait(), 60)
    assert (sorted(seen), most) == (sorted(heavy + light), 1)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def test_a_large_job_that_failed_waits_out_its_pause_and_is_asked_for_again() -> None:
    view, seconds = View(), 0.0
    queue, large = WorkQueue(lambda: seconds), LargeJobs(view)
    large.queue = WorkQueue(lambda: seconds)
    sweeper = Sweeper(view, queue, 1.0, large=large)
    uid = put(view, "x", LARGE + 1)
    large.take(uid)
    assert large.queue.retry(await large.queue.get()) == 0.5
    large.take(uid)
    assert len(large.queue) == 0
    seconds = 1.0
    ended = make_job("x").with_status(conditions=[{"type": "Complete", "status": "True"}])
    view.put_job(JobView.from_object(ended.object | {SIZE: LARGE + 1}))
    sweeper.sweep()
    assert large.take(await queue.get())
    assert await large.queue.get() == uid
