"""A job of a queue, and what restarts, other replicas, strangers and lost words do to it."""

import pytest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.kueue.workload_view import WorkloadView
from tests.unit.operator.builders import account, make_driver, make_executor
from tests.unit.operator.kueue.fake_kueue import QueueWorld
from tests.unit.operator.kueue.test_queueing import queued, running
from tests.unit.operator.world import UID

REFUSED = ApiError(403, "Forbidden", "the webhook says no")


async def test_what_was_refused_before_another_led_stops_nothing() -> None:
    world = QueueWorld()
    world.api.fail("create workloads", REFUSED)
    await world.reconcile()
    first, view, workloads = world.reconciler, world.view, world.workloads
    world.forget_everything()
    await queued(world)
    world.flavor()
    await world.admit()
    await world.reconcile()
    pods = (make_driver("x").running(), make_executor("x").running())
    world.drivers.says = account()
    world.deliver(*pods)
    await world.reconcile()

    view.put_job(JobView.from_object(world.api.objects["jobs", "x"]))
    workloads.put(WorkloadView.from_object(world.workload()))
    for pod in pods:
        view.put_pod(pod.view())
    first.begin_to_lead()
    await first.reconcile(UID)

    assert world.reason("Running") == "True/CasesRunning"


async def test_who_suspends_a_refused_job_has_it_asked_for_again() -> None:
    world = QueueWorld()
    world.api.fail("create workloads", REFUSED)
    await world.reconcile()
    world.edit(suspend=True)
    await world.reconcile()
    world.edit(suspend=False)
    await world.reconcile()

    assert world.reason("Suspended") == "True/Queued"


async def test_the_workload_of_a_job_whose_deletion_was_not_reported_is_forgotten() -> None:
    world = await queued()
    seen = WorkloadView.from_object(world.workload())
    world.view.forget(UID)
    await world.reconcile()

    assert world.workloads.find(seen.namespace, seen.name) is None


LARGER = {"executors": 3, "executor": {"resources": {"cpu": "64"}}}


def reserved(world: QueueWorld) -> str:
    """The CPUs of an executor's Spark that the Workload asks for."""
    spark = world.workload()["spec"]["podSets"][1]["template"]["spec"]["containers"][0]
    return str(spark["resources"]["requests"]["cpu"])


async def test_a_job_that_grew_while_it_was_stopped_is_admitted_again() -> None:
    """It was resumed before its pods were gone, so it never left the queue."""
    world = await running()
    world.edit(suspend=True)
    await world.reconcile()
    world.edit(suspend=False, spark=LARGER)
    for pod in (make_driver("x"), make_executor("x")):
        world.view.drop_pod(pod.view())
        world.api.objects.pop(("pods", pod.name), None)
    await world.reconcile()
    await world.reconcile()
    with pytest.raises(ApiError, match="again"):
        await world.reconcile()
    await world.reconcile()

    assert world.api.named("pods") == []
    assert reserved(world) == "64"
    assert world.reason("Suspended") == "True/Queued"
    await world.admit()
    await world.reconcile()
    assert world.api.named("pods") == ["x-2-driver"]


async def test_a_job_that_was_edited_unseen_waits_with_its_new_size() -> None:
    world = await queued()
    await world.put_off()
    world.edit(activeDeadline="2h")
    await world.reconcile(after=31)
    assert "delete workload" not in world.api.calls
    assert reserved(world) == "500m"
    world.edit(spark=LARGER)
    await world.reconcile(after=31)
    await world.reconcile()

    assert reserved(world) == "64"


async def test_an_eviction_that_no_watch_reported_lets_no_driver_begin() -> None:
    world = await queued()
    world.flavor()
    await world.admit()
    world.api.report(world.name, {"Evicted": ("True", "Preempted", "for what matters more")})
    with pytest.raises(ApiError, match="409"):
        await world.reconcile()
    await world.reconcile()

    assert world.api.named("pods") == []
    assert world.condition("QuotaReserved") == "False/Pending"


@pytest.mark.parametrize("how", ["finished", "deleted"])
async def test_a_workload_that_goes_is_not_reported_to_wait_for_checks(how: str) -> None:
    world = await running()
    if how == "deleted":  # and a finalizer, such as that of --cascade=foreground, keeps it
        gone = world.workload()
        gone["metadata"]["deletionTimestamp"] = "2026-11-20T04:00:00Z"
        world.workloads.put(WorkloadView.from_object(gone))
    else:
        world._deliver({"Finished": ("True", "Succeeded", "or so somebody says")})
    await world.reconcile()

    assert world.message("Running") == (
        "The job waits in the queue nightly of Kueue again: its Workload was ended or deleted, "
        "another follows when it is gone. 2 pods are being stopped; what is done is kept."
    )


async def test_a_workload_that_was_deactivated_while_it_waited_says_so() -> None:
    """Kueue leaves its earlier condition about the quota."""
    world = await queued()
    await world.put_off()
    world._deliver({"Evicted": ("True", "Deactivated", "The workload is deactivated")})
    await world.reconcile()

    assert world.message("Suspended") == (
        "No pod holds a place. The job waits in the queue nightly of Kueue: The workload is "
        "deactivated."
    )


@pytest.mark.parametrize("tolerations", [5, {"key": "spot"}, ["spot"]])
async def test_tolerations_that_are_none_end_the_job_with_a_sentence(tolerations: object) -> None:
    world = await queued()
    world.flavor(tolerations=tolerations)
    await world.admit()
    await world.reconcile()

    assert world.reason("Failed") == "True/SpecInvalid"
    assert "its queue's flavors can't be used" in world.message("Failed")


async def test_a_flavor_that_can_t_be_read_is_reported_and_asked_for_again() -> None:
    world = await queued()
    await world.admit()
    await world.reconcile()
    assert world.message("Accepted") == (
        "ResourceFlavor default, which the job was admitted to, can't be read: "
        '"default" not found. The job starts as soon as it can.'
    )
    asked = world.api.calls.count("get flavors")
    await world.reconcile(after=2)
    assert world.api.calls.count("get flavors") == asked

    world.flavor()
    await world.reconcile(after=60)
    assert world.api.named("pods") == ["x-1-driver"]


async def test_a_job_that_waits_no_more_since_kueue_is_off_was_admitted_by_nobody() -> None:
    world = await queued()
    world.restart(queueing=None)
    await world.reconcile()
    await world.reconcile()

    assert world.reason("Suspended") == "False/JobResumed"
    assert world.api.named("pods") == ["x-1-driver"]


async def test_a_404_that_is_not_the_workload_s_own_keeps_no_place_for_good() -> None:
    """As of a proxy, or while its CRD is not served: what others wait for would never come."""
    world = await running()
    stray = ApiError(404, "", "404 page not found")
    world.api.fail("patch workload", stray)
    world.deliver(make_driver("x").ended(0, account("Complete", verdict="Passed")))
    with pytest.raises(ApiError, match="page not found"):
        await world.reconcile()
    await world.reconcile()
    assert world.condition("Finished") == "True/Succeeded"
