"""Deletions of pods that are slow hold up no report of their job, and go on at the next visit."""

import asyncio

import pytest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.runtime.work import RECONCILE_SECONDS
from tests.unit.operator import virtual_time
from tests.unit.operator.builders import account, make_driver, make_executor
from tests.unit.operator.world import World

EXECUTORS = 20


async def with_many_executors(attempt: int) -> World:
    """The second attempt runs, with executors of that attempt or the one before; their deletion
    takes five seconds each."""
    world = World()
    await world.reconcile()
    world.deliver(make_driver("x").ended(137))
    for _ in range(3):
        await world.reconcile(after=30)
    world.deliver(make_driver("x", attempt=2).running())
    await world.reconcile(after=2)
    executors = [make_executor("x", number, attempt) for number in range(1, EXECUTORS + 1)]
    world.deliver(*(each.running() for each in executors))
    delete_pod = world.api.delete_pod

    async def slow(namespace: str, name: str, uid: str, grace_seconds: int | None = None) -> bool:
        await asyncio.sleep(5)
        deleted = await delete_pod(namespace, name, uid, grace_seconds)
        for pod in [pod for pod in world.view.all_pods() if pod.name == name]:
            world.view.drop_pod(pod)  # the watch reports it
        return deleted

    world.api.delete_pod = slow  # type: ignore[method-assign]
    return world


def left(world: World) -> int:
    return sum("exec" in name for name in world.api.named("pods"))


@pytest.mark.parametrize("attempt", [1, 2])
def test_the_end_is_reported_at_the_first_visit_and_the_pods_go_bit_by_bit(attempt: int) -> None:
    async def visits() -> None:
        world = await with_many_executors(attempt)
        world.deliver(make_driver("x", 2).ended(0, account("Complete", verdict="Passed")))
        rest = EXECUTORS
        while rest:
            try:
                async with asyncio.timeout(RECONCILE_SECONDS):
                    await world.reconcile(after=1)
            except ApiError as error:
                assert "pods are still being deleted" in str(error)
            assert world.status()["phase"] == "Complete"
            assert left(world) < rest
            rest = left(world)
        assert world.api.event_reasons().count("JobComplete") == 1

    virtual_time.run(visits())


def test_who_goes_on_is_reported_meanwhile() -> None:
    async def visit() -> None:
        world = await with_many_executors(1)
        world.drivers.says = account(cases={"planned": 4, "running": 2, "passed": 2})
        async with asyncio.timeout(RECONCILE_SECONDS):
            with pytest.raises(ApiError, match="pods are still being deleted"):
                await world.reconcile(after=2)
        assert world.status()["cases"]["passed"] == 2
        assert left(world) < EXECUTORS

    virtual_time.run(visit())
