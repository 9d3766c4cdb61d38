"""A driver's pod is gone, the watch does not say so yet, and another pod has its address."""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest
from aiohttp import web

from bagpipe_operator.cluster.client import ApiError
from tests.unit.operator.builders import PodBuilder, account, make_driver
from tests.unit.operator.test_deleted_jobs import delete
from tests.unit.operator.test_progress import driver
from tests.unit.operator.world import UID, World

MINE: dict[str, Any] = {"uid": UID, "attempt": 1}
PASSED: dict[str, Any] = {"verdict": "Passed", "cases": {"planned": 4, "passed": 4}}
DONE = account("Complete", ended=True, **PASSED, **MINE)


@asynccontextmanager
async def answered(*bodies: str) -> AsyncIterator[World]:
    """A job whose driver runs at an address that gives these answers, the last one again."""
    left = list(bodies)

    async def handler(_: web.Request) -> web.Response:
        return web.Response(text=left[0] if len(left) == 1 else left.pop(0))

    async with driver(handler) as reader:
        world = World()
        await world.reconcile()
        world.restart(drivers=reader)
        world.deliver(make_driver("x").running(ip="127.0.0.1"))
        yield world


@pytest.mark.parametrize("whose", [{}, {"uid": UID}, {"attempt": 1}, MINE])
async def test_an_end_that_another_reports_from_a_driver_s_address_is_none(
    whose: dict[str, Any],
) -> None:
    """Whatever it knows of the job: its driver's pod is asked for."""
    async with answered(account("Complete", ended=True, **PASSED, **whose)) as world:
        world.api.objects.pop(("pods", "x-1-driver"))
        await world.reconcile()
        assert world.status()["phase"] != "Complete"
        assert world.status().get("verdict") is None
        assert world.reason("Passed").startswith("Unknown/")


async def test_an_end_that_is_reported_while_the_pod_is_there_counts_once_it_names_the_job() -> (
    None
):
    async with answered(DONE) as world:
        await world.reconcile()
        assert (world.status()["phase"], world.reason("Passed")) == ("Complete", "True/Passed")
        assert world.api.calls.count("get pods") == 1


async def test_an_end_without_a_name_is_not_believed_while_the_pod_is_there() -> None:
    """No driver of an earlier release says that it has ended and waits: it ends its pod."""
    async with answered(account("Complete", ended=True, **PASSED)) as world:
        await world.reconcile()
        assert world.status()["phase"] != "Complete"
        world.deliver(make_driver("x").ended(0, account("Complete", **PASSED)))
        await world.reconcile()
        assert (world.status()["phase"], world.reason("Passed")) == ("Complete", "True/Passed")


async def test_the_end_that_the_pod_shows_is_the_one_that_counts() -> None:
    async with answered(DONE) as world:
        failed = account("Failed", reason="StorageUnwritable", message="No room.", **MINE)
        world.api.put("pods", make_driver("x").ended(1, failed).object())
        await world.reconcile()
        assert world.reason("Failed") == "True/StorageUnwritable"


async def test_an_end_from_the_address_that_the_driver_had_before_counts_for_nothing() -> None:
    async with answered(DONE) as world:
        world.api.put("pods", make_driver("x").running(ip="127.0.0.9").object())
        await world.reconcile()
        assert (world.status()["phase"], world.status()["attempt"]) == ("Planning", 1)


async def test_a_driver_that_has_named_its_job_does_so_each_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else another's account without a name would be that of an earlier release's driver."""
    monkeypatch.setattr("bagpipe_operator.jobs.driver.progress.LEAST_INTERVAL_SECONDS", 0.0)
    forged = account(cases={"planned": 9, "passed": 9})
    async with answered(account(**MINE), forged) as world:
        for _ in range(2):
            await world.reconcile(after=30)
            assert world.status()["cases"]["planned"] == 4


async def test_the_account_of_an_earlier_release_s_driver_is_shown_until_its_pod_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It names no job: an operator that is upgraded meets such drivers."""
    monkeypatch.setattr("bagpipe_operator.jobs.driver.progress.LEAST_INTERVAL_SECONDS", 0.0)
    done = account("Complete", **PASSED)
    async with answered(account(), done) as world:
        await world.reconcile()
        assert (world.status()["phase"], world.status()["cases"]["passed"]) == ("Running", 1)
        await world.reconcile(after=30)
        assert (world.status()["phase"], world.status()["cases"]["passed"]) == ("Running", 4)
        world.deliver(make_driver("x").ended(0, done))
        await world.reconcile()
        assert (world.status()["phase"], world.reason("Passed")) == ("Complete", "True/Passed")


@pytest.mark.parametrize("watch_is_first", [False, True])
@pytest.mark.parametrize("deleted", [False, True])
@pytest.mark.parametrize("backoff_limit", [None, 0])
async def test_an_end_that_the_pod_has_confirmed_counts_when_the_pod_goes_before_it_is_written(
    backoff_limit: int | None, deleted: bool, watch_is_first: bool
) -> None:
    """The job was run again, or had failed with DriverLost."""
    async with answered(DONE) as world:
        if backoff_limit is not None:
            world.api.objects["jobs", "x"]["spec"]["backoffLimit"] = backoff_limit
            world.deliver_job()
        world.api.fail("patch status", ApiError(500, "InternalError", "etcd has no leader"))
        with pytest.raises(ApiError, match="no leader"):
            await world.reconcile()
        if deleted:
            delete(world)
        world.api.objects.pop(("pods", "x-1-driver"))
        if watch_is_first:
            world.view.drop_pod(make_driver("x").running(ip="127.0.0.1").view())
        await world.reconcile(after=5)
        assert (world.status()["phase"], world.reason("Passed")) == ("Complete", "True/Passed")
        assert world.status()["attempt"] == 1
        assert world.api.named("pods") == []


WENT_WRONG: dict[str, Callable[[], PodBuilder]] = {
    "evicted by its node": lambda: make_driver("x").evicted("The node was low on memory."),
    "drained": lambda: make_driver("x").ended(137).disrupted("EvictionByEvictionAPI", "drain"),
    "out of memory": lambda: make_driver("x").ended(137, DONE, "OOMKilled"),
    "killed": lambda: make_driver("x").ended(137, DONE),
    "killed without an account": lambda: make_driver("x").ended(137),
    "deleted by force": lambda: make_driver("x").ended(137, DONE).deleting(),
    "lost with its node": lambda: make_driver("x").running().deleting("2026-01-01T00:00:00Z"),
    "without an address": lambda: make_driver("x").running(ip=""),
}


@pytest.mark.parametrize("went_wrong", WENT_WRONG)
@pytest.mark.parametrize("backoff_limit", [None, 0])
async def test_an_end_that_the_pod_has_confirmed_counts_whatever_becomes_of_the_pod(
    backoff_limit: int | None, went_wrong: str
) -> None:
    """Before it is written the pod waits for another job, and may be ended as any other."""
    async with answered(DONE) as world:
        if backoff_limit is not None:
            world.api.objects["jobs", "x"]["spec"]["backoffLimit"] = backoff_limit
            world.deliver_job()
        world.api.fail("patch status", ApiError(500, "InternalError", "etcd has no leader"))
        with pytest.raises(ApiError, match="no leader"):
            await world.reconcile()
        world.deliver(WENT_WRONG[went_wrong]())
        await world.reconcile(after=5)
        assert (world.status()["phase"], world.reason("Passed")) == ("Complete", "True/Passed")
        assert world.status()["attempt"] == 1


async def test_the_confirmed_end_of_an_attempt_is_not_that_of_the_next_one() -> None:
    """Its driver is lost before it has reported anything."""
    async with answered(DONE) as world:
        world.api.fail("patch status", ApiError(500, "InternalError", "etcd has no leader"))
        with pytest.raises(ApiError, match="no leader"):
            await world.reconcile()
        world.api.objects["jobs", "x"]["status"]["attempt"] = 2
        world.deliver_job()
        world.api.objects.pop(("pods", "x-1-driver"))
        await world.reconcile(after=60)
        assert world.status().get("verdict") is None
        assert world.status()["phase"] != "Complete"
