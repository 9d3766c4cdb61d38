"""Suspension, deadlines, removal and going on, on a real API server with a fake kubelet."""

import pytest
from embedded.api import ApiError

from bagpipe_operator.api import names
from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.due_schedules import a_schedule, schedules
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.integration.control_plane.observe import a_job, moment
from tests.unit.operator.builders import account
from tests.waiting import PATIENCE, wait_until

SECONDS = PATIENCE


class Jobs:
    """The jobs of one namespace."""

    def __init__(self, admin: Client, namespace: str) -> None:
        self.admin = admin
        self.namespace = namespace

    def create(self, name: str, **spec: object) -> None:
        job = a_job(name)
        job["spec"] |= spec
        self.admin.create(jobs(self.namespace), job)

    def edit(self, name: str, **spec: object) -> Object:
        return self.admin.merge(jobs(self.namespace, name), {"spec": spec})

    def get(self, name: str) -> Object:
        return self.admin.get(jobs(self.namespace, name))

    @staticmethod
    def stated_in(status: Object, type_: str) -> str:
        """`status/reason` of a condition; empty before it is written."""
        for condition in status.get("conditions", []):
            if condition["type"] == type_:
                return f"{condition['status']}/{condition['reason']}"
        return ""

    def await_reported(
        self, name: str, type_: str, expected: str, seconds: float = SECONDS
    ) -> Object:
        """The status that says so."""
        found: Object = {}

        def is_reported() -> bool:
            found.clear()
            found.update(self.get(name).get("status", {}))
            return self.stated_in(found, type_) == expected

        wait_until(is_reported, seconds, f"{type_} of {name} did not become {expected}")
        return found

    def pods(self) -> list[str]:
        found = self.admin.items(core(self.namespace, "pods"))
        return sorted(pod["metadata"]["name"] for pod in found)

    def await_pods(self, *expected: str) -> None:
        wait_until(
            lambda: self.pods() == list(expected), SECONDS, f"the pods did not become {expected}"
        )

    def events(self, name: str) -> list[str]:
        found = self.admin.items(core(self.namespace, "events"))
        return sorted(e["reason"] for e in found if e["involvedObject"]["name"] == name)


@pytest.fixture
def world(admin: Client, namespace: str) -> Jobs:
    return Jobs(admin, namespace)


def test_only_what_can_be_honoured_can_be_changed(world: Jobs) -> None:
    world.create("fixed", suspend=True)
    edited = world.edit(
        "fixed", suspend=False, activeDeadline="9s", startDeadline="8s",
        ttlAfterFinished="7s",
    )  # fmt: skip
    assert edited["metadata"]["generation"] == 2
    for change in (
        {"backoffLimit": 1},
        {"faultPolicy": [{"cause": "StackCrashed", "action": "retry"}]},
        {"queueName": "q"},
        {"resumeFrom": "other"},
        {"maxFailedCases": 1},
        {"record": {"topics": ["/other"]}},
        {"spark": {"executors": 2}},
        {"stack": {"image": "example/lane:2"}},
        {"playback": {"rate": 2.0}},
        {"output": {"uri": "pvc://results/other"}},
    ):
        with pytest.raises(ApiError, match=r"only spec.suspend, activeDeadline, startDead"):
            world.edit("fixed", **change)
    world.edit("fixed", suspend=True)
    world.edit("fixed", spark={"executors": 2})
    world.edit("fixed", suspend=False)
    with pytest.raises(ApiError, match=r"and spec.spark while it is suspended"):
        world.edit("fixed", spark={"executors": 3})
    for bad in ({"resumeFrom": "Old_1"}, {"queueName": "a b"}, {"ttlAfterFinished": "-1s"}):
        with pytest.raises(ApiError):
            world.create("bad", **bad)


@pytest.mark.usefixtures("bound_claims")
def test_suspend_before_any_pod_and_while_running(
    world: Jobs, kubelet: FakeKubelet, operator_process: StartOperator
) -> None:
    operator = operator_process()
    world.create("rests", suspend=True, backoffLimit=0)
    status = world.await_reported("rests", "Suspended", "True/JobSuspended")
    assert (status["phase"], world.pods()) == ("Suspended", [])
    assert "startTime" not in status
    world.edit("rests", suspend=False)
    world.await_pods("rests-1-driver")
    kubelet.bind(world.namespace, "rests-1-driver")
    kubelet.run(world.namespace, "rests-1-driver")
    world.edit("rests", suspend=True)
    world.await_reported("rests", "Suspended", "False/Suspending")
    status = world.get("rests")["status"]
    assert status["observedGeneration"] == 3
    operator.kill()  # while the pod ends
    kubelet.end(world.namespace, "rests-1-driver", 143, account("Running"))
    kubelet.remove(world.namespace, "rests-1-driver")
    operator.start()
    status = world.await_reported("rests", "Suspended", "True/JobSuspended")
    assert (status["attempt"], status["lostDrivers"], world.pods()) == (2, 0, [])
    world.edit("rests", suspend=False)
    world.await_pods("rests-2-driver")
    status = world.await_reported("rests", "Suspended", "False/JobResumed")
    assert "startTime" in status
    world.await_reported("rests", "Accepted", "True/DriverCreated")
    twice = ["DriverCreated", "JobResumed", "JobSuspended"]
    wait_until(
        lambda: world.events("rests") == sorted(twice * 2), SECONDS,
        lambda: f"not every transition was reported: {world.events('rests')}",
    )  # fmt: skip


def test_jobs_are_found_by_who_runs_them_and_by_their_queue(
    world: Jobs, operator_process: StartOperator
) -> None:
    operator_process()
    world.create("away", managedBy="kueue.x-k8s.io/multikueue", queueName="nightly")
    world.create("here", managedBy="sim.bagpipe.io/operator")
    world.await_reported("here", "Accepted", "True/DriverCreated")
    for field, name in (
        ("spec.managedBy=kueue.x-k8s.io/multikueue", "away"),
        ("spec.queueName=nightly", "away"),
        ("status.phase=Pending", "here"),
    ):
        found = world.admin.items(f"{jobs(world.namespace)}?fieldSelector={field}")
        assert [job["metadata"]["name"] for job in found] == [name]
    # The later one was taken up, so the earlier one was seen and left alone.
    assert world.get("away").get("status") is None
    assert world.pods() == ["here-1-driver"]
    with pytest.raises(ApiError, match=r"only spec.suspend"):
        world.edit("away", managedBy="sim.bagpipe.io/operator")


def test_deadlines_and_removal_also_of_what_ended_while_the_operator_was_down(
    world: Jobs, kubelet: FakeKubelet, operator_process: StartOperator
) -> None:
    operator = operator_process()
    world.create("late", activeDeadline="3s")
    world.create("stuck", startDeadline="3s")
    world.create("done", ttlAfterFinished="1s")
    for name in ("late", "stuck", "done"):
        status = world.await_reported(name, "Accepted", "True/DriverCreated")
        assert status["driver"] == f"{name}-1-driver"
    late = world.await_reported("late", "Failed", "True/DeadlineExceeded")
    assert late["completionTime"] > late["startTime"]
    world.await_reported("stuck", "Failed", "True/StartDeadlineExceeded")
    world.await_pods("done-1-driver")
    operator.kill()
    kubelet.end(world.namespace, "done-1-driver", 0, account("Complete", verdict="Passed"))
    operator.start()
    wait_until(
        lambda: not world.admin.exists(jobs(world.namespace, "done")), SECONDS,
        "the job was not removed",
    )  # fmt: skip
    world.await_pods()
    reason = "DeadlineExceeded"
    wait_until(lambda: reason in world.events("late"), SECONDS, "the deadline's Event is missing")
    assert world.events("late").count(reason) == 1
    edited = world.edit("late", ttlAfterFinished="3600s")["metadata"]["generation"]
    wait_until(
        lambda: world.get("late")["status"]["observedGeneration"] == edited, SECONDS,
        "the edit of an ended job was not acknowledged",
    )  # fmt: skip
    world.edit("late", ttlAfterFinished="0s")
    wait_until(
        lambda: not world.admin.exists(jobs(world.namespace, "late")), SECONDS,
        "the failed job was not removed",
    )  # fmt: skip


def test_a_job_goes_on_from_another(
    world: Jobs, kubelet: FakeKubelet, operator_process: StartOperator
) -> None:
    operator_process()
    world.create("first")
    world.await_pods("first-1-driver")
    failed = account(
        "Failed", reason="CasesErrored", cases={"planned": 4, "passed": 3, "errored": 1}
    )
    kubelet.end(world.namespace, "first-1-driver", 1, failed)
    world.await_reported("first", "Failed", "True/CasesErrored")
    world.create("second", resumeFrom="first")
    status = world.await_reported("second", "Accepted", "True/DriverCreated")
    assert status["resumedFrom"] == {"job": "first", "results": "pvc://results/lane/x", "cases": 4}
    pod = world.admin.get(core(world.namespace, "pods", "second-1-driver"))
    (mounted,) = [v["configMap"]["name"] for v in pod["spec"]["volumes"] if v["name"] == "config"]
    config = world.admin.get(core(world.namespace, "configmaps", mounted))
    assert '"results": "pvc://results/lane/x"' in config["data"]["job.json"]
    world.create("third", resumeFrom="nobody")
    status = world.await_reported("third", "Failed", "True/ResumeRefused")
    assert {"startTime", "completionTime"} <= set(status)


def a_run_that_passed(world: Jobs, name: str) -> None:
    """A job of the schedule `nightly`, which another operator has brought to its end."""
    schedule = world.admin.get(schedules(world.namespace, "nightly"))
    job = a_job(name)
    job["metadata"] |= {
        "labels": {names.LABEL_SCHEDULE: "nightly"},
        "ownerReferences": [
            names.owner_reference("nightly", schedule["metadata"]["uid"], names.SCHEDULE_KIND)
        ],
    }
    job["spec"]["managedBy"] = "example.com/other"
    world.admin.create(jobs(world.namespace), job)
    status = {
        "results": f"pvc://archive/{name}",
        "conditions": [
            {"type": kind, "status": "True", "reason": "Passed", "message": "It has.",
             "lastTransitionTime": "2026-11-20T04:00:00Z"}
            for kind in ("Complete", "Passed")
        ],
    }  # fmt: skip
    world.admin.merge(jobs(world.namespace, name) + "/status", {"status": status})


def test_a_job_is_compared_with_the_last_run_of_a_schedule_that_passed(
    world: Jobs, operator_process: StartOperator
) -> None:
    operator_process()
    follows = {"lastPassed": "schedule/nightly"}
    world.create("typo", baseline=follows)
    status = world.await_reported("typo", "Failed", "True/BaselineRefused")
    assert {"startTime", "completionTime"} <= set(status)
    world.admin.create(schedules(world.namespace), a_schedule(suspend=True))
    world.create("first", baseline=follows)
    status = world.await_reported("first", "Accepted", "True/DriverCreated")
    assert world.stated_in(status, "BaselineFound") == "False/NoBaselineYet"
    assert status["baseline"] == {"schedule": "nightly"}
    a_run_that_passed(world, "nightly-29914710")
    kept = {
        "job": "nightly-29914710", "results": "pvc://archive/nightly-29914710",
        "scheduleTime": "2026-11-17T02:30:00Z",
    }  # fmt: skip
    nightly = schedules(world.namespace, "nightly")
    wait_until(
        lambda: world.admin.get(nightly).get("status", {}).get("lastPassed") == kept,
        SECONDS, "the schedule does not keep its last run that passed",
    )  # fmt: skip
    world.admin.delete(jobs(world.namespace, "nightly-29914710"))
    world.create("second", baseline=follows)
    status = world.await_reported("second", "Accepted", "True/DriverCreated")
    assert world.stated_in(status, "BaselineFound") == "True/LastPassed"
    assert status["baseline"] == {"schedule": "nightly"} | kept
    assert world.get("first")["status"]["baseline"] == {"schedule": "nightly"}
    pod = world.admin.get(core(world.namespace, "pods", "second-1-driver"))
    claims = [v["persistentVolumeClaim"]["claimName"] for v in pod["spec"]["volumes"]
              if "persistentVolumeClaim" in v]  # fmt: skip
    assert "archive" in claims
    assert "LastPassed" in world.events("second")
    for bad in ({}, follows | {"results": "pvc://results/x"}, {"lastPassed": "nightly"}):
        with pytest.raises(ApiError, match=r"baseline"):
            world.create("bad", baseline=bad)


@pytest.mark.usefixtures("bound_claims")
def test_a_lost_driver_is_replaced_after_ten_seconds(
    world: Jobs, kubelet: FakeKubelet, operator_process: StartOperator
) -> None:
    operator_process()
    world.create("lost")
    world.await_pods("lost-1-driver")
    kubelet.end(world.namespace, "lost-1-driver", 137)
    status = world.await_reported("lost", "Running", "False/DriverFailed")
    # Who looks late sees the next driver already.
    assert (status["lostDrivers"], status["driver"] in ("", "lost-2-driver")) == (1, True)
    world.await_pods("lost-1-driver", "lost-2-driver")
    pods = world.admin.items(core(world.namespace, "pods"))
    first, second = sorted(moment(pod["metadata"]["creationTimestamp"]) for pod in pods)
    assert (second - first).total_seconds() >= 10
