"""The condition Passed: what gates wait for, of every end of a job, also of earlier ends."""

from typing import Any

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.policies import verdict
from tests.unit.operator.builders import JobBuilder, account, make_driver, make_executor, make_job
from tests.unit.operator.test_life import without_events
from tests.unit.operator.world import World

GOOD = {"planned": 4, "passed": 4}


async def ended(phase: str, **fields: Any) -> World:
    world = World(make_job("x"))
    await world.reconcile()
    world.deliver(make_driver("x").running())
    world.deliver(make_executor("x").running())
    world.drivers.says = account()
    await world.reconcile(after=2)
    assert world.reason("Passed") == "Unknown/NotEnded"
    world.deliver(make_driver("x").ended(int(phase == "Failed"), account(phase, **fields)))
    await world.reconcile(after=2)
    return world


# Promise: passed-gates
@pytest.mark.parametrize(
    ("fields", "reported"),
    [
        ({"verdict": "Passed", "cases": GOOD}, "True/Passed"),
        ({"verdict": "Failed", "cases": {"planned": 4, "passed": 3, "failed": 1}}, "False/Failed"),
        ({"verdict": "Failed", "cases": GOOD | {"regressed": 2}}, "False/Regressed"),
        ({"verdict": "Invalid", "cases": {"planned": 4, "invalid": 4}}, "False/Invalid"),
        ({"verdict": "", "cases": GOOD}, "False/NoVerdict"),
        # What decided is the driver's to say, where it does.
        ({"verdict": "Failed", "verdictReason": "WorseCriteria"}, "False/WorseCriteria"),
        ({"verdict": "Passed", "verdictReason": ""}, "True/Passed"),
    ],
)
async def test_a_complete_job_passed_by_its_verdict_alone(fields: Json, reported: str) -> None:
    world = await ended("Complete", reason="AllCasesRan", message="All ran.", **fields)
    assert world.reason("Complete") == "True/AllCasesRan"
    assert world.reason("Passed") == reported
    passed = next(c for c in world.status()["conditions"] if c["type"] == "Passed")
    assert passed["message"] == "All ran."
    assert passed["lastTransitionTime"] == world.status()["completionTime"]


# Promise: passed-gates
async def test_a_failed_job_has_not_passed_for_the_reason_of_its_failure() -> None:
    # Whatever verdict a driver reports: a job that could not be run has none that counts.
    world = await ended("Failed", reason="BagMissing", message="no bag", verdict="Passed")
    assert world.reason("Failed") == "True/BagMissing"
    assert world.reason("Passed") == "False/BagMissing"


async def test_a_job_that_could_not_be_run_has_no_verdict_to_be_read() -> None:
    world = await ended("Failed", reason="StorageFailed", message="no room", verdict="Passed")
    assert world.status()["phase"] == "Failed"
    assert "verdict" not in world.status()


async def test_a_verdict_is_there_with_the_end_of_its_job_and_not_before() -> None:
    """A driver decides, and then commits: its storage may be gone for as long as it has patience,
    and so may it be itself."""
    decided = account("Complete", reason="AllCasesRan", verdict="Passed", cases=GOOD)
    world = World(make_job("x").with_spec("backoffLimit", 1))
    await world.reconcile()
    for attempt in (1, 2):
        world.deliver(make_driver("x", attempt).running())
        world.deliver(make_executor("x", attempt=attempt).running())
        world.drivers.says = decided
        await world.reconcile(after=2)
        assert (world.status()["phase"], world.status()["cases"]["passed"]) == ("Running", 4)
        assert "verdict" not in world.status()
        world.deliver(make_driver("x", attempt).ended(143, decided))
        await world.reconcile(after=2)
        assert "verdict" not in world.status()
        await world.reconcile(after=30)
    assert world.reason("Failed") == "True/DriverFailed"
    assert world.reason("Passed") == "False/DriverFailed"
    assert "verdict" not in world.status()


async def test_passed_has_no_event_of_its_own() -> None:
    world = await ended("Complete", reason="AllCasesRan", verdict="Passed", cases=GOOD)
    reported = world.api.event_reasons()
    assert reported.count("AllCasesRan") == 1
    assert "Passed" not in reported


def of_an_earlier_release(kind: str, reason: str, **status: Any) -> JobBuilder:
    reported = [
        {
            "type": each,
            "status": "True" if each == kind else "False",
            "reason": reason if each == kind else "JobComplete",
            "message": "As it was.",
            "observedGeneration": 1,
            "lastTransitionTime": "2026-11-20T03:00:00Z",
        }
        for each in ("Accepted", "Running", "Complete", "Failed")
    ]
    return make_job("x").with_status(
        conditions=reported, completionTime="2026-11-20T03:00:05Z", observedGeneration=1,
        lostDrivers=0, **status,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("job", "reported"),
    [
        (of_an_earlier_release("Complete", "AllCasesRan", verdict="Passed"), "True/Passed"),
        (
            of_an_earlier_release("Complete", "AllCasesRan", verdict="Failed", cases={"failed": 1}),
            "False/Failed",
        ),
        (of_an_earlier_release("Failed", "StorageFailed", verdict=""), "False/StorageFailed"),
    ],
)
async def test_a_job_that_ended_before_the_upgrade_gets_it_by_one_write(
    job: JobBuilder, reported: str
) -> None:
    before = list(job.object["status"]["conditions"])
    world = World(job)
    await world.reconcile()
    assert without_events(world.api.calls) == ["patch status"]
    assert world.reason("Passed") == reported
    assert world.status()["conditions"][:4] == before  # it keeps what it reported
    new = world.status()["conditions"][4]
    assert (new["lastTransitionTime"], new["message"]) == ("2026-11-20T03:00:05Z", "As it was.")
    for _ in range(3):
        await world.reconcile(after=2)
    world.reconciler = world.restarted(world.view)
    await world.reconcile(after=600)
    assert without_events(world.api.calls) == ["patch status"]
    assert world.api.event_reasons() == []


def test_a_status_without_what_later_releases_write_is_completed_all_the_same() -> None:
    reported = {
        "type": "Complete", "status": "True", "reason": "AllCasesRan", "message": "",
        "lastTransitionTime": "2026-11-20T03:00:00Z",
    }  # fmt: skip
    [_, new] = verdict.completed({"conditions": [reported], "verdict": "Passed"})
    assert new["lastTransitionTime"] == "2026-11-20T03:00:00Z"
    assert new["observedGeneration"] == 0


async def test_an_end_is_reported_also_while_its_pods_can_not_be_deleted() -> None:
    world = World(make_job("x"))
    await world.reconcile()
    world.deliver(make_driver("x").running(), make_executor("x").running())
    world.drivers.says = account()
    await world.reconcile(after=2)
    world.api.fail("delete x-1-exec-1", *[ApiError(500, "InternalError", "no webhook")] * 2)
    text = account("Complete", verdict="Passed", cases=GOOD)
    world.deliver(make_driver("x").ended(0, text))
    for _ in range(2):
        with pytest.raises(ApiError, match="no webhook"):
            await world.reconcile(after=2)
        assert world.reason("Passed") == "True/Passed"
        assert world.api.event_reasons()[-1] == "JobComplete"
    await world.reconcile(after=2)
    assert "x-1-exec-1" not in world.api.named("pods")
    assert world.api.event_reasons().count("JobComplete") == 1
