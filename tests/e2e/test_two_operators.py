"""Two operators on the cluster: the one that leads is killed, the other goes on with its work."""

import os
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest
from embedded import faults

from tests.e2e import fleet, jobs
from tests.e2e import kubectl as k
from tests.e2e.installation import OPERATOR, SYSTEM, keep_values, upgrade

pytestmark = [pytest.mark.e2e, pytest.mark.slow]

TAKEOVER_SECONDS = 15.0
# Their drivers are too large for any node: as pods they cost nothing.
WAITING = [f"waits-{number:02}" for number in range(40)]
LATE = "waits-late"
CASES = 30
_LARGE = {"resources": {"cpu": "500", "memory": "1Gi"}}


@pytest.fixture(autouse=True)
def _two_replicas(tmp_path: Path) -> Iterator[None]:
    """Two pods of the operator that are ready; in the end as many as before."""
    if os.geteuid() or k.tool_environment()["KUBECONFIG"] != k.EMBEDDED_KUBECONFIG:
        pytest.skip("kills a process of the embedded cluster, which needs root")
    values = keep_values(tmp_path)
    upgrade(values, "--set", "operator.replicas=2")
    yield
    upgrade(values)


def running_job() -> k.Object:
    """30 cases of a second each, one at a time: they go on while nobody leads."""
    inputs = [f"pvc://recordings/{fleet.FOLDER}/0{tens}*.bin" for tens in range(CASES // 10)]
    spark = jobs.spark(1, 1)
    return fleet.make_job("runs", source={"files": inputs}, spark=spark)


def waiting_job(name: str) -> k.Object:
    job = fleet.make_job(name, spark={"executors": 1, "slots": 1, "driver": _LARGE})
    job["metadata"]["labels"] = {"waits": "yes"}
    return job


def lease() -> k.Object:
    """The Lease's spec."""
    spec: k.Object = k.get(SYSTEM, "lease", OPERATOR)["spec"]
    return spec


def pod_of(holder: str) -> str:
    """The pod of a name in the Lease, which ends in a number of the process's own."""
    return holder.partition("_")[0]


def kill_leader() -> str:
    """SIGKILL to the process that leads; gives its pod, whose container restarts."""
    name = pod_of(lease()["holderIdentity"])
    pod = k.get(SYSTEM, "pod", name)
    faults.kill_container(pod["spec"]["nodeName"], fleet.container_id(pod, "operator"))
    return name


def made(namespace: str) -> dict[str, str]:
    """Kind/name -> UID of all that operators have made for the waiting jobs."""
    selector = f"sim.bagpipe.io/job in ({','.join([*WAITING, LATE])})"
    found = k.items(namespace, "pods,configmaps", "-l", selector)
    return {f"{o['kind']}/{o['metadata']['name']}": o["metadata"]["uid"] for o in found}


def announced(namespace: str) -> Counter[str]:
    """How often an Event reported of each waiting job that it has a driver."""
    found = k.items(namespace, "events", "--field-selector", "reason=DriverCreated")
    about = Counter(event["involvedObject"]["name"] for event in found)
    return Counter({name: about[name] for name in (*WAITING, LATE)})


def passed(namespace: str, name: str) -> int:
    status = k.get(namespace, "simjob", name).get("status", {})
    found: int = status.get("cases", {}).get("passed", 0)
    return found


@dataclass(frozen=True)
class Killed:
    """An operator that led: its pod, when it was killed, and what was there then."""

    leader: str
    at: float
    made: dict[str, str]


def kill_in_the_middle(namespace: str) -> Killed:
    """Kill the leader while jobs arrive; one more comes when nobody leads."""
    many = {"apiVersion": "v1", "kind": "List", "items": [waiting_job(n) for n in WAITING]}
    with ThreadPoolExecutor(1) as pool:
        arriving = pool.submit(jobs.apply, namespace, many)
        k.await_that("some drivers", lambda: len(made(namespace)) >= 4, 60, every=0.1)
        killed = Killed(kill_leader(), time.monotonic(), made(namespace))
        jobs.apply(namespace, waiting_job(LATE))
        arriving.result()
    return killed


def assert_made_once(namespace: str, before: dict[str, str]) -> None:
    names = [*WAITING, LATE]
    k.await_that("all to be announced", lambda: all(announced(namespace).values()), 60)
    assert announced(namespace) == Counter(names)
    found = made(namespace)
    kinds = {"Pod": "{}-1-driver", "ConfigMap": "{}-1"}
    # A ConfigMap's name ends with what is in it.
    stems = [key.rpartition("-")[0] if key.startswith("ConfigMap/") else key for key in found]
    assert sorted(stems) == sorted(
        f"{kind}/{n.format(name)}" for kind, n in kinds.items() for name in names
    )
    assert before.items() <= found.items(), "something was created again"


def test_the_other_goes_on_within_15_seconds_and_makes_nothing_twice(namespace: str) -> None:
    fleet.put_files(namespace)
    with jobs.applied(namespace, running_job()) as name:
        k.await_that("its first cases", lambda: passed(namespace, name) >= 3, 240)
        try:
            killed = kill_in_the_middle(namespace)
            k.await_that(
                "the other operator to take up a new job",
                lambda: f"Pod/{LATE}-1-driver" in made(namespace), 60, every=0.2,
            )  # fmt: skip
            took = time.monotonic() - killed.at
            print(f"took up a new job {took:.1f} s after the kill, which {len(killed.made)} saw")
            assert took < TAKEOVER_SECONDS
            assert pod_of(lease()["holderIdentity"]) != killed.leader
            assert_made_once(namespace, killed.made)
        finally:
            k.kubectl("-n", namespace, "delete", "simjob", "-l", "waits=yes", "--timeout=100s")
        ended = jobs.ended(namespace, name, 240)["status"]
        assert (ended["phase"], ended["cases"]["passed"]) == ("Complete", CASES)
        assert (ended["attempt"], ended["lostDrivers"]) == (1, 0)
