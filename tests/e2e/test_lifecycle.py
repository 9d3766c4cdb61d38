"""Suspend, deadlines, removal and going on, with real pods: nothing that is done is run again."""

import json
from datetime import UTC, datetime
from typing import Any

import pytest

from tests.e2e import fleet, jobs
from tests.e2e import kubectl as k

pytestmark = pytest.mark.e2e

# Of the fleet's files, so many, and so long each, that a suspension falls among them on a slow
# machine too.
CASES = 40
LONG = fleet.PROGRAM.replace("sleep(1.0)", "sleep(4.0)")
SMALL = {"resources": {"cpu": "100m", "memory": "1Gi"}}
WIDTH = {"executors": 1, "slots": 2, "driver": SMALL, "executor": SMALL}
# For the cases that nothing has to fall among any more.
WIDER = WIDTH | {"executors": 2, "slots": 4}


@pytest.fixture(scope="module", autouse=True)
def files(namespace: str) -> None:
    """The inputs on the claim."""
    fleet.put_files(namespace)


def make_job(name: str, **changed: Any) -> k.Object:
    """40 cases of four seconds each, two at a time."""
    inputs = [f"pvc://recordings/{fleet.FOLDER}/{n:03d}.bin" for n in range(CASES)]
    fields: dict[str, Any] = {"source": {"files": inputs}, "spark": WIDTH} | changed
    job = fleet.make_job(name, **fields)
    job["spec"]["stack"]["command"] = ["python3", "-c", LONG]
    return job


def edit(namespace: str, name: str, **spec: object) -> None:
    k.kubectl(
        "-n", namespace, "patch", "simjob", name, "--type", "merge", "-p",
        json.dumps({"spec": spec}),
    )  # fmt: skip


def await_passed(namespace: str, name: str, least: int) -> None:
    def look() -> bool:
        status = k.get(namespace, "simjob", name).get("status", {})
        return bool(status.get("cases", {}).get("passed", 0) >= least)

    k.await_that(f"{least} cases of {name} to pass", look, 240)


def await_condition(namespace: str, name: str, type_: str, seconds: int) -> k.Object:
    """The job as it is when the condition holds."""
    output = k.kubectl(
        "-n", namespace, "wait", f"--for=condition={type_}", f"simjob/{name}",
        f"--timeout={seconds}s", "-o", "json", seconds=seconds + 10,
    )  # fmt: skip
    # As it was just then: an ended job may be gone in a moment.
    job: k.Object = json.loads(output)
    return job


def seconds_active(namespace: str, name: str) -> int:
    """For how long a job has been at work, as its deadline counts it."""
    began = datetime.fromisoformat(k.get(namespace, "simjob", name)["status"]["startTime"])
    return int((datetime.now(UTC) - began).total_seconds())


def pods_of(namespace: str, name: str) -> list[str]:
    found = k.items(namespace, "pods", "-l", f"sim.bagpipe.io/job={name}")
    return [pod["metadata"]["name"] for pod in found]


def recorded(namespace: str, job: k.Object) -> dict[str, str]:
    """Case -> the recorded name, as the manifest counts it."""
    manifest, _ = k.results(namespace, job["status"]["results"])
    return {case["case"]: case["recorded"][0] for case in manifest["cases"]}


def test_a_suspended_job_goes_on_and_runs_nothing_again(namespace: str) -> None:
    with jobs.applied(namespace, make_job("rests", backoffLimit=0)) as name:
        await_passed(namespace, name, 4)
        edit(namespace, name, suspend=True)
        status = await_condition(namespace, name, "Suspended", 300)["status"]
        assert (status["phase"], pods_of(namespace, name)) == ("Suspended", [])
        done = fleet.journaled(namespace, status["results"])
        # The driver's last segment: nothing that had been counted was lost.
        assert len(done) >= status["cases"]["passed"] >= 4
        edit(namespace, name, spark=WIDER)
        edit(namespace, name, suspend=False)
        ended = await_condition(namespace, name, "Complete", 300)
        assert ended["status"]["cases"]["passed"] == CASES
        assert (ended["status"]["attempt"], ended["status"]["lostDrivers"]) == (2, 0)
        counted = recorded(namespace, ended)
        assert {case: counted[case] for case in done} == done


# Promise: resumed-from-the-journal
@pytest.mark.slow
def test_a_deadline_keeps_what_is_done_and_another_job_goes_on_from_it(namespace: str) -> None:
    with jobs.applied(namespace, make_job("late", activeDeadline="3600s")) as late:
        await_passed(namespace, late, 2)
        edit(namespace, late, activeDeadline=f"{seconds_active(namespace, late) + 3}s")
        failed = await_condition(namespace, late, "Failed", 300)
        assert jobs.condition(failed, "Failed")["reason"] == "DeadlineExceeded"
        assert {"startTime", "completionTime"} <= set(failed["status"])
        assert pods_of(namespace, late) == []
        done = fleet.journaled(namespace, failed["status"]["results"])
        assert 2 <= len(done) < CASES
        with jobs.applied(namespace, make_job("later", resumeFrom=late, spark=WIDER)) as later:
            ended = await_condition(namespace, later, "Complete", 300)
            assert ended["status"]["cases"]["passed"] == CASES
            counted = recorded(namespace, ended)
            before = failed["status"]["results"]
            assert {case: counted[case] for case in done} == {
                case: f"{before}/{name}" for case, name in done.items()
            }
            _, rows = k.results(namespace, ended["status"]["results"])
            assert sum(row.get("ran_in") == late for row in rows) == len(done)


def test_an_ended_job_is_removed_with_its_pods_and_its_results_stay(namespace: str) -> None:
    one = {"files": [f"pvc://recordings/{fleet.FOLDER}/000.bin"]}
    job = fleet.make_job("brief", spark=WIDTH, source=one, ttlAfterFinished="15s")
    with jobs.applied(namespace, job) as name:
        status = await_condition(namespace, name, "Complete", 400)["status"]
        gone = ("wait", "--for=delete", f"simjob/{name}", "--timeout=240s")
        k.kubectl("-n", namespace, *gone, seconds=260)
        k.await_that("its pods to go", lambda: pods_of(namespace, name) == [], 240)
        manifest, _ = k.results(namespace, status["results"])
        assert manifest["verdict"] == "Passed"


def test_a_job_that_can_t_begin_in_time_says_why(namespace: str) -> None:
    huge = {"resources": {"cpu": "500", "memory": "1Gi"}}
    job = make_job("wide", startDeadline="3600s")
    job["spec"]["spark"] = WIDTH | {"driver": huge}
    with jobs.applied(namespace, job) as name:
        k.await_that("its lack of a node to be reported", lambda: is_unplaced(namespace, name), 240)
        edit(namespace, name, startDeadline=f"{seconds_active(namespace, name) + 3}s")
        failed = await_condition(namespace, name, "Failed", 300)
        condition = jobs.condition(failed, "Failed")
        assert condition["reason"] == "StartDeadlineExceeded"
        assert "has no node yet" in condition["message"]
        assert pods_of(namespace, name) == []


def is_unplaced(namespace: str, name: str) -> bool:
    """Whether the status says why the driver does not start."""
    conditions = k.get(namespace, "simjob", name).get("status", {}).get("conditions", [])
    return any(c["type"] == "Running" and c["reason"] == "Unschedulable" for c in conditions)
