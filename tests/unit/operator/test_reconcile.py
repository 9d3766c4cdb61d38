"""The loop against a fake API server (tests/unit/operator/fakes.py): its writes, and its faults."""

import json

import pytest
import yaml

from bagpipe_operator.api import names
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.view import View
from tests.unit.operator.builders import account, make_driver, make_executor, make_job
from tests.unit.operator.world import UID, World


async def test_a_new_job_gets_its_children_one_status_and_one_event() -> None:
    world = World()
    await world.reconcile()
    assert world.api.calls == [
        "try pods",
        "create configmaps",
        "create pods",
        "patch status",
        "create events",
    ]
    assert world.api.named("pods") == ["x-1-driver"]
    assert world.configs() == ["x-1"]
    assert (world.status()["phase"], world.status()["driver"]) == ("Pending", "x-1-driver")
    assert world.api.event_reasons() == ["DriverCreated"]


async def test_nothing_new_costs_no_call() -> None:
    world = World()
    await world.reconcile()
    world.deliver(make_driver("x").running())
    await world.reconcile()
    world.api.calls.clear()
    for _ in range(5):
        await world.reconcile(after=1)
    assert world.api.calls == []


async def test_a_whole_life_reports_each_transition_once() -> None:
    world = World()
    await world.reconcile()
    world.deliver(make_driver("x").running(), make_executor("x").running())
    world.drivers.says = account("Planning")
    await world.reconcile(after=2)
    for passed in range(4):
        world.drivers.says = account(cases={"planned": 4, "running": 1, "passed": passed})
        await world.reconcile(after=2)
    done = account("Complete", reason="AllCasesPassed", message="4 of 4 cases passed.")
    world.deliver(make_driver("x").ended(0, done))
    await world.reconcile(after=2)
    for _ in range(3):
        await world.reconcile(after=2)
    assert world.api.event_reasons() == [
        "DriverCreated",
        "CasesPlanned",
        "CasesRunning",
        "AllCasesPassed",
    ]
    assert world.reason("Complete") == "True/AllCasesPassed"
    assert world.api.calls.count("patch status") == 7
    assert world.drivers.forgotten == ["uid-of-x-1-driver"]


async def test_what_the_driver_gets() -> None:
    world = World(make_job("x").with_spec("spark.driver.resources", {"cpu": 1, "memory": "2Gi"}))
    await world.reconcile()
    data = world.config("x-1")["data"]
    job = json.loads(data["job.json"])
    assert {key: job[key] for key in ("name", "namespace", "uid", "attempt")} == {
        "name": "x",
        "namespace": "lanes",
        "uid": UID,
        "attempt": 1,
    }
    assert job["spec"]["spark"]["driver"]["resources"] == {"cpu": "1", "memory": "2Gi"}
    assert job["volumes"] == {
        "recordings": "/bagpipe/volumes/recordings",
        "results": "/bagpipe/volumes/results",
    }
    assert yaml.safe_load(data["executor.yaml"])["kind"] == "Pod"


async def test_children_of_a_former_run_are_taken_over() -> None:
    """Killed between creating the driver and writing the status: nothing is created twice."""
    world = World()
    world.api.fail("patch status", ApiError(0, "Unreachable", "killed"))
    with pytest.raises(ApiError, match="killed"):
        await world.reconcile()
    fresh = View()
    fresh.put_job(JobView.from_object(world.api.objects["jobs", "x"]))
    await world.restarted(fresh).reconcile(UID)
    assert world.api.named("pods") == ["x-1-driver"]
    assert world.status()["driver"] == "x-1-driver"
    assert world.api.event_reasons() == ["DriverCreated"]


@pytest.mark.parametrize("resource", ["configmaps", "pods"])
async def test_a_name_that_is_another_s(resource: str) -> None:
    before = World()
    await before.reconcile()
    config = before.config("x-1")["metadata"]["name"]
    world = World()
    name = config if resource == "configmaps" else "x-1-driver"
    world.api.put(resource, {"metadata": {"name": name, "namespace": "lanes", "uid": "other"}})
    await world.reconcile()
    kind = "ConfigMap" if resource == "configmaps" else "Pod"
    assert world.reason("Accepted") == "False/NameTaken"
    assert world.message("Accepted") == (
        f"{kind} {name} exists in namespace lanes and does not belong to this job. Delete it, or "
        "give the job another name."
    )
    del world.api.objects[resource, name]
    await world.reconcile(after=5)
    assert world.reason("Accepted") == "True/DriverCreated"


@pytest.mark.parametrize("deleting", [True, False])
async def test_a_job_that_is_made_again_waits_for_the_pods_of_the_one_before(
    deleting: bool,
) -> None:
    """They have their grace period, and the garbage collector has its time."""
    world = World()
    pod = make_driver("x").running()
    earlier = (pod.deleting() if deleting else pod).object()
    earlier["metadata"]["uid"] = "uid-of-the-earlier"
    earlier["metadata"]["labels"][names.LABEL_JOB_UID] = "uid-before-x"
    earlier["metadata"]["ownerReferences"] = [names.owner_reference("x", "uid-before-x")]
    world.api.put("pods", earlier)
    for _ in range(20):
        await world.reconcile(after=5)
    assert (world.status()["phase"], world.reason("Accepted")) == ("Pending", "False/NameTaken")
    assert "The job starts as soon as it is gone." in world.message("Accepted")
    assert "delete x-1-driver" not in world.api.calls
    del world.api.objects["pods", "x-1-driver"]
    await world.reconcile(after=5)
    assert world.reason("Accepted") == "True/DriverCreated"


async def test_a_name_that_is_an_object_s_of_another_group_is_not_waited_for() -> None:
    """Its owner is of our kind by name only, so no garbage collector takes it away for us."""
    world = World()
    other = make_driver("x").object()
    owner = names.owner_reference("x", "uid-of-another") | {"apiVersion": "example.com/v1"}
    other["metadata"]["uid"] = "uid-of-another-pod"
    other["metadata"]["labels"][names.LABEL_JOB_UID] = "uid-of-another"
    other["metadata"]["ownerReferences"] = [owner]
    world.api.put("pods", other)
    await world.reconcile()
    assert "does not belong to this job. Delete it" in world.message("Accepted")


MISSING_ACCOUNT = ApiError(
    403,
    "Forbidden",
    'pods "x-1-driver" is forbidden: error looking up service account lanes/bagpipe-driver: '
    'serviceaccount "bagpipe-driver" not found',
)


async def test_a_missing_service_account_is_reported_then_ends_the_job() -> None:
    world = World()
    world.api.fail("create pods", *[MISSING_ACCOUNT] * 3)
    await world.reconcile()
    assert world.reason("Accepted") == "False/ServiceAccountMissing"
    assert world.message("Accepted") == (
        "There is no ServiceAccount bagpipe-driver in namespace lanes. Install the Helm chart "
        "bagpipe-namespace there, or add the namespace to jobNamespaces of the chart bagpipe: "
        "either makes the account."
    )
    await world.reconcile(after=29)
    assert world.status()["phase"] == "Pending"
    await world.reconcile(after=1)
    assert (world.status()["phase"], world.reason("Failed")) == (
        "Failed",
        "True/ServiceAccountMissing",
    )
    assert world.api.event_reasons() == ["ServiceAccountMissing", "ServiceAccountMissing"]


async def test_a_quota_that_gets_room_lets_the_job_start() -> None:
    world = World()
    full = ApiError(403, "Forbidden", "exceeded quota: pods, requested: pods=1, used: pods=5")
    world.api.fail("create pods", full, full)
    await world.reconcile()
    await world.reconcile(after=3600)
    assert world.reason("Accepted") == "False/QuotaExceeded"
    await world.reconcile(after=3.9)
    assert world.reason("Accepted") == "False/QuotaExceeded"
    await world.reconcile(after=0.1)
    assert world.reason("Accepted") == "True/DriverCreated"


@pytest.mark.parametrize("call", ["try pods", "create configmaps", "create pods"])
async def test_a_webhook_that_is_down_is_reported_and_the_deadline_counts(call: str) -> None:
    world = World(make_job("x").with_spec("startDeadline", "60s"))
    text = 'Internal error occurred: failed calling webhook "pods.istio.io": no endpoints available'
    world.api.fail(call, *[ApiError(500, "InternalError", text)] * 20)
    for _ in range(12):
        await world.reconcile(after=4)
    assert (world.status()["phase"], world.reason("Accepted")) == (
        "Pending",
        "False/CreationRefused",
    )
    assert 'webhook "pods.istio.io"' in world.message("Accepted")
    for _ in range(5):
        await world.reconcile(after=4)
    assert world.reason("Failed") == "True/StartDeadlineExceeded"
    assert 'webhook "pods.istio.io"' in world.message("Failed")


IN_TIME = [
    ApiError(0, "Timeout", "POST /api/v1/namespaces/lanes/pods: no answer in time."),
    ApiError(504, "Timeout", "request did not complete within requested timeout."),
]


@pytest.mark.parametrize("call", ["try pods", "create configmaps", "create pods"])
@pytest.mark.parametrize("error", IN_TIME)
async def test_a_webhook_that_hangs_is_reported_and_the_deadline_counts(
    call: str, error: ApiError
) -> None:
    world = World(make_job("x").with_spec("startDeadline", "60s"))
    world.api.fail(call, *[error] * 20)
    for _ in range(12):
        await world.reconcile(after=4)
    assert (world.status()["phase"], world.reason("Accepted")) == (
        "Pending",
        "False/CreationRefused",
    )
    assert error.message in world.message("Accepted")
    for _ in range(5):
        await world.reconcile(after=4)
    assert world.reason("Failed") == "True/StartDeadlineExceeded"


async def test_a_pod_whose_creation_is_not_answered_in_time_is_found() -> None:
    """The API server may make it all the same: no answer is not a refusal."""
    world = World()
    world.api.fail("create pods", IN_TIME[0])
    await world.reconcile()
    world.api.put("pods", make_driver("x").running().object())
    await world.reconcile(after=4)
    assert world.reason("Accepted") == "True/DriverCreated"
    assert world.api.named("pods") == ["x-1-driver"]


async def test_a_pod_that_was_made_all_the_same_leaves_no_job_that_waits() -> None:
    world = World()
    world.api.fail("create pods", IN_TIME[0])
    await world.reconcile()
    assert list(world.reconciler._starts._refusals._held) == [UID]
    world.deliver(make_driver("x").running())
    await world.reconcile(after=1)
    assert world.reason("Accepted") == "True/DriverCreated"
    assert world.reconciler._starts._refusals._held == {}


async def test_a_pod_of_the_trial_s_name_is_nothing_against_the_job() -> None:
    """The name is looked at last, when all that judges pods has let it pass: 100 minutes of silence
    were the answer to a pod that somebody had called so."""
    world = World()
    taken = ApiError(409, "AlreadyExists", 'pods "x-1-exec-trial" already exists')
    world.api.fail("try pods", taken)
    await world.reconcile()
    assert world.status()["phase"] == "Pending"
    assert world.api.named("pods") == ["x-1-driver"]


async def test_a_webhook_that_can_t_be_tried_keeps_no_job_from_its_driver() -> None:
    world = World()
    text = 'admission webhook "pods.example" does not support dry run'
    world.api.fail("try pods", *[ApiError(400, "BadRequest", text)] * 20)
    await world.reconcile()
    assert world.reason("Accepted") == "True/DriverCreated"


async def test_a_refused_pod_is_reported_in_the_server_s_words() -> None:
    world = World()
    text = 'violates PodSecurity "restricted:latest"'
    world.api.fail("create pods", ApiError(403, "Forbidden", text))
    await world.reconcile()
    assert world.reason("Accepted") == "False/CreationRefused"
    assert text in world.message("Accepted")


async def test_a_parameter_without_slash_is_named() -> None:
    world = World(make_job("x").with_spec("stack.parameters", {"threshold": 0.5}))
    await world.reconcile()
    assert world.reason("Failed") == "True/SpecInvalid"
    assert "write /threshold" in world.message("Failed")
    assert world.api.named("pods") == world.configs() == []


async def test_a_description_that_is_too_large() -> None:
    world = World(make_job("x").with_spec("stack.parameters", {"/urdf": "x" * 1_100_000}))
    await world.reconcile()
    assert world.reason("Failed") == "True/JobTooLarge"
    assert "a ConfigMap holds 1048576" in world.message("Failed")


async def test_a_stuck_executor_ends_the_job_and_takes_the_driver_along() -> None:
    world = World()
    await world.reconcile()
    stuck = make_executor("x").waiting("stack", "ImagePullBackOff", "Back-off", "none/such:1")
    world.deliver(make_driver("x").running(), stuck)
    world.drivers.says = account()
    for _ in range(15):
        await world.reconcile(after=2)
    assert world.reason("Running") == "False/StackImageUnavailable"
    assert world.api.named("pods") == ["x-1-driver", "x-1-exec-1"]
    await world.reconcile(after=2)
    assert world.reason("Failed") == "True/StackImageUnavailable"
    assert world.api.named("pods") == []
    assert world.api.event_reasons() == [
        "DriverCreated",
        "CasesPlanned",
        "StackImageUnavailable",
        "StackImageUnavailable",
    ]


async def test_an_image_that_arrives_in_time_is_forgiven() -> None:
    world = World()
    await world.reconcile()
    stuck = make_executor("x").waiting("stack", "ErrImagePull")
    fine = make_executor("x").running().with_container("stack", {"running": {}})
    world.drivers.says = account()
    for executor in (stuck, fine, stuck):
        world.deliver(make_driver("x").running(), executor)
        await world.reconcile(after=25)
    assert world.status()["phase"] == "Running"


async def test_a_replica_that_leads_again_is_as_patient_as_at_first() -> None:
    """What it saw when it led before may have been mended while another led."""
    world = World()
    first = world.reconciler
    await world.reconcile()
    stuck = make_executor("x").waiting("stack", "ImagePullBackOff", "Back-off", "none/such:1")
    world.deliver(make_driver("x").running(), stuck)
    world.drivers.says = account()
    await world.reconcile(after=2)
    world.reconciler = world.restarted(world.view)
    world.deliver(make_executor("x").running())
    await world.reconcile(after=20)
    assert world.reason("Running") == "True/CasesRunning"
    world.deliver(stuck)
    world.reconciler = first
    first.begin_to_lead()
    await world.reconcile(after=20)
    await world.reconcile(after=29)
    assert world.reason("Running") == "False/StackImageUnavailable"
    await world.reconcile(after=1)
    assert world.reason("Failed") == "True/StackImageUnavailable"


async def test_a_replica_that_leads_again_waits_for_a_driver_out_of_sight() -> None:
    world = World()
    await world.reconcile()
    world.forget_everything()
    first = world.reconciler
    await world.reconcile()
    world.clock.advance(3600)
    first.begin_to_lead()
    world.api.calls.clear()
    await world.reconcile()
    assert "get pods" not in world.api.calls


async def test_a_replica_that_leads_again_knows_no_account_of_before() -> None:
    """A driver that does not answer just then would seem to have gone back."""
    world = World()
    await world.reconcile()
    world.deliver(make_driver("x").running())
    world.drivers.says = account()
    await world.reconcile()
    world.reconciler.begin_to_lead()
    assert world.drivers.forgotten == ["uid-of-x-1-driver"]


async def test_pods_that_outlive_their_job_are_deleted() -> None:
    world = World()
    await world.reconcile()
    world.deliver(make_driver("x").ended(1, account("Failed")), make_executor("x").running())
    await world.reconcile(after=2)
    assert world.api.named("pods") == ["x-1-driver"]  # ended by itself: kept for its log


async def test_a_driver_out_of_sight_is_waited_for_then_asked_for() -> None:
    world = World()
    await world.reconcile()
    world.forget_everything()
    world.api.calls.clear()
    await world.reconcile()
    await world.reconcile(after=9.9)
    assert "get pods" not in world.api.calls
    await world.reconcile(after=0.1)
    assert world.api.calls.count("get pods") == 1
    assert world.status()["phase"] == "Pending"


async def test_a_driver_that_was_seen_to_go_is_asked_for_at_once() -> None:
    world = World()
    await world.reconcile()
    pod = world.view.driver(UID, 1)
    assert pod is not None
    world.view.drop_pod(pod)
    await world.reconcile()
    assert world.status()["attempt"] == 1  # the API server still has it: a late deletion
    assert world.view.driver(UID, 1) is not None
    del world.api.objects["pods", "x-1-driver"]
    world.view.drop_pod(pod)
    await world.reconcile()
    assert (world.status()["attempt"], world.reason("Running")) == (2, "False/DriverLost")


async def test_a_driver_that_is_gone_is_missed_after_a_live_look() -> None:
    world = World(make_job("x").with_spec("backoffLimit", 0))
    await world.reconcile()
    del world.api.objects["pods", "x-1-driver"]
    world.forget_everything()
    await world.reconcile()
    assert world.status()["phase"] == "Pending"
    await world.reconcile(after=10)
    assert world.reason("Failed") == "True/DriverLost"
    assert world.api.named("pods") == []


async def test_a_silent_driver_whose_end_the_watch_missed() -> None:
    world = World()
    await world.reconcile()
    world.deliver(make_driver("x").running())
    world.api.put("pods", make_driver("x").ended(0, account("Complete")).object())
    world.drivers.silent = 29.0
    await world.reconcile()
    assert world.status()["phase"] == "Planning"
    world.drivers.silent = 30.0
    await world.reconcile()
    assert world.status()["phase"] == "Complete"


async def test_a_job_that_is_gone_is_left_to_the_garbage_collector() -> None:
    world = World(make_job("x"))
    world.view.drop_job(UID)
    await world.reconcile()
    assert world.api.calls == []


def test_the_pod_of_another_attempt_is_no_driver_of_this_one() -> None:
    view = View()
    pod = make_driver("x").object()
    pod["metadata"]["labels"]["sim.bagpipe.io/attempt"] = "2"
    view.put_pod(PodView.from_object(pod))
    assert view.driver(UID, 1) is None
