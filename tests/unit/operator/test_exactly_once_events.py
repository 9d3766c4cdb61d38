"""Every transition is reported exactly once, also by operators killed between two calls."""

import asyncio
from dataclasses import replace

import pytest

from bagpipe_operator.cluster.client import ApiError
from tests.unit.operator.builders import START, account, make_driver, make_executor, make_job
from tests.unit.operator.test_life import edit
from tests.unit.operator.test_reconcile import MISSING_ACCOUNT
from tests.unit.operator.world import World

KILLED = ApiError(0, "Unreachable", "killed")


async def killed_before_the_event(world: World) -> None:
    """The status is written, the Event is not, and the operator is no more."""
    world.api.fail("create events", KILLED)
    with pytest.raises(ApiError, match="killed"):
        await world.reconcile(after=2)
    world.reconciler = world.restarted(world.view)


async def test_what_a_killed_operator_owed_is_reported_by_the_next() -> None:
    world = World()
    await killed_before_the_event(world)
    assert world.reason("Accepted") == "True/DriverCreated"
    assert world.api.event_reasons() == []
    await world.reconcile(after=15)
    assert world.api.event_reasons() == ["DriverCreated"]


# Promise: reported-once
async def test_a_whole_life_under_an_operator_that_is_killed_at_every_step() -> None:
    world = World()
    await killed_before_the_event(world)
    await world.reconcile()
    world.deliver(make_driver("x").running(), make_executor("x").running())
    world.drivers.says = account()
    await killed_before_the_event(world)
    await world.reconcile()
    world.deliver(make_driver("x").ended(0, account("Complete", reason="AllCasesRan")))
    await killed_before_the_event(world)
    for _ in range(3):
        await world.reconcile(after=2)
        world.reconciler = world.restarted(world.view)
    assert world.reason("Complete") == "True/AllCasesRan"
    assert world.api.event_reasons() == [
        "DriverCreated",
        "CasesPlanned",
        "CasesRunning",
        "AllCasesRan",
    ]


async def test_a_replica_that_leads_again_reports_what_the_one_between_owed() -> None:
    world = World()
    first = world.reconciler
    await world.reconcile()
    second = world.restarted(world.view)
    world.reconciler = second
    await world.reconcile(after=2)
    world.deliver(make_driver("x").running(), make_executor("x").running())
    world.drivers.says = account()
    await killed_before_the_event(world)
    assert world.api.event_reasons() == ["DriverCreated"]
    world.reconciler = first
    first.begin_to_lead()
    for _ in range(3):
        await world.reconcile(after=2)
    assert world.api.event_reasons() == ["DriverCreated", "CasesPlanned", "CasesRunning"]


async def test_a_lead_that_lapses_loses_no_event_that_could_not_be_written() -> None:
    """An API server that takes no Events for long is also one that renews no Lease."""
    world = World()
    world.api.fail("create events", *[KILLED] * 3)
    with pytest.raises(ApiError, match="killed"):
        await world.reconcile()
    world.deliver(make_driver("x").ended(0, account("Complete", reason="AllCasesRan")))
    with pytest.raises(ApiError, match="killed"):
        await world.reconcile(after=2)
    assert world.api.event_reasons() == []
    world.reconciler.begin_to_lead()
    await world.reconcile(after=1200)
    assert world.api.event_reasons() == ["DriverCreated", "CasesPlanned", "AllCasesRan"]


async def test_what_was_owed_is_reported_before_another_status_takes_its_place() -> None:
    """Else an operator that is killed between the two would leave nobody who knows of it."""
    world = World()
    await world.reconcile()
    world.deliver(make_driver("x").waiting("driver", "ErrImagePull"))
    await killed_before_the_event(world)
    assert world.reason("Running") == "False/DriverImageUnavailable"
    world.deliver(make_driver("x").ended(0, account("Complete", reason="AllCasesRan")))
    world.api.fail("patch status", KILLED)
    with pytest.raises(ApiError, match="killed"):
        await world.reconcile(after=2)
    assert world.api.event_reasons() == ["DriverCreated", "DriverImageUnavailable"]


@pytest.mark.parametrize("fault", ["events", "status"])
async def test_nor_is_what_an_operator_owes_itself_put_off_beyond_another_status(
    fault: str,
) -> None:
    """An Event is refused once, or the answer to its status lost; then the job is suspended
    again, and the operator killed: the Event is all that is left of the resumption."""
    world = World(make_job("x").with_spec("suspend", True))
    await world.reconcile()
    edit(world, suspend=False)
    if fault == "events":
        world.api.fail("create events", KILLED)
    else:
        world.api.lost.add("patch status")
    with pytest.raises(ApiError):
        await world.reconcile()
    world.deliver_job()
    assert world.reason("Suspended") == "False/JobResumed"
    edit(world, suspend=True)
    world.api.lost.add("patch status")
    with pytest.raises(ApiError):
        await world.reconcile(after=2)
    world.reconciler = world.restarted(world.view)
    world.deliver_job()
    assert world.reason("Suspended") == "True/JobSuspended"
    await world.reconcile(after=15)
    assert world.api.event_reasons() == ["JobSuspended", "JobResumed", "JobSuspended"]


async def test_events_that_are_refused_at_first_sight_do_not_hold_the_job_up() -> None:
    world = World()
    await killed_before_the_event(world)
    world.deliver(make_driver("x").ended(0, account("Complete", reason="AllCasesRan")))
    world.api.fail("create events", KILLED)
    await world.reconcile(after=2)
    assert world.reason("Complete") == "True/AllCasesRan"
    assert world.api.event_reasons() == ["DriverCreated", "CasesPlanned", "AllCasesRan"]


async def test_an_event_whose_call_is_cancelled_is_written_later() -> None:
    world = World()
    world.api.fail("create events", asyncio.CancelledError())
    with pytest.raises(asyncio.CancelledError):
        await world.reconcile(after=2)
    assert world.api.event_reasons() == []
    await world.reconcile()
    assert "DriverCreated" in world.api.event_reasons()


async def test_a_restart_reports_nothing_that_was_long_ago() -> None:
    """Events are forgotten after an hour by default: reported again, they would be news."""
    world = World()
    await world.reconcile()
    world.api.objects = {key: o for key, o in world.api.objects.items() if key[0] != "events"}
    world.reconciler = world.restarted(world.view)
    await world.reconcile(after=600)
    assert world.api.event_reasons() == []


async def test_a_clock_that_was_ahead_makes_nothing_news_again() -> None:
    """Each operator that starts until then would report it once the API server has forgotten."""
    world = World()
    world.clock.advance(7200)
    await world.reconcile()
    world.clock.advance(-7200)
    world.api.objects = {key: o for key, o in world.api.objects.items() if key[0] != "events"}
    world.reconciler = world.restarted(world.view)
    await world.reconcile(after=1)
    assert world.api.event_reasons() == []


async def test_what_release_0_1_0_reported_under_other_names_is_not_reported_again() -> None:
    world = World()
    await killed_before_the_event(world)
    (job,) = world.view.jobs()
    before = {key: value for key, value in job.status.items() if key != "lostDrivers"}
    world.view.put_job(replace(job, status=before))
    await world.reconcile(after=15)
    assert world.api.event_reasons() == []


async def test_the_same_end_of_two_drivers_is_two_events() -> None:
    world = World()
    for attempt in (1, 2):
        await world.reconcile(after=2)
        world.deliver(make_driver("x", attempt).running())
        await world.reconcile(after=2)
        world.deliver(make_driver("x", attempt).ended(137, reason="OOMKilled"))
        await world.reconcile(after=2)
    assert world.api.event_reasons().count("DriverOutOfMemory") == 2


async def test_an_eviction_is_reported_when_it_begins_and_not_again_when_it_has_happened() -> None:
    world = World()
    await world.reconcile()
    world.drivers.says = account()
    pod = make_driver("x").running().disrupted("EvictionByEvictionAPI", "Eviction API: evicting")
    world.deliver(pod.deleting(gone_by="2026-11-20T04:00:30Z"), make_executor("x").running())
    await world.reconcile(after=2)
    assert world.reason("Running") == "True/DriverEvicted"
    world.deliver(pod.ended(143))
    await world.reconcile(after=5)
    assert (world.reason("Running"), world.status()["attempt"]) == ("False/DriverEvicted", 2)
    world.reconciler = world.restarted(world.view)
    await world.reconcile(after=5)
    assert world.reason("Running") == "False/DriverEvicted"
    assert world.api.event_reasons().count("DriverEvicted") == 1


async def test_a_trouble_beside_running_cases_is_a_warning() -> None:
    world = World()
    await world.reconcile()
    killed = {"terminated": {"exitCode": 137, "reason": "OOMKilled", "finishedAt": _at(world)}}
    pod = make_executor("x").running().with_container("stack", {"running": {}}, lastState=killed)
    world.deliver(make_driver("x").running(), pod)
    world.drivers.says = account()
    await world.reconcile(after=2)
    assert world.reason("Running") == "True/ExecutorOutOfMemory"
    await world.reconcile(after=60)
    assert world.reason("Running") == "True/CasesRunning"
    reported = [o for (kind, _), o in world.api.objects.items() if kind == "events"]
    assert [(o["type"], o["reason"]) for o in reported] == [
        ("Normal", "DriverCreated"),
        ("Normal", "CasesPlanned"),
        ("Warning", "ExecutorOutOfMemory"),
        ("Normal", "CasesRunning"),
    ]


def _at(world: World) -> str:
    assert world.clock.now() == START
    return START.isoformat()


@pytest.mark.parametrize("watch_is_behind", [False, True])
async def test_a_status_whose_answer_was_lost_is_reported_all_the_same(
    watch_is_behind: bool,
) -> None:
    """The write has happened, and nothing is left to be written at the next visit."""
    world = World()
    world.api.lost.add("patch status")
    with pytest.raises(ApiError, match="lost"):
        await world.reconcile()
    if watch_is_behind:
        with pytest.raises(ApiError, match="409"):
            await world.reconcile()
    else:
        world.deliver_job()
    for _ in range(2):
        await world.reconcile(after=0.5)
    assert world.api.event_reasons() == ["DriverCreated"]


async def test_a_write_that_did_not_happen_is_reported_once_when_it_has() -> None:
    world = World()
    world.api.fail("patch status", KILLED)
    with pytest.raises(ApiError, match="killed"):
        await world.reconcile()
    edit(world, activeDeadline="600s")
    for _ in range(2):
        await world.reconcile(after=0.5)
    assert world.api.event_reasons() == ["DriverCreated"]


async def test_an_event_whose_answer_was_lost_is_not_written_again_for_the_next_attempt() -> None:
    world = World()
    await world.reconcile()
    world.deliver(make_driver("x").waiting("driver", "ErrImagePull"))
    world.api.lost.add("create events")
    with pytest.raises(ApiError, match="lost"):
        await world.reconcile(after=1)
    world.deliver(make_driver("x").ended(137))
    await world.reconcile(after=0.5)
    assert world.status()["attempt"] == 2
    assert world.api.event_reasons() == ["DriverCreated", "DriverImageUnavailable", "DriverFailed"]


async def test_an_end_with_the_reason_of_an_event_is_reported_by_the_next_operator() -> None:
    """The refusal was reported when it began; the end has its reason, and an Event of its own."""
    world = World()
    world.api.fail("create pods", *[MISSING_ACCOUNT] * 2)
    await world.reconcile()
    world.clock.advance(28)
    await killed_before_the_event(world)
    assert world.reason("Failed") == "True/ServiceAccountMissing"
    assert world.api.event_reasons() == ["ServiceAccountMissing"]
    for _ in range(2):
        await world.reconcile(after=2)
        world.reconciler = world.restarted(world.view)
    assert world.api.event_reasons() == ["ServiceAccountMissing"] * 2


async def test_an_end_at_once_is_reported_once_whoever_reports_it() -> None:
    world = World(make_job("x").with_spec("stack.parameters", {"threshold": 0.5}))
    for _ in range(2):
        await world.reconcile(after=2)
        world.reconciler = world.restarted(world.view)
    assert world.reason("Accepted") == "False/SpecInvalid"
    assert world.api.event_reasons() == ["SpecInvalid"]
