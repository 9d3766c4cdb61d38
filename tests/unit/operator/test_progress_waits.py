"""While the API server is busy, counts of running jobs wait; nothing else does."""

from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import pytest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import account, make_driver, make_executor
from tests.unit.operator.world import UID, World


async def running(settings: Settings | None = None, **fields: Any) -> World:
    """A job whose first cases run, as its status says."""
    world = World(settings=settings)
    world.restart(**fields)
    await world.reconcile()
    world.deliver(make_driver("x").running(), make_executor("x").running())
    world.drivers.says = passed(1)
    await world.reconcile(after=2)
    assert world.status()["cases"]["passed"] == 1
    return world


def passed(count: int, **changes: int) -> str:
    return account(cases={"planned": 100, "running": 2, "passed": count} | changes)


def make_busy(world: World) -> None:
    """Sixty writes of another job's at once take a second, which has passed then."""
    with ExitStack() as under_way:
        for _ in range(60):
            under_way.enter_context(world.reconciler.pace.writing("another", urgent=True))
        world.clock.advance(1)


async def visits(world: World, seconds: int) -> list[int]:
    """The counts that the status stated after each visit, one every two seconds."""
    stated = []
    for second in range(0, seconds, 2):
        make_busy(world)
        world.drivers.says = passed(2 + second)
        await world.reconcile(after=1)
        stated.append(world.status()["cases"]["passed"])
    return stated


# Promise: progress-waits-30-s
async def test_counts_wait_for_thirty_seconds_and_are_then_those_of_now() -> None:
    decided: list[str] = []
    world = await running(paced=decided.append)
    decided.clear()
    assert await visits(world, 28) == [1] * 14
    assert decided == ["put_off"] * 14
    assert await visits(world, 30) == [2] * 15
    assert decided == ["put_off"] * 14 + ["progress"] + ["put_off"] * 14


async def test_with_a_quick_api_server_each_visit_writes_what_it_found() -> None:
    world = await running()
    for count in range(2, 20):
        world.drivers.says = passed(count)
        await world.reconcile(after=2)
        assert world.status()["cases"]["passed"] == count


async def test_the_wait_is_what_the_settings_say() -> None:
    world = await running(replace(Settings(), progress_wait_seconds=6))
    assert await visits(world, 8) == [1, 1, 6, 6]


# Promise: nothing-else-waits
async def test_a_first_fault_does_not_wait_and_brings_the_counts_along() -> None:
    world = await running()
    make_busy(world)
    world.drivers.says = passed(7, failed=1)
    await world.reconcile(after=2)
    assert (world.status()["cases"]["failed"], world.status()["cases"]["passed"]) == (1, 7)


async def test_what_a_pod_says_does_not_wait() -> None:
    world = await running()
    make_busy(world)
    world.deliver(make_executor("x", 2).waiting("spark", "ImagePullBackOff", "no such image"))
    await world.reconcile(after=2)
    assert "no such image" in world.message("Running")


# Promise: final-counts
async def test_the_counts_of_a_job_that_ended_are_final_however_busy_it_is() -> None:
    world = await running()
    assert await visits(world, 10) == [1] * 5
    done = account(
        "Complete", reason="AllCasesPassed", message="All passed.", verdict="Passed",
        cases={"planned": 100, "running": 0, "passed": 100},
    )  # fmt: skip
    make_busy(world)
    world.deliver(make_driver("x").ended(0, done))
    await world.reconcile(after=2)
    assert world.status()["phase"] == "Complete"
    assert world.status()["cases"]["passed"] == 100
    assert list(world.reconciler.pace._waits_since) == ["another"]


async def test_a_suspended_job_says_at_once_what_it_had_done() -> None:
    world = await running()
    await visits(world, 6)
    make_busy(world)
    world.api.objects["jobs", "x"]["spec"]["suspend"] = True
    world.api.objects["jobs", "x"]["metadata"]["resourceVersion"] = "900"
    world.api.version = 900
    world.deliver_job()
    await world.reconcile(after=2)
    assert world.reason("Suspended") == "False/Suspending"
    assert world.status()["cases"]["passed"] == 6


async def test_a_write_that_failed_is_tried_again_at_once() -> None:
    world = await running()
    make_busy(world)
    world.api.fail("patch status", ApiError(0, "Unreachable", "no answer"))
    world.drivers.says = passed(50)
    with pytest.raises(ApiError):
        await world.reconcile(after=30)
    make_busy(world)
    await world.reconcile(after=0.5)
    assert world.status()["cases"]["passed"] == 50


async def test_a_job_that_is_gone_leaves_nothing_behind() -> None:
    world = await running()
    world.view.drop_job(UID)
    await world.reconcile()
    assert UID not in world.reconciler.pace._waits_since


async def test_who_leads_again_knows_of_no_busy_api_server() -> None:
    world = await running()
    make_busy(world)
    assert world.reconciler.pace.interval() == 30
    world.reconciler.begin_to_lead()
    assert world.reconciler.pace.interval() == 0
