"""Containers that somebody else puts beside the driver, and that do not end with it."""

from bagpipe_operator.api import names
from bagpipe_operator.jobs.sweep import Sweeper
from bagpipe_operator.runtime.queue import WorkQueue
from tests.unit.operator.builders import PodBuilder, account, make_driver
from tests.unit.operator.test_life import INTERRUPTED, edit, gone, running
from tests.unit.operator.world import World


def beside_a_proxy(code: int, message: str = "") -> PodBuilder:
    """A driver that ended at 04:00:02, and a service mesh's proxy that does not end."""
    ended = {"exitCode": code, "message": message, "finishedAt": "2026-11-20T04:00:02Z"}
    pod = make_driver("x").running().with_container("istio-proxy", {"running": {}})
    return pod.with_container(names.CONTAINER_DRIVER, {"terminated": ended})


async def test_a_sidecar_that_does_not_end_keeps_no_place_of_an_ended_job() -> None:
    world = World()
    await running(world)
    queue = WorkQueue(world.clock.monotonic)
    sweeper = Sweeper(world.view, queue, 2.0, now=world.clock.now)
    world.deliver(beside_a_proxy(0, account("Complete", verdict="Passed")))
    await world.reconcile()
    assert world.reason("Complete") == "True/JobComplete"
    # Executors go at once; a proxy that ends by itself leaves the driver's log to be read.
    assert world.api.named("pods") == ["x-1-driver"]
    world.clock.advance(29)
    assert sweeper.sweep() == 0
    world.clock.advance(1)
    assert sweeper.sweep() == 1
    await world.reconcile()
    assert world.api.named("pods") == []


async def test_a_driver_that_its_runtime_has_lost_keeps_no_place_beside_a_sidecar() -> None:
    """The kubelet reports its end, and not when that was."""
    world = World()
    await running(world)
    edit(world, suspend=True)
    lost = {"exitCode": 137, "reason": "ContainerStatusUnknown", "finishedAt": None}
    pod = beside_a_proxy(137).with_container(names.CONTAINER_DRIVER, {"terminated": lost})
    world.deliver(pod)
    gone(world, "x-1-exec-1")
    await world.reconcile(after=60)
    assert world.api.named("pods") == []
    gone(world, "x-1-driver")
    await world.reconcile(after=1)
    assert world.reason("Suspended") == "True/JobSuspended"


async def test_a_sidecar_that_does_not_end_does_not_hold_a_suspension_up() -> None:
    world = World()
    await running(world)
    edit(world, suspend=True)
    world.deliver(beside_a_proxy(143, INTERRUPTED))
    gone(world, "x-1-exec-1")
    await world.reconcile(after=20)
    assert world.reason("Suspended") == "False/Suspending"
    await world.reconcile(after=10)
    assert world.api.named("pods") == []
    gone(world, "x-1-driver")
    await world.reconcile(after=1)
    assert world.reason("Suspended") == "True/JobSuspended"
