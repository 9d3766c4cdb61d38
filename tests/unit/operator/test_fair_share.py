"""No namespace's jobs wait longer because another has thousands."""

import asyncio
import contextlib
from collections import Counter

import pytest

from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.fair_share import MOST_LOOKS_PER_SECOND, FairShare, seconds_between
from bagpipe_operator.runtime.queue import Lane, WorkQueue
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


async def hardest_hit(workers: int | None, hostile: int = 1) -> float:
    """Seconds until each of a hundred jobs was looked at once, which come to workers that have
    jobs of as many hostile tenants, which take 10 s each.

    That long a driver is asked that hangs, or a webhook of their namespace takes.
    """
    of_others = {f"h-{number}": f"hostile-{number % hostile}" for number in range(600)}
    honest = {f"x-{number}": "honest" for number in range(100)}
    owner = of_others | honest
    queue = WorkQueue(tenant_of=owner.__getitem__, workers=workers)
    settings, seen = Settings(), dict[str, float]()

    async def reconcile(uid: str) -> None:
        await asyncio.sleep(0.01 if uid in honest else settings.request_seconds)
        seen[uid] = asyncio.get_running_loop().time()

    metrics = JobMetrics(View(), queue)
    tasks = [asyncio.create_task(work(queue, reconcile, metrics)) for _ in range(settings.workers)]
    for uid in of_others:
        queue.add(uid)
    await asyncio.sleep(1)
    come = asyncio.get_running_loop().time()
    for uid in honest:
        queue.add(uid)
    await asyncio.sleep(300)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    assert len(seen) == len(owner)
    return max(seen[uid] for uid in honest) - come


@pytest.mark.looptime
@pytest.mark.parametrize("hostile", [1, 2, 3, 10, 31])
async def test_tenants_whose_visits_take_long_do_not_have_all_workers(hostile: int) -> None:
    assert await hardest_hit(Settings().workers, hostile) < 1.1
    assert await hardest_hit(None, hostile) > 9


async def test_who_has_most_workers_waits_until_those_who_came_later_have_theirs() -> None:
    queue = WorkQueue(tenant_of=lambda key: key[0], workers=8)
    for number in range(20):
        queue.add(f"a{number}")
    assert [await queue.get() for _ in range(6)] == [f"a{number}" for number in range(6)]
    for key in ("b1", "b2", "b3", "c1"):
        queue.add(key)
    assert [await queue.get() for _ in range(2)] == ["b1", "c1"]
    waiting = [asyncio.create_task(queue.get()) for _ in range(8)]

    async def taken_after(*done: str) -> list[str]:
        for key in done:
            queue.done(key)
        for _ in range(5):
            await asyncio.sleep(0)
        found = [task.result() for task in waiting if task.done()]
        waiting[:] = [task for task in waiting if not task.done()]
        return found

    assert await taken_after("a0") == []  # the last free one is for who has none
    queue.add("d1")
    assert await taken_after() == ["d1"]
    assert await taken_after("a1", "d1") == ["b2"]
    assert await taken_after("a2") == ["b3"]
    assert await taken_after("c1") == []
    assert await taken_after("a3") == ["a6"]
    for task in waiting:
        task.cancel()


@pytest.mark.parametrize(
    ("workers", "most"), [(1, 1), (2, 1), (3, 2), (4, 3), (8, 6), (32, 24), (33, 24)]
)
async def test_a_quarter_of_the_workers_is_the_others(workers: int, most: int) -> None:
    queue = WorkQueue(workers=workers)
    for number in range(workers + 1):
        queue.add(str(number))
    waiting = [asyncio.create_task(queue.get()) for _ in range(workers)]
    for _ in range(3):
        await asyncio.sleep(0)
    assert sum(task.done() for task in waiting) == most
    for task in waiting:
        task.cancel()


@pytest.mark.parametrize(
    ("tenants", "most", "free"), [(1, 24, 8), (2, 14, 5), (3, 10, 4), (10, 3, 2), (31, 1, 1)]
)
async def test_the_more_tenants_have_long_visits_the_smaller_is_the_share_of_each(
    tenants: int, most: int, free: int
) -> None:
    """In the end, whoever came first: one visit after the other ends, and others begin."""
    queue = WorkQueue(tenant_of=lambda key: key.partition("-")[0], workers=32)
    busy: list[str] = []

    async def take() -> None:
        with contextlib.suppress(TimeoutError):
            while True:
                async with asyncio.timeout(0):
                    busy.append(await queue.get())

    for tenant in range(tenants):
        for number in range(400):
            queue.add(f"{tenant}-{number}")
        await take()
    for _ in range(200):
        queue.done(busy.pop(0))
        await take()
    has = Counter(key.partition("-")[0] for key in busy)
    assert len(has) == tenants
    assert (max(has.values()), 32 - has.total()) == (most, free)
