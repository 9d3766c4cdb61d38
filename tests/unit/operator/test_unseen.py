"""Pods that go while the watch is restarted: it lists what is there, and nothing else."""

import pytest

from tests.unit.operator.builders import make_driver, make_executor, make_job
from tests.unit.operator.test_life import edit, gone, running
from tests.unit.operator.world import UID, World


def vanish(world: World, *pod_names: str) -> None:
    """The API server has the pods no more, and the watch says nothing."""
    for name in pod_names:
        world.api.objects.pop(("pods", name), None)


@pytest.mark.parametrize("who", [["x-1-exec-1"], ["x-1-driver"], ["x-1-driver", "x-1-exec-1"]])
async def test_a_pod_that_went_unseen_does_not_hold_up_the_suspension(who: list[str]) -> None:
    world = World()
    await running(world)
    vanish(world, *who)
    edit(world, suspend=True)
    await world.reconcile()
    assert world.reason("Suspended") == "False/Suspending"
    gone(world, *[name for name in ("x-1-driver", "x-1-exec-1") if name not in who])
    for _ in range(3):
        await world.reconcile(after=1)
    assert world.reason("Suspended") == "True/JobSuspended"
    assert (world.status()["attempt"], world.status()["lostDrivers"]) == (2, 0)
    deletions = [call for call in world.api.calls if "delete" in call]
    assert len(deletions) <= 2, "it was asked for again and again"


@pytest.mark.parametrize("who", [["x-1-exec-1"], ["x-1-driver", "x-1-exec-1"]])
async def test_a_pod_that_went_unseen_does_not_hold_up_the_deadline(who: list[str]) -> None:
    world = World(make_job("x").with_spec("activeDeadline", "60s"))
    await running(world)
    vanish(world, *who)
    await world.reconcile(after=60)
    gone(world, "x-1-driver" if "x-1-driver" not in who else "")
    for _ in range(3):
        await world.reconcile(after=1)
    assert world.reason("Failed") == "True/DeadlineExceeded"


async def test_a_pending_driver_that_went_unseen_does_not_hold_up_the_deadline() -> None:
    world = World(make_job("x").with_spec("activeDeadline", "20s"))
    await world.reconcile()
    vanish(world, "x-1-driver")
    await world.reconcile(after=20)
    await world.reconcile(after=1)
    assert world.reason("Failed") == "True/DeadlineExceeded"


async def test_a_pending_driver_that_went_unseen_is_replaced() -> None:
    """It is never asked for its progress, so its silence shows nothing."""
    world = World()
    await world.reconcile()
    vanish(world, "x-1-driver")
    await world.reconcile(after=2)
    await world.reconcile(after=27)
    assert (world.status()["attempt"], world.api.calls.count("get pods")) == (1, 0)
    await world.reconcile(after=1)
    assert (world.status()["attempt"], world.reason("Running")) == (2, "False/DriverLost")
    assert world.view.driver(UID, 1) is None


async def test_a_pending_driver_is_looked_for_every_thirty_seconds() -> None:
    world = World()
    await world.reconcile()
    world.deliver(make_driver("x").unschedulable("0/3 nodes are available."))
    for _ in range(60):
        await world.reconcile(after=2)
    assert world.reason("Running") == "False/Unschedulable"
    assert world.api.calls.count("get pods") == 4
    world.api.put("pods", make_driver("x").running().object())  # and the watch has not reported
    for _ in range(16):
        await world.reconcile(after=2)
    assert (world.status()["phase"], world.status()["attempt"]) == ("Planning", 1)
    world.api.calls.clear()
    for _ in range(60):
        await world.reconcile(after=2)
    assert world.api.calls == []


async def test_a_driver_that_stays_silent_is_looked_for_every_thirty_seconds() -> None:
    """Not at each visit, which would be a call to the API server every two seconds."""
    world = World()
    await running(world)
    world.drivers.says, world.drivers.silent = None, 30.0
    for _ in range(60):
        await world.reconcile(after=2)
    assert world.api.calls.count("get pods") == 4
    vanish(world, "x-1-driver")
    await world.reconcile(after=2)
    assert (world.status()["attempt"], world.reason("Running")) == (2, "False/DriverLost")


async def test_many_pending_drivers_are_looked_for_more_seldom() -> None:
    """A queue of thousands that wait for a place must not cost the API server its breath."""
    world = World()
    jobs = [make_job(f"j{number}") for number in range(600)]
    for job in jobs:
        name = job.object["metadata"]["name"]
        status = {"driver": f"{name}-1-driver", "phase": "Pending", "attempt": 1}
        world.view.put_job(job.with_status(**status).view())
        world.view.put_pod(make_driver(name).view())
        world.api.put("jobs", job.object)
        world.api.put("pods", make_driver(name).object())
    for seconds, looks in ((0, 0), (31, 0), (30, 600)):
        world.clock.advance(seconds)
        for job in jobs:
            await world.reconciler.reconcile(job.object["metadata"]["uid"])
        assert world.api.calls.count("get pods") == looks


async def test_an_executor_of_a_replaced_driver_that_went_unseen_is_asked_for_once() -> None:
    world = World()
    await world.reconcile()
    world.deliver(make_driver("x").ended(137), make_executor("x").running())
    vanish(world, "x-1-exec-1")
    for _ in range(5):
        await world.reconcile(after=5)
    assert world.api.calls.count("delete x-1-exec-1") == 1


async def test_the_trouble_of_an_executor_that_went_unseen_ends_no_job() -> None:
    world = World()
    await running(world)
    world.deliver(make_executor("x").waiting("stack", "ImagePullBackOff", "Back-off", "none:1"))
    await world.reconcile(after=2)
    assert world.reason("Running") == "False/StackImageUnavailable"
    vanish(world, "x-1-exec-1")
    world.deliver(make_executor("x", 2))  # in its place, and not begun with yet
    await world.reconcile(after=29)
    assert world.reason("Running") == "False/StackImageUnavailable"
    world.api.calls.clear()
    await world.reconcile(after=1)
    await world.reconcile(after=2)
    assert (world.status()["phase"], world.reason("Running")) == ("Running", "True/CasesRunning")
    assert world.api.calls == ["get pods", "patch status", "create events"]


async def test_no_executor_of_several_that_went_unseen_ends_the_job() -> None:
    world = World()
    await running(world)
    stuck = [make_executor("x", number).waiting("stack", "ErrImagePull") for number in (1, 2, 3)]
    world.deliver(*stuck)
    await world.reconcile(after=2)
    vanish(world, *[pod.name for pod in stuck])
    for _ in range(30):
        await world.reconcile(after=2)
    assert world.status()["phase"] == "Running"
    assert world.api.calls.count("get pods") == 3


async def test_a_trouble_that_was_mended_unseen_ends_no_job() -> None:
    world = World()
    await running(world)
    world.deliver(make_executor("x").waiting("stack", "ImagePullBackOff", "Back-off", "none:1"))
    await world.reconcile(after=2)
    world.api.put("pods", make_executor("x").running().object())
    await world.reconcile(after=30)
    await world.reconcile(after=2)
    assert (world.status()["phase"], world.reason("Running")) == ("Running", "True/CasesRunning")
