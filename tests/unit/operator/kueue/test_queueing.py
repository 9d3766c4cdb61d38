"""A job of a Kueue queue: no pods without admission, all of them with it, and the quota back."""

import copy

import pytest
import yaml

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.kueue.workload_view import WorkloadView
from tests.unit.operator.builders import account, make_driver, make_executor, make_job
from tests.unit.operator.kueue.fake_kueue import QueueWorld

DRIVER = "x-1-driver"


async def queued(world: QueueWorld | None = None) -> QueueWorld:
    """A job that has asked for its place."""
    world = world or QueueWorld()
    await world.reconcile()
    return world


async def running() -> QueueWorld:
    """A job that is admitted, with a driver and an executor at work."""
    world = await queued()
    world.flavor()
    await world.admit()
    await world.reconcile()
    world.drivers.says = account()
    world.deliver(make_driver("x").running(), make_executor("x").running())
    await world.reconcile()
    return world


# Promise: queued-has-no-pods
async def test_a_queued_job_has_a_workload_and_no_pods() -> None:
    world = await queued()

    assert world.api.named("pods") == []
    assert world.configs() == []
    assert world.reason("Suspended") == "True/Queued"
    assert world.status()["phase"] == "Suspended"
    assert world.message("Running") == (
        "The job waits in the queue nightly of Kueue, which has not looked at it yet."
    )


async def test_its_workload_asks_for_all_pods_at_once() -> None:
    spec = {"driver": {"resources": {"cpu": "500m", "memory": "1Gi"},
                       "pod": {"nodeSelector": {"disk": "fast"}}},
            "executor": {"resources": {"cpu": 2, "memory": "3Gi"}}}  # fmt: skip
    job = make_job("x").with_spec("spark", spec)
    job.with_spec("stack.resources", {"requests": {"cpu": "4", "memory": "2Gi"}})
    world = await queued(QueueWorld(job))

    [driver, executors] = world.workload()["spec"]["podSets"]
    assert (driver["name"], driver["count"]) == ("driver", 1)
    assert (executors["name"], executors["count"]) == ("executors", 3)
    nodes = {"kubernetes.io/arch": "amd64", "disk": "fast"}
    assert driver["template"]["spec"]["nodeSelector"] == nodes
    [main] = driver["template"]["spec"]["containers"]
    assert main["resources"]["requests"] == {"cpu": "500m", "memory": "1Gi"}
    [spark] = executors["template"]["spec"]["containers"]
    assert spark["resources"]["requests"] == {"cpu": "2", "memory": "3Gi"}
    [agent, stack] = executors["template"]["spec"]["initContainers"]
    # A native sidecar, whose share counts beside Spark's.
    assert (stack["restartPolicy"], stack["resources"]["requests"]["cpu"]) == ("Always", "4")
    assert agent["resources"]["requests"] == {"cpu": "10m", "memory": "32Mi"}
    assert set(stack) == {"name", "resources", "restartPolicy"}
    assert world.workload()["spec"]["queueName"] == "nightly"
    [owner] = world.workload()["metadata"]["ownerReferences"]
    assert (owner["uid"], owner["controller"]) == ("uid-of-x", True)


async def test_limits_are_what_is_asked_for_where_requests_are_not_set() -> None:
    """A LimitRange's default requests would count else, and the pods would take more."""
    resources = {"requests": {"cpu": "1"}, "limits": {"cpu": "2", "memory": "4Gi"}}
    world = await queued(QueueWorld(make_job("x").with_spec("stack.resources", resources)))

    [_, executors] = world.workload()["spec"]["podSets"]
    stack = executors["template"]["spec"]["initContainers"][1]
    assert stack["resources"]["requests"] == {"cpu": "1", "memory": "4Gi"}


async def test_what_kueue_has_given_up_says_what_to_do() -> None:
    world = await queued()
    await world.admit()
    await world.evict("DeactivatedDueToRequeuingLimitExceeded", "exceeded its requeuing limit")
    await world.reconcile()

    assert world.message("Suspended") == (
        "No pod holds a place. The job waits in the queue nightly of Kueue, which has given it up: "
        "exceeded its requeuing limit. Delete its Workload to queue it again."
    )


async def test_what_kueue_says_is_what_the_job_says() -> None:
    world = await queued()

    await world.put_off("couldn't assign flavors to pod set executors: insufficient quota.")

    assert world.message("Suspended") == (
        "No pod holds a place. The job waits in the queue nightly of Kueue: couldn't assign "
        "flavors to pod set executors: insufficient quota."
    )
    assert world.api.named("pods") == []


async def test_an_admitted_job_starts_where_its_flavors_are() -> None:
    world = await queued()
    toleration = {"key": "spot", "operator": "Exists", "effect": "NoSchedule"}
    world.flavor(nodeLabels={"pool": "spot"}, tolerations=[toleration])

    await world.admit()
    assert world.reason("Suspended") == "False/Admitted"
    await world.reconcile()

    driver = world.api.objects["pods", DRIVER]
    template = yaml.safe_load(world.config("x-1")["data"]["executor.yaml"])
    for pod in (driver, template):
        assert pod["spec"]["nodeSelector"] == {"kubernetes.io/arch": "amd64", "pool": "spot"}
        assert toleration in pod["spec"]["tolerations"]
        # Kueue's integration for plain pods would hold it back once more.
        assert "kueue.x-k8s.io/queue-name" not in pod["metadata"]["labels"]


async def test_what_an_admission_check_adds_is_on_the_pods_of_its_set() -> None:
    world = await queued()
    world.flavor()
    annotations = {"autoscaling.x-k8s.io/consume-provisioning-request": "x"}
    update = {
        "name": "executors",
        "nodeSelector": {"zone": "b"},
        "annotations": annotations,
        "labels": {"reserved": "yes"},
    }
    checks = [{"name": "capacity", "state": "Ready", "podSetUpdates": [update]}]
    world.api.report(world.name, {}, admissionChecks=checks)
    await world.admit()
    await world.reconcile()

    template = yaml.safe_load(world.config("x-1")["data"]["executor.yaml"])
    assert template["spec"]["nodeSelector"] == {"kubernetes.io/arch": "amd64", "zone": "b"}
    assert template["metadata"]["labels"]["reserved"] == "yes"
    assert template["metadata"]["annotations"].items() >= annotations.items()
    driver = world.api.objects["pods", DRIVER]
    assert driver["spec"]["nodeSelector"] == {"kubernetes.io/arch": "amd64"}


async def test_quota_without_the_checks_is_no_admission() -> None:
    world = await queued()
    world._deliver({"QuotaReserved": ("True", "QuotaReserved", "")})
    await world.reconcile()

    assert world.api.named("pods") == []
    assert world.message("Running") == (
        "The job waits in the queue nightly of Kueue: it has its quota, and the queue's admission "
        "checks are not done."
    )


async def test_kueue_is_informed_once_that_the_pods_are_ready() -> None:
    world = await running()
    await world.reconcile()
    await world.reconcile()

    assert world.condition("PodsReady") == "True/Started"
    assert world.condition("Admitted") == "True/Admitted"
    assert world.api.calls.count("patch workload") == 1


# Promise: quota-goes-back
async def test_an_evicted_job_gives_its_quota_back_when_its_pods_are_gone() -> None:
    world = await running()

    await world.evict()
    assert world.condition("QuotaReserved") == "True/QuotaReserved"
    assert world.reason("Suspended") == "False/Suspending"
    assert DRIVER not in world.api.named("pods")
    # The driver's deletion is on its way; its executor lives.
    world.view.drop_pod(make_driver("x").view())
    await world.reconcile()
    assert world.condition("QuotaReserved") == "True/QuotaReserved"
    world.view.drop_pod(make_executor("x").view())
    await world.reconcile()

    assert world.reason("Suspended").startswith("True/")
    assert world.condition("QuotaReserved") == "False/Pending"
    assert world.condition("Admitted") == "False/NoReservation"
    assert world.condition("Requeued") == "True/Preempted"
    assert world.condition("PodsReady") == "False/WaitForStart"
    assert "admission" not in world.workload()["status"]


async def test_a_job_goes_on_with_another_driver_when_it_is_admitted_again() -> None:
    world = await running()
    await world.evict()
    for pod in (make_driver("x"), make_executor("x")):
        world.view.drop_pod(pod.view())
        world.api.objects.pop(("pods", pod.name), None)
    await world.reconcile()
    await world.reconcile()
    assert world.reason("Suspended") == "True/Queued"

    await world.admit()
    await world.reconcile()

    assert world.api.named("pods") == ["x-2-driver"]
    assert world.status()["lostDrivers"] == 0
    assert world.reason("Suspended") == "False/Admitted"


@pytest.mark.parametrize("reason", ["Deactivated", "PodsReadyTimeout", "ClusterQueueStopped"])
async def test_other_evictions_are_kueue_s_to_requeue(reason: str) -> None:
    world = await queued()
    await world.admit()
    await world.evict(reason)

    assert world.condition("Requeued") == f"False/{reason}"


async def test_a_preempted_job_that_has_no_pods_yet_gets_none() -> None:
    world = await queued()
    world.flavor()
    await world.admit()
    await world.evict()

    assert world.api.named("pods") == []
    assert world.condition("QuotaReserved") == "False/Pending"


async def test_the_workload_of_an_ended_job_is_finished() -> None:
    world = await running()
    text = account("Complete", verdict="Passed", cases={"planned": 4, "passed": 4})
    world.deliver(make_driver("x").ended(0, text))
    await world.reconcile()

    assert world.status()["phase"] == "Complete"
    assert world.condition("Finished") == "True/Succeeded"
    reported = world.api.calls.count("patch workload")
    await world.reconcile()
    assert world.api.calls.count("patch workload") == reported


async def test_a_place_is_kept_while_the_pods_that_fill_it_can_not_be_deleted() -> None:
    world = await running()
    world.api.fail("delete x-1-exec-1", ApiError(500, "InternalError", "no webhook"))
    world.deliver(make_driver("x").ended(0, account("Complete", verdict="Passed")))
    with pytest.raises(ApiError, match="no webhook"):
        await world.reconcile()
    assert world.status()["phase"] == "Complete"
    assert "Finished" not in [each["type"] for each in world.workload()["status"]["conditions"]]
    await world.reconcile()
    assert world.condition("Finished") == "True/Succeeded"


async def test_that_of_a_failed_job_is_finished_too() -> None:
    world = await running()
    world.deliver(make_driver("x").ended(1, account("Failed", reason="BagUnreadable")))
    await world.reconcile()

    assert world.status()["phase"] == "Failed"
    assert world.condition("Finished") == "True/Failed"


async def test_who_suspends_a_queued_job_leaves_the_queue() -> None:
    world = await queued()
    world.edit(suspend=True)
    await world.reconcile()

    assert world.api.named("workloads") == []
    assert world.reason("Suspended") == "True/JobSuspended"


async def test_one_that_is_resumed_queues_again() -> None:
    world = await running()
    world.edit(suspend=True)
    await world.reconcile()
    assert world.api.named("workloads") != []  # its pods hold what was reserved for them
    for pod in (make_driver("x"), make_executor("x")):
        world.view.drop_pod(pod.view())
    await world.reconcile()
    assert world.api.named("workloads") == []

    world.edit(suspend=False)
    await world.reconcile()
    assert len(world.api.named("workloads")) == 1
    assert DRIVER not in world.api.named("pods")


async def test_a_job_whose_workload_somebody_deletes_is_stopped_and_queued_again() -> None:
    world = await running()
    seen = WorkloadView.from_object(world.workload())
    del world.api.objects["workloads", world.name]
    world.workloads.drop(seen)
    await world.reconcile()

    assert world.reason("Suspended") == "False/Suspending"
    assert "admission" not in (world.workload().get("status") or {})


async def test_a_workload_that_somebody_finishes_is_replaced() -> None:
    world = await queued()
    await world.admit()
    first = world.workload()["spec"]
    world._deliver({"Finished": ("True", "Succeeded", "or so somebody says")})
    await world.reconcile()
    assert world.api.named("workloads") == []
    assert world.api.named("pods") == []
    await world.reconcile()

    assert world.workload()["spec"] == first
    assert "status" not in world.workload()


async def test_a_deletion_that_no_watch_reported_is_found() -> None:
    world = await running()
    del world.api.objects["workloads", world.name]
    await world.reconcile()
    assert world.api.named("workloads") == []
    await world.reconcile(after=31)
    assert len(world.api.named("workloads")) == 1


async def test_a_restarted_operator_asks_before_it_stops_anything() -> None:
    world = await running()
    world.forget_everything()
    world.deliver(make_driver("x").running(), make_executor("x").running())
    await world.reconcile()

    assert world.reason("Running") == "True/CasesRunning"
    assert DRIVER in world.api.named("pods")


async def test_a_queued_job_asks_no_more_than_it_must() -> None:
    world = await queued()
    await world.put_off()
    before = len(world.api.calls)
    for _ in range(10):
        await world.reconcile(after=2)

    assert world.api.calls[before:] == []


async def test_a_workload_of_somebody_else_admits_nobody() -> None:
    world = await queued()
    forged = copy.deepcopy(world.workload())
    forged["metadata"]["ownerReferences"][0]["uid"] = "uid-of-y"
    forged["metadata"]["resourceVersion"] = "5000"
    forged["status"] = {
        "conditions": [{"type": "Admitted", "status": "True", "reason": "", "message": ""}]
    }
    world.api.put("workloads", forged)
    world.workloads.put(WorkloadView.from_object(forged))
    await world.reconcile()

    assert world.api.named("pods") == []
    assert world.reason("Suspended") == "True/QueueRefused"
    assert (
        world.message("Running")
        == f"Workload {world.name} exists and is not of this job: delete it."
    )


async def test_a_workload_that_is_refused_is_reported_and_asked_for_again() -> None:
    world = QueueWorld()
    world.api.fail("create workloads", ApiError(403, "Forbidden", "the webhook says no"))
    await world.reconcile()
    assert world.reason("Accepted") == "False/QueueRefused"
    assert world.message("Accepted") == "Its Workload can't be created: the webhook says no"
    await world.reconcile(after=2)
    assert world.api.calls.count("create workloads") == 1
    await world.reconcile(after=30)

    assert world.reason("Suspended") == "True/Queued"


async def test_an_unusable_spec_ends_the_job_at_once() -> None:
    world = QueueWorld(make_job("x").with_spec("stack.parameters", {"gain": 1}))
    await world.reconcile()

    assert world.reason("Failed") == "True/SpecInvalid"
    assert world.api.named("workloads") == []


@pytest.mark.parametrize(
    ("labels", "spark", "group", "kind"),
    [
        ({"kueue.x-k8s.io/priority-class": "high"}, {}, "kueue.x-k8s.io", "WorkloadPriorityClass"),
        ({}, {"driver": {"pod": {"priorityClassName": "high"}}}, "scheduling.k8s.io",
         "PriorityClass"),
    ],
)  # fmt: skip
async def test_priorities(
    labels: dict[str, str], spark: dict[str, object], group: str, kind: str
) -> None:
    job = make_job("x").with_spec("spark", spark)
    job.object["metadata"]["labels"] = labels
    world = QueueWorld(job)
    world.api.put(f"priorities of {group}", {"metadata": {"name": "high"}, "value": 700})
    await world.reconcile()

    spec = world.workload()["spec"]
    assert spec["priority"] == 700
    assert spec["priorityClassRef"] == {"group": group, "kind": kind, "name": "high"}


async def test_a_conflict_is_read_again_and_reported_again() -> None:
    world = await running()
    world.api.report(world.name, {"Other": ("True", "Other", "somebody wrote in between")})
    text = account("Complete", verdict="Passed", cases={"planned": 4, "passed": 4})
    world.deliver(make_driver("x").ended(0, text))
    with pytest.raises(ApiError, match="409"):
        await world.reconcile()
    await world.reconcile()

    assert world.condition("Finished") == "True/Succeeded"
    assert world.condition("Other") == "True/Other"


async def test_an_answer_that_is_lost_harms_nothing() -> None:
    world = await running()
    world.api.lost.add("patch workload")
    text = account("Complete", verdict="Passed", cases={"planned": 4, "passed": 4})
    world.deliver(make_driver("x").ended(0, text))
    with pytest.raises(ApiError, match="lost"):
        await world.reconcile()
    with pytest.raises(ApiError, match="409"):
        await world.reconcile()
    await world.reconcile()

    assert world.condition("Finished") == "True/Succeeded"


async def test_without_the_setting_a_queue_is_a_label() -> None:
    world = await queued()
    world.restart(queueing=None)
    world.clock.advance(60)
    await world.reconcile()
    await world.reconcile()

    labels = world.api.objects["pods", DRIVER]["metadata"]["labels"]
    assert labels["kueue.x-k8s.io/queue-name"] == "nightly"
