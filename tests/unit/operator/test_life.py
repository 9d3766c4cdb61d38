"""The life of a job by the clock: suspension, deadlines, removal, and going on from another job."""

import pytest

from bagpipe.spec import SimulationJobSpec
from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.policies.resume import INDIFFERENT_SECTIONS
from bagpipe_operator.jobs.sweep import Sweeper
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import WorkQueue
from tests.unit.operator.builders import (
    JobBuilder,
    account,
    make_driver,
    make_executor,
    make_job,
)
from tests.unit.operator.world import UID, World

INTERRUPTED = account("Running", cases={"planned": 4, "running": 0, "passed": 2})


def edit(world: World, **spec: object) -> None:
    """A user's edit of the spec, delivered by the watch."""
    job = world.api.objects["jobs", "x"]
    job["spec"] = job["spec"] | spec
    job["metadata"]["generation"] += 1
    world.api.version += 1
    job["metadata"]["resourceVersion"] = str(world.api.version)
    world.deliver_job()


def gone(world: World, *pod_names: str) -> None:
    """The pods have ended: the API server and the watch forget them."""
    for pod in [p for p in world.view.pods(UID) if p.name in pod_names]:
        world.api.objects.pop(("pods", pod.name), None)
        world.view.drop_pod(pod)


async def running(world: World) -> None:
    await world.reconcile()
    world.deliver(make_driver("x").running(), make_executor("x").running())
    world.drivers.says = account()
    await world.reconcile(after=2)


def deleting_driver() -> PodView:
    return make_driver("x").running().deleting(gone_by="2026-11-20T04:00:40Z").view()


def ending_driver(gone_by: str = "", phase: str = "Running") -> PodView:
    """A driver whose container has ended, as the kubelet reports it before the pod's phase."""
    pod = make_driver("x").ended(143, INTERRUPTED)
    pod.phase = phase
    return (pod.deleting(gone_by) if gone_by else pod).view()


def without_events(calls: list[str]) -> list[str]:
    """The calls without Events: an operator reports a job again that it meets."""
    return [call for call in calls if call != "create events"]


async def test_a_job_that_is_created_suspended_has_no_pod_and_no_clock() -> None:
    world = World(make_job("x").with_spec("suspend", True).with_spec("activeDeadline", "5s"))
    await world.reconcile()
    await world.reconcile(after=3600)
    assert world.api.named("pods") == world.configs() == []
    status = world.status()
    assert (status["phase"], status["attempt"], status["driver"]) == ("Suspended", 1, "")
    assert "startTime" not in status
    assert world.reason("Suspended") == "True/JobSuspended"
    assert world.reason("Accepted") == "False/JobSuspended"
    assert world.api.event_reasons() == ["JobSuspended"]
    assert world.api.calls == ["get pods", "patch status", "create events"]
    edit(world, suspend=False)
    await world.reconcile()
    assert world.api.named("pods") == []  # Suspended is False before there is a pod
    await world.reconcile()
    status = world.status()
    assert (status["attempt"], status["driver"], status["phase"]) == (1, "x-1-driver", "Pending")
    assert status["startTime"] == "2026-11-20T05:00:00Z"
    assert status["observedGeneration"] == 2
    assert world.reason("Suspended") == "False/JobResumed"
    assert sorted(world.api.event_reasons()) == ["DriverCreated", "JobResumed", "JobSuspended"]


async def test_a_running_job_is_stopped_driver_first_and_goes_on_as_another_attempt() -> None:
    world = World(make_job("x").with_spec("backoffLimit", 0))
    await running(world)
    edit(world, suspend=True)
    await world.reconcile(after=1)
    assert world.status()["observedGeneration"] == 2
    assert world.reason("Suspended") == "False/Suspending"
    assert world.message("Suspended").endswith("2 pods are being stopped; what is done is kept.")
    assert [call for call in world.api.calls if "delete" in call] == ["delete x-1-driver"]
    world.view.put_pod(deleting_driver())
    await world.reconcile(after=1)
    assert [call for call in world.api.calls if "delete" in call] == ["delete x-1-driver"]
    last = make_driver("x").ended(143, INTERRUPTED).deleting().view()
    world.view.put_pod(last)
    await world.reconcile(after=1)
    assert world.api.calls[-1] == "delete x-1-exec-1"
    # A driver needs its own grace period to keep what is done; an executor without one, none.
    assert world.api.graces == {"x-1-driver": None, "x-1-exec-1": 10}
    assert world.status()["cases"]["passed"] == 2
    gone(world, "x-1-driver", "x-1-exec-1")
    await world.reconcile(after=1)
    status = world.status()
    assert (status["phase"], status["attempt"], status["lostDrivers"]) == ("Suspended", 2, 0)
    assert (status["cases"]["passed"], status["cases"]["running"]) == (2, 0)
    assert world.reason("Suspended") == "True/JobSuspended"
    edit(world, suspend=False)
    await world.reconcile(after=100)
    await world.reconcile()
    assert world.api.named("pods") == ["x-2-driver"]
    assert world.status()["startTime"] == "2026-11-20T04:01:46Z"
    assert world.api.event_reasons().count("JobSuspended") == 1
    assert world.api.event_reasons().count("JobResumed") == 1


@pytest.mark.parametrize("phase", ["Running", "Failed"])
async def test_a_job_is_not_called_suspended_while_a_stopped_pod_is_still_there(phase: str) -> None:
    world = World()
    await running(world)
    edit(world, suspend=True)
    await world.reconcile(after=1)
    gone(world, "x-1-exec-1")
    # Its containers have ended, and its volumes are being taken down.
    world.view.put_pod(ending_driver("2026-11-20T04:00:30Z", phase))
    await world.reconcile(after=1)
    assert world.reason("Suspended") == "False/Suspending"
    assert world.message("Suspended").endswith("1 pod is being stopped; what is done is kept.")
    gone(world, "x-1-driver")
    await world.reconcile(after=1)
    assert world.reason("Suspended") == "True/JobSuspended"


async def test_a_driver_that_ends_by_itself_during_a_suspension_is_kept_for_its_log() -> None:
    world = World(make_job("x").with_spec("suspend", True))
    world.api.put("pods", make_driver("x").object())
    world.view.put_pod(ending_driver())
    world.view.put_pod(make_executor("x").running().view())
    await world.reconcile()
    assert [call for call in world.api.calls if "delete" in call] == ["delete x-1-exec-1"]
    assert world.reason("Suspended") == "False/Suspending"
    gone(world, "x-1-exec-1")
    world.view.put_pod(ending_driver(phase="Failed"))
    await world.reconcile(after=1)
    assert world.reason("Suspended") == "True/JobSuspended"
    assert [call for call in world.api.calls if "delete" in call] == ["delete x-1-exec-1"]


async def test_a_suspension_that_is_taken_back_is_brought_to_its_end_first() -> None:
    world = World(make_job("x").with_spec("backoffLimit", 0))
    await running(world)
    edit(world, suspend=True)
    await world.reconcile()
    edit(world, suspend=False)
    world.view.put_pod(make_driver("x").ended(143, INTERRUPTED).deleting().view())
    await world.reconcile(after=1)
    gone(world, "x-1-driver", "x-1-exec-1")
    await world.reconcile(after=1)
    assert world.reason("Suspended") == "True/JobSuspended"
    await world.reconcile(after=1)
    await world.reconcile()
    assert world.status()["driver"] == "x-2-driver"
    assert (world.status()["lostDrivers"], world.reason("Failed")) == (0, "False/InProgress")


async def test_a_driver_that_commits_while_it_is_stopped_has_completed_the_job() -> None:
    world = World()
    await running(world)
    edit(world, suspend=True)
    await world.reconcile()
    done = account("Complete", reason="AllCasesRan", cases={"planned": 4, "passed": 4})
    world.deliver(make_driver("x").ended(0, done).deleting())
    await world.reconcile(after=1)
    assert world.reason("Complete") == "True/AllCasesRan"
    assert world.status()["completionTime"] == "2026-11-20T04:00:03Z"


async def test_a_suspension_after_a_restart_finds_the_driver_that_no_watch_has_shown() -> None:
    """Killed between creating the driver and writing so, and suspended before it is back."""
    world = World()
    world.api.fail("patch status", ApiError(0, "Unreachable", "killed"))
    with pytest.raises(ApiError, match="killed"):
        await world.reconcile()
    pod = world.api.objects["pods", "x-1-driver"]
    assert pod["metadata"]["labels"][names.LABEL_JOB_UID] == UID
    edit(world, suspend=True)
    fresh = View()
    fresh.put_job(JobView.from_object(world.api.objects["jobs", "x"]))
    world.view = fresh
    world.reconciler = world.restarted(fresh)
    await world.reconcile()
    assert world.api.named("pods") == []
    assert world.reason("Suspended") == "False/Suspending"


async def test_a_driver_on_a_node_that_is_cut_off_does_not_hold_up_the_suspension() -> None:
    world = World()
    await running(world)
    edit(world, suspend=True)
    await world.reconcile()
    gone(world, "x-1-exec-1")
    world.view.put_pod(deleting_driver())
    await world.reconcile(after=53)
    assert world.reason("Suspended") == "False/Suspending"
    await world.reconcile(after=1)
    assert world.reason("Suspended") == "True/JobSuspended"


async def test_the_active_deadline_stops_the_pods_and_then_fails_the_job() -> None:
    world = World(make_job("x").with_spec("activeDeadline", "60s"))
    await running(world)
    await world.reconcile(after=57)
    assert world.reason("Running") == "True/CasesRunning"
    await world.reconcile(after=1)
    assert world.reason("Running") == "False/DeadlineExceeded"
    assert "completionTime" not in world.status()
    gone(world, "x-1-exec-1")
    world.view.put_pod(ending_driver(gone_by="2026-11-20T04:01:30Z"))
    await world.reconcile(after=3)
    assert world.reason("Failed") == "False/InProgress"
    assert world.status()["cases"]["passed"] == 2
    gone(world, "x-1-driver")
    await world.reconcile(after=1)
    assert world.reason("Failed") == "True/DeadlineExceeded"
    assert "spec.activeDeadline (60s)" in world.message("Failed")
    assert world.status()["cases"]["passed"] == 2
    assert world.status()["completionTime"] == "2026-11-20T04:01:04Z"
    assert world.api.event_reasons().count("DeadlineExceeded") == 1


async def test_the_active_deadline_may_be_moved_while_the_job_runs() -> None:
    world = World(make_job("x").with_spec("activeDeadline", "60s"))
    await running(world)
    edit(world, activeDeadline="100s")
    await world.reconcile(after=97)
    assert world.status()["phase"] == "Running"
    await world.reconcile(after=1)
    assert world.reason("Running") == "False/DeadlineExceeded"


async def stopped_for_its_deadline(world: World) -> None:
    """The driver ends within its grace period, and goes."""
    gone(world, "x-1-exec-1")
    world.view.put_pod(ending_driver(gone_by="2026-11-20T04:01:30Z"))
    await world.reconcile(after=1)
    gone(world, "x-1-driver")
    await world.reconcile(after=1)


async def test_a_deadline_that_is_moved_while_the_pods_are_stopped_is_brought_to_its_end() -> None:
    """The driver was asked to stop, and was not lost."""
    world = World(make_job("x").with_spec("activeDeadline", "60s").with_spec("backoffLimit", 0))
    await running(world)
    await world.reconcile(after=58)
    edit(world, activeDeadline="600s")
    await stopped_for_its_deadline(world)
    assert world.reason("Failed") == "True/DeadlineExceeded"
    assert "spec.activeDeadline (60s)" in world.message("Failed")
    assert world.status()["lostDrivers"] == 0


async def test_a_replica_whose_clock_is_behind_brings_a_deadline_to_its_end() -> None:
    world = World(make_job("x").with_spec("activeDeadline", "60s").with_spec("backoffLimit", 0))
    await running(world)
    await world.reconcile(after=58)
    world.reconciler = world.restarted(world.view)
    world.clock.advance(-20)
    await stopped_for_its_deadline(world)
    assert world.reason("Failed") == "True/DeadlineExceeded"


async def test_a_replica_whose_clock_is_behind_ends_no_job_before_it_began() -> None:
    world = World()
    await running(world)
    world.reconciler = world.restarted(world.view)
    world.clock.advance(-20)
    world.deliver(make_driver("x").ended(0, account("Complete")))
    await world.reconcile()
    assert world.status()["startTime"] == "2026-11-20T04:00:00Z"
    assert world.status()["completionTime"] == "2026-11-20T04:00:00Z"


async def test_a_case_that_begins_while_a_late_driver_is_stopped_takes_nothing_back() -> None:
    world = World(make_job("x").with_spec("startDeadline", "30s").with_spec("backoffLimit", 0))
    await world.reconcile()
    world.deliver(make_driver("x").running())
    world.drivers.says = account("Planning", cases={"planned": 0})
    await world.reconcile(after=30)
    assert world.reason("Running") == "False/StartDeadlineExceeded"
    world.view.put_pod(deleting_driver())
    world.drivers.says = account()
    await world.reconcile(after=1)
    await stopped_for_its_deadline(world)
    assert world.reason("Failed") == "True/StartDeadlineExceeded"


async def test_a_job_that_does_not_begin_in_time_says_what_it_waited_for() -> None:
    world = World(make_job("x").with_spec("startDeadline", "30s"))
    await world.reconcile()
    waiting = make_driver("x").unschedulable("0/3 nodes are available.")
    world.deliver(waiting)
    await world.reconcile(after=29)
    assert world.reason("Running") == "False/Unschedulable"
    await world.reconcile(after=1)
    message, writes = world.message("Running"), world.api.calls.count("patch status")
    assert message.endswith("1 pod is being stopped; what is done is kept.")
    world.deliver(waiting.deleting(gone_by="2026-11-20T04:10:40Z"))
    for _ in range(20):
        await world.reconcile(after=1)
    assert world.message("Running") == message
    assert world.api.calls.count("patch status") == writes
    gone(world, "x-1-driver")
    await world.reconcile(after=1)
    assert world.reason("Failed") == "True/StartDeadlineExceeded"
    assert "0/3 nodes are available." in world.message("Failed")
    assert world.message("Failed").count("No case began within") == 1


async def test_a_job_whose_first_case_ran_in_time_has_no_start_deadline_any_more() -> None:
    world = World(make_job("x").with_spec("startDeadline", "30s"))
    await running(world)
    assert world.status()["firstCaseTime"] == "2026-11-20T04:00:02Z"
    world.deliver(make_driver("x").ended(137))
    await world.reconcile(after=2)
    await world.reconcile(after=600)
    assert world.status()["driver"] == "x-2-driver"
    assert world.reason("Failed") == "False/InProgress"


def silent_since_it_started(world: World) -> None:
    """A driver that runs, and of whose cases the status knows nothing."""
    world.deliver(make_driver("x").running(), make_executor("x").running())
    world.drivers.says = None


async def test_a_start_deadline_asks_the_driver_before_it_ends_a_job_that_runs() -> None:
    """The operator was down, and the job's status has no case."""
    world = World(make_job("x").with_spec("startDeadline", "30s"))
    await world.reconcile()
    silent_since_it_started(world)
    world.drivers.says = account()
    await world.reconcile(after=3600)
    assert world.reason("Running") == "True/CasesRunning"
    assert world.status()["firstCaseTime"] == "2026-11-20T05:00:00Z"


async def test_silence_of_a_running_driver_is_no_late_start() -> None:
    world = World(make_job("x").with_spec("startDeadline", "30s"))
    await world.reconcile()
    silent_since_it_started(world)
    for _ in range(10):
        await world.reconcile(after=30)
    assert world.api.calls.count("delete pods") == 0
    world.drivers.says = account("Planning", cases={"planned": 0})
    await world.reconcile(after=1)
    assert world.reason("Running") == "False/StartDeadlineExceeded"
    # What has begun is brought to its end, whatever the driver says while it is stopped.
    world.drivers.says = account()
    await world.reconcile(after=1)
    assert world.reason("Running") == "False/StartDeadlineExceeded"


async def test_a_silent_driver_has_its_active_deadline_all_the_same() -> None:
    job = make_job("x").with_spec("startDeadline", "30s")
    world = World(job.with_spec("activeDeadline", "600s"))
    await world.reconcile()
    silent_since_it_started(world)
    await world.reconcile(after=599)
    assert world.reason("Running") != "False/DeadlineExceeded"
    await world.reconcile(after=1)
    assert world.reason("Running") == "False/DeadlineExceeded"


async def test_a_lost_driver_s_last_account_of_cases_is_no_late_start() -> None:
    """It ended while the operator was down, and is replaced."""
    world = World(make_job("x").with_spec("startDeadline", "30s"))
    await world.reconcile()
    gone_spark = account("Running", reason="SparkGone", cases={"planned": 4, "passed": 2})
    world.deliver(make_driver("x").ended(1, gone_spark))
    await world.reconcile(after=3600)
    assert world.status()["lostDrivers"] == 1
    assert world.reason("Failed") == "False/InProgress"


def ended_job(condition: str, ttl: str = "60s") -> JobBuilder:
    ends = [
        {
            "type": kind,
            "status": status,
            "reason": "R",
            "message": "M.",
            "observedGeneration": 1,
            "lastTransitionTime": "2026-11-20T04:00:00Z",
        }
        for kind, status in ((condition, "True"), ("Passed", "False"))
    ]
    return (
        make_job("x")
        .with_spec("ttlAfterFinished", ttl)
        .with_status(conditions=ends, completionTime="2026-11-20T04:00:00Z", observedGeneration=1)
    )


@pytest.mark.parametrize("condition", ["Complete", "Failed"])
async def test_an_ended_job_is_removed_when_its_time_is_over(condition: str) -> None:
    world = World(ended_job(condition))
    queue = WorkQueue(world.clock.monotonic)
    sweeper = Sweeper(world.view, queue, 2.0, now=world.clock.now)
    world.clock.advance(59)
    assert sweeper.sweep() == 0
    await world.reconcile()
    assert without_events(world.api.calls) == []
    world.clock.advance(1)
    assert sweeper.sweep() == 1
    await world.reconcile()
    assert without_events(world.api.calls) == ["delete job"]
    assert world.view.job(UID) is None


async def test_a_job_that_has_changed_is_not_removed_by_what_was_known_before() -> None:
    world = World(ended_job("Complete"))
    world.clock.advance(60)
    stale = world.view.job(UID)
    assert stale is not None
    edit(world, ttlAfterFinished="600s")
    world.view = View()
    world.view.put_job(stale)
    world.reconciler = world.restarted(world.view)
    await world.reconcile()
    assert without_events(world.api.calls) == ["delete job", "get job"]
    await world.reconcile()
    assert world.status()["observedGeneration"] == 2  # and kept


async def test_a_suspended_job_is_neither_swept_nor_removed() -> None:
    world = World(make_job("x").with_spec("suspend", True).with_spec("ttlAfterFinished", "0s"))
    sweeper = Sweeper(world.view, WorkQueue(world.clock.monotonic), 2.0, now=world.clock.now)
    assert sweeper.sweep() == 1
    await world.reconcile()
    assert sweeper.sweep() == 0
    await world.reconcile(after=3600)
    assert "delete job" not in world.api.calls


def earlier(**changed: object) -> Json:
    job = make_job("old").object
    job["spec"] |= changed
    job["status"] = {
        "conditions": [{"type": "Failed", "status": "True"}],
        "results": "pvc://results/lane/old/uid-of-old",
        "cases": {"planned": 4, "passed": 3},
    }
    return job


async def test_a_job_goes_on_from_another_even_if_that_is_removed_meanwhile() -> None:
    world = World(make_job("x").with_spec("resumeFrom", "old"))
    world.api.put("jobs", earlier())
    await world.reconcile()
    assert world.api.named("pods") == []
    resumed = {"job": "old", "results": "pvc://results/lane/old/uid-of-old", "cases": 4}
    assert world.status()["resumedFrom"] == resumed
    del world.api.objects["jobs", "old"]
    await world.reconcile()
    data = world.config("x-1")["data"]["job.json"]
    assert '"resume": {' in data
    assert '"results": "pvc://results/lane/old/uid-of-old"' in data


STACK = {"image": "example/lane:1", "command": ["roslaunch", "lane"]}
REFUSED: dict[str, tuple[Json | None, str]] = {
    "missing": (None, "There is no SimulationJob old in namespace lanes"),
    "running": (earlier() | {"status": {}}, "has not ended: wait until"),
    "other stack": (
        earlier(stack=STACK | {"image": "lane:2"}),
        "spec.stack is not that of job old",
    ),
    # A lenient job passes what a strict one does not.
    "other fault policy": (
        earlier(faultPolicy=[{"cause": "StackCrashed", "action": "allow"}]),
        "spec.faultPolicy is not that of job old",
    ),
    "unplanned": (
        earlier() | {"status": {"conditions": earlier()["status"]["conditions"]}},
        "ended before its cases were planned",
    ),
    "other claim": (
        earlier()
        | {"status": earlier()["status"] | {"results": "pvc://elsewhere/lane/old/uid-of-old"}},
        "are on the claim elsewhere, which this job does not mount",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
async def test_a_job_that_can_t_be_gone_on_from_is_refused_with_a_sentence(case: str) -> None:
    found, sentence = REFUSED[case]
    world = World(make_job("x").with_spec("resumeFrom", "old"))
    if found is not None:
        world.api.put("jobs", found)
    await world.reconcile()
    assert world.reason("Failed") == "True/ResumeRefused"
    assert sentence in world.message("Failed")
    assert {"startTime", "completionTime"} <= set(world.status())


def test_each_section_of_a_spec_decides_a_case_unless_it_is_known_not_to() -> None:
    fields = {field.alias or name for name, field in SimulationJobSpec.model_fields.items()}
    assert fields - INDIFFERENT_SECTIONS == {
        "source", "stack", "variants", "matrix", "playback", "record", "baseline", "evaluate",
        "faultPolicy",
    }  # fmt: skip
    assert fields >= INDIFFERENT_SECTIONS


@pytest.mark.parametrize(
    ("claim", "mounted", "reason"),
    [
        ("weights-v1", True, None),
        ("weights-v2", True, "its cases ran with other files"),
        ("weights-v2", False, None),
    ],
)
async def test_other_files_of_the_stack_are_another_stack(
    claim: str, mounted: bool, reason: str | None
) -> None:
    mounts = [{"name": "weights", "mountPath": "/opt/weights"}] if mounted else []
    stack = STACK | {"volumeMounts": mounts}

    def spark(claim: str) -> Json:
        volume = {"name": "weights", "persistentVolumeClaim": {"claimName": claim}}
        return {"executor": {"pod": {"volumes": [volume]}}}

    job = make_job("x").with_spec("resumeFrom", "old").with_spec("stack", stack)
    world = World(job.with_spec("spark", spark(claim)))
    world.api.put("jobs", earlier(stack=stack, spark=spark("weights-v1")))
    await world.reconcile()
    if reason is None:
        assert world.status()["resumedFrom"]["job"] == "old"
    else:
        assert world.reason("Failed") == "True/ResumeRefused"
        assert reason in world.message("Failed")


def resumed_or_refused(world: World) -> bool:
    """Whether the job goes on from the earlier one, or was refused for that alone."""
    if "resumedFrom" in world.status():
        return True
    assert world.reason("Failed") == "True/ResumeRefused"
    return False


@pytest.mark.parametrize(
    ("before", "now", "resumes"),
    [(1, True, False), (True, 1, False), (0, False, False), (1, 1.0, True), ([1], [True], False)],
)
async def test_a_parameter_of_another_type_is_another_stack(
    before: object, now: object, resumes: bool
) -> None:
    """Python has 1 equal to true, and ROS has not."""
    job = make_job("x").with_spec("resumeFrom", "old")
    world = World(job.with_spec("stack", STACK | {"parameters": {"/use_lidar": now}}))
    world.api.put("jobs", earlier(stack=STACK | {"parameters": {"/use_lidar": before}}))
    await world.reconcile()
    assert resumed_or_refused(world) == resumes


@pytest.mark.parametrize(
    ("before", "now", "resumes"),
    [
        ({"maxYawError": 3.141592653589793}, {}, True),
        ({"yaw": 0.5, "maxYawError": 0.2}, {"yaw": 0.5, "maxYawError": 0.1}, False),
        ({"yaw": 0.5, "maxYawError": 0.2}, {}, False),
    ],
)
async def test_a_bound_that_an_earlier_crd_has_stored_decides_nothing(
    before: Json, now: Json, resumes: bool
) -> None:
    def criteria(heading: Json) -> list[Json]:
        pose = {"topic": "/lane_pose", "position": [0, 0], "maxDistance": 1} | heading
        return [{"name": "end", "finalPose": pose}]

    record = {"topics": ["/lane_pose"]}
    job = make_job("x").with_spec("resumeFrom", "old").with_spec("record", record)
    world = World(job.with_spec("evaluate", criteria(now)))
    world.api.put("jobs", earlier(evaluate=criteria(before), record=record))
    await world.reconcile()
    assert resumed_or_refused(world) == resumes


async def test_more_memory_for_the_stack_does_not_hinder_going_on() -> None:
    world = World(make_job("x").with_spec("resumeFrom", "old"))
    more = STACK | {"resources": {"limits": {"memory": "4Gi"}}, "imagePullPolicy": "Always"}
    world.api.put("jobs", earlier(stack=more))
    await world.reconcile()
    assert world.status()["resumedFrom"]["job"] == "old"


async def test_the_queue_s_label_is_on_every_pod() -> None:
    world = World(make_job("x").with_spec("queueName", "nightly"))
    await world.reconcile()
    labels = world.api.objects["pods", "x-1-driver"]["metadata"]["labels"]
    assert labels["kueue.x-k8s.io/queue-name"] == "nightly"
    template = world.config("x-1")["data"]["executor.yaml"]
    assert "kueue.x-k8s.io/queue-name: nightly" in template
