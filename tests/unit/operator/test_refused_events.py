"""Events that are refused for long, as by a webhook that is down or by EventRateLimit.

Nothing that others wait for waits with them, and they are written once they are taken.
"""

import contextlib

import pytest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.event_recorder import MOST_SECONDS
from tests.unit.operator.builders import account, make_driver, make_executor, make_job
from tests.unit.operator.kueue.test_queueing import running
from tests.unit.operator.world import World

REFUSED = [
    ApiError(500, "InternalError", "failed calling webhook events.example.com"),
    ApiError(429, "TooManyRequests", "event rate limit"),
]
ENDED = account("Complete", reason="AllCasesRan")


async def visit(world: World, after: float, times: int = 1) -> None:
    for _ in range(times):
        with contextlib.suppress(ApiError):
            await world.reconcile(after=after)


def refuse_events(world: World, error: ApiError = REFUSED[0]) -> None:
    world.api.fail("create events", *[error] * 1000)


def take_events(world: World) -> None:
    world.api.faults["create events"] = []


@pytest.mark.parametrize("refused", REFUSED)
async def test_the_quota_of_an_ended_job_goes_back_at_once(refused: ApiError) -> None:
    world = await running()
    refuse_events(world, refused)
    world.deliver(make_driver("x").ended(0, ENDED))
    await visit(world, after=2)
    assert world.reason("Complete") == "True/AllCasesRan"
    assert world.condition("Finished").startswith("True")
    take_events(world)
    await visit(world, after=2)
    assert "AllCasesRan" in world.api.event_reasons()


@pytest.mark.parametrize("refused", REFUSED)
async def test_an_ended_job_stays_for_its_events_for_so_long_and_no_longer(
    refused: ApiError,
) -> None:
    world = World(make_job("x").with_spec("ttlAfterFinished", "60s"))
    await world.reconcile()
    refuse_events(world, refused)
    world.deliver(make_driver("x").ended(0, ENDED))
    await visit(world, after=2)
    await visit(world, after=MOST_SECONDS - 1)
    assert ("jobs", "x") in world.api.objects
    await visit(world, after=1)
    assert ("jobs", "x") not in world.api.objects


async def test_events_that_are_taken_in_that_time_are_written_before_the_job_goes() -> None:
    world = World(make_job("x").with_spec("ttlAfterFinished", "60s"))
    await world.reconcile()
    refuse_events(world)
    world.deliver(make_driver("x").ended(0, ENDED))
    await visit(world, after=2)
    await visit(world, after=120, times=3)
    take_events(world)
    await visit(world, after=120)
    assert "AllCasesRan" in world.api.event_reasons()
    assert ("jobs", "x") not in world.api.objects


async def test_a_job_that_goes_on_is_visited_as_ever_and_its_events_wait_by_themselves() -> None:
    world = World()
    refuse_events(world)
    await visit(world, after=2, times=3)
    world.deliver(make_driver("x").running(), make_executor("x").running())
    world.drivers.says = account()
    for _ in range(300):
        await world.reconcile(after=2)
    assert world.reason("Running") == "True/CasesRunning"
    tries = world.api.calls.count("create events")
    assert 8 <= tries <= 20, tries
    take_events(world)
    for _ in range(61):
        await world.reconcile(after=2)
    assert {"DriverCreated", "CasesRunning"} <= set(world.api.event_reasons())
