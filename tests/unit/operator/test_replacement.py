"""A driver that is lost is replaced by another; one that failed by its own account is not."""

import asyncio
from itertools import pairwise

import pytest
from aiohttp import web

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.policies.replacement import pause_seconds
from tests.unit.operator.builders import PodBuilder, account, make_driver, make_executor, make_job
from tests.unit.operator.test_progress import driver
from tests.unit.operator.test_unseen import vanish
from tests.unit.operator.world import UID, World


async def started(world: World) -> None:
    await world.reconcile()
    world.deliver(make_driver("x").running(), make_executor("x").running())
    world.drivers.says = account()
    await world.reconcile(after=2)


LOST = {
    "DriverFailed": make_driver("x").ended(137),
    "DriverOutOfMemory": make_driver("x").ended(137, reason="OOMKilled"),
    "DriverEvicted": make_driver("x").ended(137).evicted("The node was low on memory."),
    "DriverLost": make_driver("x").ended(143).deleting(),
}


@pytest.mark.parametrize("reason", sorted(LOST))
async def test_a_lost_driver_is_replaced(reason: str) -> None:
    world = World()
    await started(world)
    world.deliver(LOST[reason])
    await world.reconcile(after=2)
    status = world.status()
    assert (status["phase"], status["attempt"], status["driver"]) == ("Pending", 2, "")
    assert status["cases"]["passed"] == 1  # what was done stays in the status
    assert world.reason("Running") == f"False/{reason}"
    assert "Driver 2 of at most 4 takes over in 10 s" in world.message("Running")
    assert world.reason("Failed") == "False/InProgress"
    await world.reconcile(after=9)
    assert world.reason("Running") == f"False/{reason}"
    assert world.configs() == ["x-1"]
    await world.reconcile(after=1)
    assert world.status()["driver"] == "x-2-driver"
    assert "x-2" in world.configs()
    assert world.api.event_reasons().count(reason) == 1


async def test_the_next_driver_is_not_given_the_message_of_the_one_before() -> None:
    """The first serves its progress; the second runs, and its server is not up yet."""

    async def handler(_: web.Request) -> web.Response:
        return web.Response(text=account())

    world = World()
    await world.reconcile()
    async with driver(handler) as reader:
        world.restart(drivers=reader)
        world.deliver(make_driver("x").running("127.0.0.1"), make_executor("x").running())
        await world.reconcile(after=2)
        assert world.reason("Running") == "True/CasesRunning"
        world.deliver(make_driver("x").ended(137))
        await world.reconcile(after=2)
        await world.reconcile(after=10)
        world.deliver(make_driver("x", 2).running("127.0.0.2"))  # where nobody listens
        await world.reconcile(after=2)
        assert (world.status()["phase"], world.status()["attempt"]) == ("Planning", 2)
        assert world.reason("Running") == "False/DriverFailed"
        assert world.api.event_reasons().count("CasesRunning") == 1
        assert list(reader._answers) == ["uid-of-x-2-driver"]  # the first's are not kept for ever
        world.deliver(make_driver("x", 2).ended(0, account("Complete")))
        await world.reconcile(after=2)
        assert reader._answers == {}


async def test_a_driver_that_reported_why_it_failed_is_not_replaced() -> None:
    world = World()
    await started(world)
    failed = account("Failed", reason="BagUnreadable", message="drive.bag ends at byte 17.")
    world.deliver(make_driver("x").ended(1, failed))
    await world.reconcile(after=2)
    assert world.reason("Failed") == "True/BagUnreadable"
    assert world.status()["attempt"] == 1


async def test_the_limit_ends_the_job_with_the_last_reason() -> None:
    world = World(make_job("x").with_spec("backoffLimit", 2))
    for attempt in (1, 2, 3):
        await world.reconcile(after=20)
        world.deliver(make_driver("x", attempt).running())
        await world.reconcile(after=2)
        world.deliver(make_driver("x", attempt).ended(137, reason="OOMKilled"))
        await world.reconcile(after=2)
    assert world.reason("Failed") == "True/DriverOutOfMemory"
    assert world.message("Failed").endswith("memory and create the job again.")
    assert [name for name in world.api.named("pods") if name.endswith("driver")] == [
        "x-1-driver", "x-2-driver", "x-3-driver",
    ]  # fmt: skip


async def test_the_executors_of_a_replaced_driver_give_up_their_places() -> None:
    world = World()
    await started(world)
    world.deliver(make_driver("x").ended(137))
    await world.reconcile(after=2)
    await world.reconcile(after=10)
    assert "x-1-exec-1" not in world.api.named("pods")
    assert "x-2-driver" in world.api.named("pods")


async def replaced(world: World) -> None:
    """The second driver runs, and an executor of the first one has not gone yet."""
    await started(world)
    world.deliver(make_driver("x").ended(137))
    await world.reconcile(after=2)
    await world.reconcile(after=10)
    world.deliver(make_driver("x", 2).running())
    await world.reconcile(after=2)
    world.deliver(make_executor("x").running())


async def test_a_job_ends_although_an_executor_of_an_earlier_driver_can_not_be_deleted() -> None:
    world, refusal = World(), ApiError(500, "InternalError", "a webhook hangs")
    await replaced(world)
    world.api.fail("delete x-1-exec-1", *[refusal] * 2)
    world.deliver(make_driver("x", 2).ended(0, account("Complete", verdict="Passed")))
    for _ in range(2):  # it is tried again, and nobody forgets it
        with pytest.raises(ApiError, match="a webhook hangs"):
            await world.reconcile(after=2)
        assert world.status()["phase"] == "Complete"
    await world.reconcile(after=2)
    assert "x-1-exec-1" not in world.api.named("pods")


async def test_an_operator_that_ends_goes_on_with_no_visit() -> None:
    """A worker that is cancelled in a call must end, and not go on with the rest of its visit."""
    world = World()
    await replaced(world)
    world.deliver(make_driver("x", 2).ended(0, account("Complete", verdict="Passed")))
    world.api.fail("delete x-1-exec-1", asyncio.CancelledError())
    world.api.calls.clear()
    with pytest.raises(asyncio.CancelledError):
        await world.reconcile(after=2)
    assert world.api.calls == ["delete x-1-exec-1"]


@pytest.mark.parametrize("fault", ["fail", "lose"])
async def test_no_two_drivers_live_where_a_status_can_not_be_written(fault: str) -> None:
    """The first one's pod goes on beside a proxy, and holds its place."""
    world = World()
    await started(world)
    ended = {"exitCode": 137, "finishedAt": world.clock.now().isoformat()}
    beside = make_driver("x").running().with_container("proxy", {"running": {}})
    world.deliver(beside.with_container("driver", {"terminated": ended}))
    await world.reconcile(after=2)
    if fault == "fail":
        world.api.fail("patch status", ApiError(500, "InternalError", "no leader"))
    else:
        world.api.lost.add("patch status")
    with pytest.raises(ApiError):
        await world.reconcile(after=10)
    assert [n for n in world.api.named("pods") if "driver" in n] == ["x-2-driver"]


async def test_a_running_job_counts_although_such_an_executor_can_not_be_deleted() -> None:
    world = World()
    await replaced(world)
    world.api.fail("delete x-1-exec-1", ApiError(500, "InternalError", "a webhook hangs"))
    world.drivers.says = account(cases={"planned": 4, "running": 1, "passed": 3})
    with pytest.raises(ApiError, match="a webhook hangs"):
        await world.reconcile(after=2)
    assert world.status()["cases"]["passed"] == 3
    await world.reconcile(after=2)
    assert "x-1-exec-1" not in world.api.named("pods")


@pytest.mark.parametrize(("after", "attempt"), [(10, 1), (20, 2)])
async def test_a_driver_on_a_node_that_is_cut_off_is_replaced(after: float, attempt: int) -> None:
    world = World()
    await started(world)  # two seconds have passed
    pod: PodBuilder = make_driver("x").running()
    world.deliver(pod.deleting(gone_by="2026-11-20T04:00:02Z"))
    await world.reconcile(after=after)
    assert world.status()["attempt"] == attempt


async def test_an_operator_that_restarts_between_two_drivers_creates_one() -> None:
    world = World()
    await started(world)
    world.deliver(make_driver("x").ended(137))
    await world.reconcile(after=2)
    world.reconciler = world.restarted(world.view)
    await world.reconcile(after=9)
    assert world.view.driver(UID, 2) is None
    await world.reconcile(after=1)
    await world.reconcile(after=2)
    assert world.view.driver(UID, 2) is not None
    assert world.api.named("pods").count("x-2-driver") == 1
    assert world.status()["attempt"] == 2


async def test_a_trouble_of_the_driver_that_may_pass_is_reported() -> None:
    world = World()
    await started(world)
    world.drivers.says = account(warning="the results can't be kept: No space left on device")
    await world.reconcile(after=2)
    assert world.reason("Running") == "True/CasesRunning"
    assert world.message("Running") == (
        "Cases are running. the results can't be kept: No space left on device"
    )


async def test_the_pause_doubles_up_to_five_minutes() -> None:
    assert [pause_seconds(lost) for lost in range(1, 8)] == [10, 20, 40, 80, 160, 300, 300]
    world = World(make_job("x").with_spec("backoffLimit", 20))
    begun: list[float] = []
    for attempt in range(1, 8):
        while f"x-{attempt}-driver" not in world.api.named("pods"):
            await world.reconcile(after=1)
        begun.append(world.clock.seconds)
        world.deliver(make_driver("x", attempt).ended(137))
        await world.reconcile()
    assert [later - sooner for sooner, later in pairwise(begun)] == [10, 20, 40, 80, 160, 300]
    assert world.status()["lostDrivers"] == 7


async def test_a_status_of_an_earlier_release_counts_its_attempts_as_lost_drivers() -> None:
    world = World(make_job("x").with_status(attempt=4, driver="x-4-driver", phase="Running"))
    world.deliver(make_driver("x", 4).ended(137))
    await world.reconcile()
    assert world.reason("Failed") == "True/DriverFailed"
    assert world.status()["lostDrivers"] == 3


async def test_a_drained_node_costs_no_attempt_and_ends_no_job() -> None:
    """Four nodes in a row are drained, where three drivers more than the first are allowed."""
    world = World()
    await started(world)
    pauses = (10, 20, 40, 80, 160)
    for attempt, pause in enumerate(pauses, start=1):
        drained = make_driver("x", attempt).ended(143)
        world.deliver(
            drained.disrupted("EvictionByEvictionAPI", "Eviction API: evicting").deleting()
        )
        await world.reconcile(after=2)
        assert world.reason("Running") == "False/DriverEvicted"
        counted = f"which does not count against spec.backoffLimit, in {pause} s"
        assert counted in world.message("Running")
        assert world.status()["lostDrivers"] == 0
        await world.reconcile(after=pause)
        assert world.status()["driver"] == f"x-{attempt + 1}-driver"
        world.deliver(make_driver("x", attempt + 1).running())
        await world.reconcile(after=2)
    assert world.reason("Failed") == "False/InProgress"


async def test_a_clock_that_is_set_back_holds_no_driver_up() -> None:
    world = World()
    await started(world)
    world.clock.advance(86_400)
    world.deliver(make_driver("x").ended(137))
    await world.reconcile()
    assert world.status()["nextAttemptTime"] == "2026-11-21T04:00:12Z"
    world.clock.advance(-86_400)
    for _ in range(3):
        await world.reconcile(after=100)
    assert world.status()["driver"] == "x-2-driver"


async def test_a_copy_of_the_driver_s_pod_is_not_taken_for_it() -> None:
    """Somebody looks for a fault in it: same labels, same ConfigMap, and a name of its own."""
    world = World()
    await started(world)
    copy = make_driver("x").running()
    copy.name = "debug-x"
    world.deliver(copy)
    await world.reconcile(after=2)
    assert world.status()["driver"] == "x-1-driver"
    world.deliver(copy.ended(1))
    await world.reconcile(after=2)
    assert (world.status()["attempt"], world.reason("Running")) == (1, "True/CasesRunning")
    assert "x-1-driver" in world.api.named("pods")


async def test_a_copy_of_the_driver_s_pod_that_does_not_start_ends_no_job() -> None:
    world = World()
    await started(world)
    copy = make_driver("x").with_container("driver", {"waiting": {"reason": "ErrImagePull"}})
    copy.name = "debug-x"
    world.deliver(copy)
    for _ in range(4):
        await world.reconcile(after=world.settings.stuck_seconds)
    assert (world.reason("Running"), world.reason("Failed")) == (
        "True/CasesRunning",
        "False/InProgress",
    )


def evicted_driver() -> PodBuilder:
    """A driver that is being evicted, and has its grace period."""
    pod = make_driver("x").running().disrupted("EvictionByEvictionAPI", "Eviction API: evicting")
    return pod.deleting(gone_by="2026-11-20T04:00:30Z")


async def test_an_eviction_whose_end_no_watch_has_reported_costs_no_attempt() -> None:
    world = World()
    await started(world)
    world.deliver(evicted_driver())
    await world.reconcile(after=2)
    vanish(world, "x-1-driver")
    world.drivers.silent = 30.0
    await world.reconcile(after=30)
    assert world.reason("Running") == "False/DriverEvicted"
    assert (world.status()["attempt"], world.status()["lostDrivers"]) == (2, 0)


async def test_a_driver_that_has_completed_and_went_unseen_has_completed() -> None:
    """Its end was seen, and could not be written before its pod went."""
    world = World()
    await started(world)
    done = make_driver("x").running()
    ended = {"exitCode": 0, "message": account("Complete")}
    world.view.put_pod(done.with_container("driver", {"terminated": ended}).view())
    vanish(world, "x-1-driver")
    world.drivers.silent = 30.0
    await world.reconcile(after=30)
    assert world.reason("Complete") == "True/JobComplete"


async def test_a_drained_node_that_does_not_answer_costs_no_attempt() -> None:
    """It was drained to be switched off, and its kubelet reported no more."""
    world = World()
    await started(world)
    world.deliver(evicted_driver())
    await world.reconcile(after=60)
    assert world.reason("Running") == "False/DriverEvicted"
    assert (world.status()["attempt"], world.status()["lostDrivers"]) == (2, 0)


def test_a_pause_is_a_number_however_many_attempts_there_were() -> None:
    assert [pause_seconds(lost) for lost in (1, 2, 6, 1025, 10**6)] == [10, 20, 300, 300, 300]
