"""No namespace's jobs wait longer because another has thousands."""

import asyncio

import pytest

from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.fair_share import MOST_LOOKS_PER_SECOND, FairShare, seconds_between
from bagpipe_operator.runtime.queue import Lane, WorkQueue, most_of_one
from bagpipe_operator.runtime.work import work
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import make_job


@pytest.mark.parametrize(
    ("waiting", "namespaces", "expected"),
    [(1, 1, 4.0), (40, 1, 4.0), (100, 1, 10.0), (1000, 1, 100.0), (100, 2, 20.0), (1, 30, 4.0)],
)
def test_the_more_jobs_of_a_namespace_wait_the_more_seldom_each_is_asked_about(
    waiting: int, namespaces: int, expected: float
) -> None:
    assert seconds_between(waiting, namespaces, 4.0) == expected


def test_five_thousand_jobs_of_one_tenant_cost_the_others_nothing() -> None:
    share = FairShare(4.0)
    for number in range(5000):
        share.add(f"hostile-{number}", "hostile")
        share.add(f"hostile-{number}", "hostile")
    share.add("honest", "honest")
    assert (share.seconds("honest"), share.seconds("hostile")) == (4.0, 1000.0)
    asked = 5000 / share.seconds("hostile") + 1 / share.seconds("honest")
    assert asked <= MOST_LOOKS_PER_SECOND
    for number in range(5000):
        share.remove(f"hostile-{number}")
        share.remove(f"hostile-{number}")
    assert share.seconds("hostile") == 4.0
    for number in range(100):
        share.add(f"new-{number}", "new")
    assert share.seconds("new") == 20.0  # beside the honest one, and nobody else


def test_a_namespace_counts_until_the_last_of_its_jobs_waits_no_more() -> None:
    share = FairShare(1.0)
    for number in range(100):
        share.add(f"a-{number}", "a")
        share.add(f"b-{number}", "b")
    for number in range(50):
        share.remove(f"a-{number}")
    assert (share.seconds("a"), share.seconds("b"), share.seconds("c")) == (10.0, 20.0, 1.0)
    for number in range(50, 100):
        share.remove(f"a-{number}")
    assert (share.seconds("a"), share.seconds("b")) == (1.0, 10.0)


async def test_a_thousand_new_jobs_of_one_tenant_do_not_come_before_another_s_one() -> None:
    owner = {f"hostile-{number}": "hostile" for number in range(1000)}
    owner |= {"a": "honest", "b": "honest", "c": "third"}
    queue = WorkQueue(lambda: 0.0, tenant_of=owner.__getitem__)
    for key in owner:
        queue.add(key, Lane.START)
    taken = [await queue.get() for _ in range(6)]
    assert taken == ["hostile-0", "a", "c", "hostile-1", "b", "hostile-2"]
    # News of a job that waits to start goes before, whoever has how many.
    queue.add("hostile-7", Lane.NEWS)
    assert await queue.get() == "hostile-7"
    rest = [await queue.get() for _ in range(len(queue))]
    assert rest[:4] == ["hostile-3", "hostile-4", "hostile-5", "hostile-6"]
    assert (len(rest), len(set(rest)), rest[4]) == (996, 996, "hostile-8")


def test_the_queue_s_tenant_is_the_job_s_namespace() -> None:
    view = View()
    view.put_job(make_job("x").view())
    assert (view.namespace_of("uid-of-x"), view.namespace_of("uid-of-y")) == ("lanes", "")


async def hardest_hit(most: int | None) -> float:
    """Seconds until each of a hundred jobs was looked at once, beside a tenant's that take 2 s.

    That long a driver is asked that hangs, or that a NetworkPolicy of its namespace hides.
    """
    owner = {f"h-{number}": "hostile" for number in range(300)}
    owner |= {f"x-{number}": "honest" for number in range(100)}
    queue = WorkQueue(tenant_of=owner.__getitem__, most_of_one=most)
    settings, seen = Settings(), dict[str, float]()

    async def reconcile(uid: str) -> None:
        await asyncio.sleep(settings.progress_seconds if owner[uid] == "hostile" else 0.01)
        seen[uid] = asyncio.get_running_loop().time()

    metrics, begun = JobMetrics(View(), queue), asyncio.get_running_loop().time()
    workers = [
        asyncio.create_task(work(queue, reconcile, metrics)) for _ in range(settings.workers)
    ]
    for uid in owner:
        queue.add(uid)
    await asyncio.sleep(60)
    for worker in workers:
        worker.cancel()
    await asyncio.gather(*workers, return_exceptions=True)
    assert len(seen) == len(owner)
    return max(seen[uid] for uid in owner if owner[uid] == "honest") - begun


@pytest.mark.looptime
async def test_a_tenant_whose_visits_take_long_does_not_have_all_workers() -> None:
    workers = Settings().workers
    assert most_of_one(workers) == 24
    assert await hardest_hit(most_of_one(workers)) < 0.2
    assert await hardest_hit(None) > 4


async def test_a_tenant_with_all_its_workers_waits_and_others_don_t() -> None:
    queue = WorkQueue(tenant_of=lambda key: key[0], most_of_one=2)
    for key in ("a1", "a2", "a3", "b1"):
        queue.add(key)
    assert [await queue.get() for _ in range(3)] == ["a1", "b1", "a2"]
    waiting = [asyncio.create_task(queue.get()) for _ in range(3)]
    await asyncio.sleep(0)
    queue.add("a4")
    for _ in range(3):
        await asyncio.sleep(0)
    assert not any(task.done() for task in waiting)
    assert len(queue) == 2
    queue.done("a1")
    for _ in range(3):
        await asyncio.sleep(0)
    assert [task.result() for task in waiting if task.done()] == ["a3"]
    queue.retry("a2")
    queue.add("b2")
    assert sorted(await asyncio.gather(*waiting)) == ["a3", "a4", "b2"]


@pytest.mark.parametrize(("workers", "most"), [(1, 1), (2, 2), (4, 3), (8, 6), (32, 24)])
def test_a_quarter_of_the_workers_is_the_others(workers: int, most: int) -> None:
    assert most_of_one(workers) == most
