"""A run that passed is known at each moment: by its job, or else by its schedule's status.

Who looks between the two would find no baseline, and call its own run Passed by its cases alone.
"""

from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.policies.last_passed import MOST_LISTED
from bagpipe_operator.jobs.reconcile import Reconciler
from tests.unit.operator.test_last_passed import RUNS, kept, run, schedule, world_of
from tests.unit.operator.world import World

NAME = f"nightly-{RUNS[2]}"
UID = f"uid-of-{NAME}"


@pytest.mark.parametrize("first", ["get_schedule", "list_jobs"])
async def test_a_run_whose_job_goes_while_it_is_looked_for_is_found(
    first: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The schedule's status names it before its job is deleted, as by the history's limit."""
    world = world_of(run(RUNS[2]))
    real: Callable[..., Awaitable[Any]] = getattr(world.api, first)

    async def then_it_goes(*given: Any) -> Any:
        answer = await real(*given)
        world.api.put("schedules", schedule(lastPassed=kept(RUNS[2])))
        world.api.objects.pop(("jobs", NAME), None)
        return answer

    monkeypatch.setattr(world.api, first, then_it_goes)
    await world.reconcile()
    assert world.status()["baseline"]["job"] == NAME


def ended_run(ttl: str = "0s", passed: str = "True", **written: Any) -> tuple[World, Reconciler]:
    """A run that has ended, whose time is over, and its schedule with that status."""
    job = run(RUNS[2], passed, completionTime="2026-11-20T04:00:00Z", observedGeneration=1)
    job["spec"]["ttlAfterFinished"] = ttl
    world = world_of(job, **written)
    world.view.put_job(JobView.from_object(job))
    return world, world.reconciler


def is_there(world: World) -> bool:
    return ("jobs", NAME) in world.api.objects


@pytest.mark.parametrize("written", [{}, {"lastPassed": kept(RUNS[1])}])
async def test_a_run_that_passed_is_kept_until_its_schedule_names_it(written: Json) -> None:
    if written:
        written["lastPassed"]["scheduleTime"] = "2026-11-18T02:30:00Z"
    world, reconciler = ended_run(**written)
    await reconciler.reconcile(UID)
    assert is_there(world)
    world.api.put("schedules", schedule(lastPassed=kept(RUNS[2])))
    await reconciler.reconcile(UID)
    assert not is_there(world)


@pytest.mark.parametrize("passed", ["False", "Unknown"])
async def test_a_run_that_did_not_pass_waits_for_nothing(passed: str) -> None:
    world, reconciler = ended_run(passed=passed)
    await reconciler.reconcile(UID)
    assert not is_there(world)
    assert "get schedule" not in world.api.calls


async def test_a_later_run_that_the_schedule_names_is_enough() -> None:
    world, reconciler = ended_run(
        lastPassed=kept(RUNS[3]) | {"scheduleTime": "2026-11-20T02:30:00Z"}
    )
    await reconciler.reconcile(UID)
    assert not is_there(world)


@pytest.mark.parametrize("there", [None, "uid-of-another"])
async def test_a_run_of_a_schedule_that_is_gone_waits_for_nothing(there: str | None) -> None:
    world, reconciler = ended_run()
    del world.api.objects["schedules", "nightly"]
    if there:
        another = schedule()
        another["metadata"]["uid"] = there
        world.api.put("schedules", another)
    await reconciler.reconcile(UID)
    assert not is_there(world)


async def test_a_run_before_its_time_asks_for_nothing() -> None:
    world, reconciler = ended_run(ttl="1h")
    await reconciler.reconcile(UID)
    assert is_there(world)
    assert "get schedule" not in world.api.calls


@pytest.mark.parametrize("more", [1.0, 1.5])
async def test_a_schedule_that_never_names_it_keeps_no_job_for_ever(more: float) -> None:
    """As where the CRD is that of a release without status.lastPassed."""
    world, reconciler = ended_run()
    await reconciler.reconcile(UID)
    world.clock.advance(599.0)
    await reconciler.reconcile(UID)
    assert is_there(world)
    world.clock.advance(more)
    await reconciler.reconcile(UID)
    assert not is_there(world)


async def test_where_the_schedule_can_t_be_read_the_job_stays() -> None:
    world, reconciler = ended_run(lastPassed=kept(RUNS[2]))
    world.api.fail("get schedule", ApiError(0, "Unreachable", "no answer"))
    with pytest.raises(ApiError):
        await reconciler.reconcile(UID)
    assert is_there(world)


async def test_no_more_jobs_are_read_than_a_schedule_has() -> None:
    world = world_of(*(run(29914710 + n, "False") for n in range(MOST_LISTED)), run(RUNS[1]))
    await world.reconcile()
    assert world.reason("Failed") == "True/BaselineRefused"
    assert world.message("Failed").startswith("More than 1,000 jobs in namespace lanes have the")
    world = world_of(*(run(29914710 + n) for n in range(MOST_LISTED)))
    await world.reconcile()
    assert world.status()["baseline"]["job"] == f"nightly-{29914710 + MOST_LISTED - 1}"
