"""Executors of a job with a range of them come with the cases, and go without losing one."""

import json

import pytest

from tests.e2e import fleet, jobs
from tests.e2e import kubectl as k

pytestmark = pytest.mark.e2e

# Of the fleet's files; the last is the largest, and so the first to run.
CASES = 7
LARGEST = f"{CASES - 1:03d}"
# In a stack's container: the large one runs there, it may end, the small ones may.
BEGUN, LARGE_MAY, SMALL_MAY = "/tmp/begun", "/tmp/large-may", "/tmp/small-may"
PROGRAM = f"""
import hashlib, pathlib, time
from bagpipe import binpipe
for record in binpipe.read():
    data = record.read()
    large = record.name.startswith("{LARGEST}")
    if large:
        pathlib.Path("{BEGUN}").touch()
    while not pathlib.Path("{LARGE_MAY}" if large else "{SMALL_MAY}").exists():
        time.sleep(0.05)
    binpipe.write(hashlib.sha256(data).hexdigest().encode(), name="digest")
"""


def job() -> k.Object:
    """Seven cases on one to three executors of one slot."""
    made = fleet.make_job(
        "breathes",
        source={"files": [f"pvc://recordings/{fleet.FOLDER}/{n:03d}.bin" for n in range(CASES)]},
        spark=jobs.spark(1, 1) | {"executors": {"min": 1, "max": 3}},
        playback={"caseTimeout": "300s"},
    )
    made["spec"]["stack"]["command"] = ["python3", "-c", PROGRAM]
    return made


def executors(namespace: str, name: str) -> list[str]:
    """Names of those that run and need not go."""
    found = fleet.pods(namespace, name, "executor")
    return [p["metadata"]["name"] for p in found if "deletionTimestamp" not in p["metadata"]]


def at_work_on_the_largest(namespace: str, pod: str) -> bool:
    """Whether this executor has the case that waits."""
    return in_stack(namespace, pod, "sh", "-c", f"ls {BEGUN} || true").strip() == BEGUN


def in_stack(namespace: str, pod: str, *command: str) -> str:
    return k.kubectl("-n", namespace, "exec", pod, "-c", "stack", "--", *command)


def test_executors_go_when_idle_and_one_that_must_go_ends_its_case_first(namespace: str) -> None:
    fleet.put_files(namespace)
    with jobs.applied(namespace, job()) as name:
        k.await_that("three executors", lambda: len(executors(namespace, name)) == 3, 300)
        for pod in executors(namespace, name):
            in_stack(namespace, pod, "touch", SMALL_MAY)
        k.await_that("the idle to go", lambda: len(executors(namespace, name)) == 1, 300)
        (pod,) = executors(namespace, name)
        assert at_work_on_the_largest(namespace, pod)
        # As a drain of its node does it: the pod has its grace period to end in.
        k.kubectl("-n", namespace, "delete", "pod", pod, "--wait=false")
        assert pod not in executors(namespace, name)
        in_stack(namespace, pod, "touch", LARGE_MAY)
        status = jobs.ended(namespace, name, 300)["status"]
    assert (status["phase"], status["verdict"]) == ("Complete", "Passed"), json.dumps(status)
    left = fleet.left_on_claim(namespace, status["results"])
    assert left.manifest["counts"]["planned"] == left.manifest["counts"]["passed"] == CASES
    assert sorted(row["case"] for row in left.rows) == [f"{n:03d}" for n in range(CASES)]
    assert {(row["starts"], row["attempts"]) for row in left.rows} == {(1, 1)}
    recorded = {case["case"]: case["recorded"][0] for case in left.manifest["cases"]}
    contents = {case: left.kept[path.split("/")[1]] for case, path in recorded.items()}
    assert contents == {case: fleet.expected()[case] for case in contents}
    assert len(left.kept) == CASES
