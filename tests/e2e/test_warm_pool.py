"""Jobs of a pool run one after the other in the pods of the first, each with its own results."""

import hashlib
import json

import pytest

from tests.e2e import fleet, jobs
from tests.e2e import kubectl as k

# Where another job has no room, those that wait give it theirs: no other test runs beside these.
pytestmark = [pytest.mark.e2e, pytest.mark.alone]

CASES = 4
# By its own command, which comes with each case, a program says whose it is.
PROGRAM = """
import hashlib, sys
from bagpipe import binpipe
for record in binpipe.read():
    digest = hashlib.sha256(record.read()).hexdigest()
    binpipe.write(f"{sys.argv[1]} {digest}".encode(), name="digest")
"""
WAITING = """
import time
from bagpipe import binpipe
for record in binpipe.read():
    time.sleep(600)
"""


def job(name: str, program: str = PROGRAM, **spark: object) -> k.Object:
    made = fleet.make_job(
        name,
        source={"files": [f"pvc://recordings/{fleet.FOLDER}/{n:03d}.bin" for n in range(CASES)]},
        spark=jobs.spark(1, 2) | {"pool": "warm"} | spark,
    )
    made["spec"]["stack"]["command"] = ["python3", "-c", program, name]
    return made


def pods(namespace: str, name: str) -> dict[str, str]:
    """UIDs of a job's pods that run, by their names."""
    found = k.items(namespace, "pods", "-l", f"sim.bagpipe.io/job={name}")
    living = [p for p in found if "deletionTimestamp" not in p["metadata"]]
    return {
        p["metadata"]["name"]: p["metadata"]["uid"]
        for p in living
        if p["status"]["phase"] == "Running"
    }


def check_results(namespace: str, name: str, status: k.Object) -> None:
    """The job's own results, and nothing that another job has left."""
    assert (status["phase"], status["verdict"]) == ("Complete", "Passed"), json.dumps(status)
    left = fleet.left_on_claim(namespace, status["results"])
    uid = k.get(namespace, "simjob", name)["metadata"]["uid"]
    assert uid in status["results"]
    counts = left.manifest["counts"]
    assert counts["planned"] == counts["passed"] == len(left.rows) == CASES
    wanted = {f"{name} {hashlib.sha256(fleet.content(n)).hexdigest()}" for n in range(CASES)}
    assert set(left.kept.values()) == wanted
    images = left.manifest["provenance"]["images"]
    digests = {image["container"]: image["digest"] for image in images}
    assert {"spark", "stack"} <= digests.keys()


def test_three_jobs_in_the_pods_of_the_first(namespace: str) -> None:
    fleet.put_files(namespace)
    with jobs.applied(namespace, job("warm-one")), jobs.applied(namespace, job("warm-two")) as two:
        first, second = (
            jobs.ended(namespace, name, 300)["status"] for name in ("warm-one", "warm-two")
        )
        # Made at once, each has pods of its own: there was nothing to take over.
        assert first["pool"]["reason"] == second["pool"]["reason"] == "NoneWaits"
        check_results(namespace, "warm-one", first)
        check_results(namespace, "warm-two", second)
        before = pods(namespace, two) | pods(namespace, "warm-one")
        assert sum(name.endswith("-driver") for name in before) == 2, before
        with jobs.applied(namespace, job("warm-three")) as three:
            status = jobs.ended(namespace, three, 120)["status"]
            assert status["pool"]["state"] == "Taken", json.dumps(status)
            assert status["driver"] in {"warm-one-1-driver", "warm-two-1-driver"}
            assert status["pool"]["driver"] == before[status["driver"]]
            check_results(namespace, three, status)
            assert pods(namespace, three) == {}
            assert pods(namespace, two) | pods(namespace, "warm-one") == before
            with jobs.applied(namespace, job("warm-other", slots=1)) as other:
                status = jobs.ended(namespace, other, 300)["status"]
                assert status["pool"]["reason"] == "PodsDiffer"
                check_results(namespace, other, status)


def test_a_driver_ends_with_the_job_that_it_has_taken(namespace: str) -> None:
    """Its pods would not go with it: they were made for another job."""
    fleet.put_files(namespace)
    with jobs.applied(namespace, job("home")) as home:
        jobs.ended(namespace, home, 300)
        before = pods(namespace, home)
        with jobs.applied(namespace, job("guest", WAITING)) as guest:
            k.await_that(
                "cases of the guest",
                lambda: (
                    k.get(namespace, "simjob", guest)
                    .get("status", {})
                    .get("cases", {})
                    .get("running")
                ),
                120,
            )
            taken = k.get(namespace, "simjob", guest)["status"]["pool"]
            assert (taken["state"], taken["job"]) == ("Taken", home)
        k.await_that("the driver's end", lambda: not pods(namespace, home), 120)
    assert len(before) == 2
