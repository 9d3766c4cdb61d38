"""A job that is deleted and that a finalizer keeps: it ends, and what it holds is given back."""

from typing import Any

import pytest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.sweep import Sweeper
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import WorkQueue
from tests.unit.operator.builders import account, make_driver, make_executor, make_job
from tests.unit.operator.kueue.fake_kueue import QueueWorld
from tests.unit.operator.kueue.test_queueing import queued, running
from tests.unit.operator.world import UID, World

DONE = account("Complete", verdict="Passed", cases={"planned": 4, "passed": 4})


def delete(world: World) -> None:
    """As the API server does where metadata.finalizers has an entry."""
    meta = world.api.objects["jobs", "x"]["metadata"]
    meta |= {
        "deletionTimestamp": "2026-11-20T04:00:00Z",
        "finalizers": ["example.com/mine"],
        "generation": meta["generation"] + 1,
        "resourceVersion": str(int(meta["resourceVersion"]) + 1),
    }
    world.deliver_job()


async def at_work() -> World:
    world = World()
    await world.reconcile()
    world.drivers.says = account()
    world.deliver(make_driver("x").running(), make_executor("x").running())
    await world.reconcile()
    assert world.status()["phase"] == "Running"
    return world


def gone(world: World, *names: str) -> None:
    for name in names:
        pod = next(p for p in world.view.pods(UID) if p.name == name)
        world.api.objects.pop(("pods", name), None)
        world.view.drop_pod(pod)


async def test_its_pods_are_stopped_and_then_its_end_is_written() -> None:
    world = await at_work()
    delete(world)
    world.drivers.says = None
    await world.reconcile()
    assert world.reason("Running") == "False/JobDeleted"
    assert "2 pods are being stopped" in world.message("Running")
    gone(world, "x-1-driver")
    await world.reconcile(after=2)
    gone(world, "x-1-exec-1")
    await world.reconcile(after=2)
    assert world.status()["phase"] == "Failed"
    assert world.reason("Failed") == world.reason("Passed").replace("False", "True")
    assert world.reason("Failed") == "True/JobDeleted"
    assert world.reason("Suspended") == "False/JobDeleted"
    assert "metadata.finalizers" in world.message("Failed")
    assert world.api.named("pods") == []
    calls = len(world.api.calls)
    await world.reconcile(after=3600)
    assert len(world.api.calls) == calls


async def test_its_driver_s_own_end_counts() -> None:
    world = await at_work()
    delete(world)
    world.deliver(make_driver("x").ended(0, DONE))
    await world.reconcile()
    await world.reconcile(after=2)
    assert (world.status()["phase"], world.status()["verdict"]) == ("Complete", "Passed")
    assert world.api.named("pods") == ["x-1-driver"]


@pytest.mark.parametrize("spec", [{}, {"suspend": True}])
async def test_one_that_has_no_pod_ends_at_once(spec: dict[str, Any]) -> None:
    job = make_job("x")
    job.object["spec"] |= spec
    world = World(job)
    if spec:
        await world.reconcile()
        assert world.status()["phase"] == "Suspended"
    delete(world)
    await world.reconcile()
    assert world.reason("Failed") == "True/JobDeleted"
    assert world.api.named("pods") == []


async def test_pods_that_wait_in_a_pool_do_not_outlast_it() -> None:
    ended = [{"type": "Complete", "status": "True", "reason": "AllCasesRan", "message": ""}]
    job = make_job("x").with_status(
        conditions=ended, pool={"name": "p", "state": "Cold"}, attempt=1, driver="x-1-driver"
    )
    job.object["status"]["conditions"][0]["lastTransitionTime"] = "2026-11-20T03:00:00Z"
    world = World(job)
    world.deliver(make_driver("x").running(), make_executor("x").running())
    delete(world)
    await world.reconcile()
    assert world.api.named("pods") == []


async def test_it_is_visited_until_it_has_ended_and_alarms_nobody(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One finalizer made BagpipeStatusStale and BagpipeJobsWait fire for good."""
    seconds = 1_000.0
    monkeypatch.setattr("bagpipe_operator.jobs.metrics.time.monotonic", lambda: seconds)
    view, queue = View(), WorkQueue()
    metrics = JobMetrics(view, queue)
    job = make_job("x").deleting()
    job.object["metadata"]["creationTimestamp"] = "2026-11-20T04:00:00Z"
    world = World(job)
    world.view = view
    world.deliver_job()
    world.reconciler = world.restarted(view)
    sweeper = Sweeper(view, queue, 2.0)
    visits = []
    for _ in range(4):
        visits.append(sweeper.sweep())
        while len(queue):
            key = await queue.get()
            await world.reconciler.reconcile(key)
            queue.done(key)
            metrics.reconciled(key)
        seconds += 12_000
    sample = metrics.registry.get_sample_value
    assert visits == [1, 0, 0, 0]
    assert sample("bagpipe_status_age_seconds") == 0
    assert sample("bagpipe_oldest_pending_job_seconds") == 0


def held(world: QueueWorld) -> dict[str, str]:
    return {c["type"]: c["status"] for c in world.workload()["status"]["conditions"]}


async def test_its_queue_has_its_quota_back() -> None:
    world = await running()
    delete(world)
    await world.reconcile()
    gone(world, *[pod.name for pod in world.view.pods(UID)])
    for _ in range(3):
        await world.reconcile(after=600)
    assert world.reason("Failed") == "True/JobDeleted"
    assert held(world)["Finished"] == "True"


async def test_one_that_waits_in_a_queue_leaves_it() -> None:
    world = await queued()
    delete(world)
    await world.reconcile()
    assert world.reason("Failed") == "True/JobDeleted"
    assert held(world)["Finished"] == "True"


async def test_a_removal_that_a_webhook_denies_as_a_conflict_is_tried_after_pauses() -> None:
    job = make_job("x").with_spec("ttlAfterFinished", "1m")
    world = World(job)
    await world.reconcile()
    world.deliver(make_driver("x").ended(0, DONE))
    await world.reconcile()
    denied = ApiError(409, "Conflict", 'admission webhook "a.example" denied the request: keep it')
    world.api.fail("delete job", denied)
    with pytest.raises(ApiError, match="keep it"):
        await world.reconcile(after=3600)
    await world.reconcile()
    assert world.api.named("jobs") == []


async def test_of_a_job_that_was_removed_nothing_is_kept() -> None:
    world = World(make_job("x").with_spec("ttlAfterFinished", "1m"))
    await world.reconcile()
    world.deliver(make_driver("x").ended(0, DONE))
    await world.reconcile()
    assert world.reconciler._recorder._met == {UID}
    await world.reconcile(after=3600)
    assert world.api.named("jobs") == []
    assert world.reconciler._recorder._met == set()


async def test_a_deadline_that_was_exceeded_before_stays_why_it_ended() -> None:
    """Its receivers are to know of it."""
    world = World(make_job("x").with_spec("activeDeadline", "10m"))
    await world.reconcile()
    world.drivers.says = account()
    world.deliver(make_driver("x").running(), make_executor("x").running())
    await world.reconcile()
    await world.reconcile(after=700)
    assert world.reason("Running") == "False/DeadlineExceeded"
    delete(world)
    for _ in range(3):
        await world.reconcile(after=2)
        gone(world, *[pod.name for pod in world.view.pods(UID)])
    assert world.reason("Failed") == "True/DeadlineExceeded"


async def test_it_counts_for_none_that_failed() -> None:
    """Else an alert fires where somebody clears jobs with `--cascade=foreground`."""
    world = await at_work()
    metrics = JobMetrics(world.view, WorkQueue())
    world.restart(counted=metrics.job_written)
    delete(world)
    gone(world, "x-1-driver", "x-1-exec-1")
    for _ in range(3):
        await world.reconcile(after=2)
    assert world.reason("Failed") == "True/JobDeleted"
    ended = {"phase": "Failed", "verdict": "None"}
    assert not metrics.registry.get_sample_value("bagpipe_jobs_ended_total", ended)


TOO_LARGE = ApiError(500, "InternalError", "etcdserver: request is too large")


@pytest.mark.parametrize("why", ["deleted", "deadline"])
async def test_a_job_that_no_status_fits_any_more_is_stopped_all_the_same(why: str) -> None:
    """Whoever may write it may fill metadata.finalizers up to etcd's limit: its pods stayed."""
    world = World(make_job("x").with_spec("activeDeadline", "10m"))
    await world.reconcile()
    world.drivers.says = account()
    world.deliver(make_driver("x").running(), make_executor("x").running())
    await world.reconcile()
    if why == "deleted":
        delete(world)
    else:
        world.clock.advance(700.0)
    for left in (["x-1-exec-1"], []):
        world.api.faults["patch status"] = [TOO_LARGE]
        with pytest.raises(ApiError, match="too large"):
            await world.reconcile(after=2)
        assert world.api.named("pods") == left
        gone(world, *[pod.name for pod in world.view.pods(UID) if pod.name not in left])


@pytest.mark.parametrize(
    ("status", "reason"), [(0, "Timeout"), (409, "Conflict"), (429, "TooManyRequests")]
)
async def test_while_its_status_is_only_late_its_pods_stay(status: int, reason: str) -> None:
    """The status states first why they go."""
    world = await at_work()
    delete(world)
    world.api.faults["patch status"] = [ApiError(status, reason, "later")]
    with pytest.raises(ApiError):
        await world.reconcile(after=60)
    assert world.api.named("pods") == ["x-1-driver", "x-1-exec-1"]


async def test_nobody_asks_why_the_pods_of_a_job_wait_that_are_to_go() -> None:
    """A visit took 60 s for that where there were a hundred Events about each claim."""
    world = World()
    await world.reconcile()
    driver = make_driver("x")
    driver.claims = ("c",)
    claim = {"metadata": {"name": "c", "uid": "uid-of-c"}, "status": {"phase": "Pending"}}
    world.api.put("persistentvolumeclaims", claim)
    world.deliver(driver)
    for _ in range(3):
        await world.reconcile(after=10)
    asked = world.api.calls.count("events of uid-of-c")
    assert (asked, world.status()["phase"]) == (3, "Pending")
    delete(world)
    await world.reconcile(after=10)
    assert world.api.calls.count("events of uid-of-c") == asked
    assert world.api.named("pods") == []
