"""Whole jobs in a Kueue queue, on a real API server, with the chart's rights.

Kueue itself is a declared fake: it can't be built from what this project may fetch. Its CRDs
here have its names and keep every field, and the test writes into a Workload's status what a real
one was seen to write (docs/limits.md says with which it was tried by hand).
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.integration.control_plane.observe import a_job
from tests.integration.control_plane.operator_process import OperatorProcess
from tests.integration.control_plane.operators.test_life import Jobs
from tests.integration.control_plane.release import CLUSTER_WIDE, apply_chart, installed
from tests.integration.control_plane.server import ControlPlane
from tests.unit.operator.builders import account
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.integration

GROUP = "kueue.x-k8s.io"
KUEUE = f"/apis/{GROUP}/v1beta2"
CRDS = "/apis/apiextensions.k8s.io/v1/customresourcedefinitions"
KINDS = {
    "workloads": ("Workload", "Namespaced"),
    "resourceflavors": ("ResourceFlavor", "Cluster"),
    "workloadpriorityclasses": ("WorkloadPriorityClass", "Cluster"),
}
SINCE = "2026-11-20T04:00:00Z"


def definition(plural: str) -> Object:
    kind, scope = KINDS[plural]
    anything = {"type": "object", "x-kubernetes-preserve-unknown-fields": True}
    version = {
        "name": "v1beta2", "served": True, "storage": True,
        "subresources": {"status": {}} if plural == "workloads" else {},
        "schema": {"openAPIV3Schema": anything},
    }  # fmt: skip
    return {
        "metadata": {
            "name": f"{plural}.{GROUP}",
            # Without it the API server refuses CRDs below k8s.io.
            "annotations": {"api-approved.kubernetes.io": "unapproved, for a test"},
        },
        "spec": {
            "group": GROUP, "scope": scope, "versions": [version],
            "names": {"plural": plural, "singular": kind.lower(), "kind": kind},
        },
    }  # fmt: skip


@pytest.fixture(scope="module")
def kueue(admin: Client) -> Iterator[Client]:
    """An API server with Kueue's API, a flavor and a priority class."""
    for plural in KINDS:
        admin.create(CRDS, definition(plural))
    wait_until(
        lambda: all(admin.exists(f"{KUEUE}/{each}") for each in KINDS),
        PATIENCE,
        "CRDs are not served",
    )
    spot = {"nodeLabels": {"pool": "spot"}, "tolerations": [{"key": "spot", "operator": "Exists"}]}
    _create(admin, "resourceflavors", {"metadata": {"name": "spot"}, "spec": spot})
    _create(admin, "workloadpriorityclasses", {"metadata": {"name": "urgent"}, "value": 700})
    yield admin
    for plural in KINDS:
        admin.delete(f"{CRDS}/{plural}.{GROUP}")


def _create(admin: Client, plural: str, obj: Object) -> None:
    kind = KINDS[plural][0]
    admin.create(f"{KUEUE}/{plural}", {"apiVersion": f"{GROUP}/v1beta2", "kind": kind} | obj)


class Queue:
    """What Kueue would do with the Workloads of one namespace."""

    def __init__(self, admin: Client, namespace: str) -> None:
        self._admin = admin
        self._path = f"{KUEUE}/namespaces/{namespace}/workloads"

    def workload(self, job: str) -> Object:
        """The job's Workload, once there is one."""
        found: list[Object] = []

        def there() -> bool:
            label = f"?labelSelector=sim.bagpipe.io/job={job}"
            found[:] = self._admin.items(self._path + label)
            return len(found) == 1

        wait_until(there, PATIENCE, f"{job} has no Workload")
        return found[0]

    def stated(self, job: str, type_: str) -> str:
        """A condition of the job's Workload as status/reason; empty before it is written."""
        conditions = (self.workload(job).get("status") or {}).get("conditions", [])
        found = [f"{c['status']}/{c['reason']}" for c in conditions if c["type"] == type_]
        return found[0] if found else ""

    def await_reported(self, job: str, type_: str, expected: str) -> None:
        wait_until(
            lambda: self.stated(job, type_) == expected, PATIENCE, f"{type_} is not {expected}"
        )

    def admit(self, job: str) -> None:
        sets = [
            {"name": each["name"], "count": each["count"], "flavors": {"cpu": "spot"}}
            for each in self.workload(job)["spec"]["podSets"]
        ]
        self._write(
            job,
            {"QuotaReserved": ("True", "QuotaReserved"), "Admitted": ("True", "Admitted"),
             "Evicted": ("False", "QuotaReserved")},
            {"admission": {"clusterQueue": "lab", "podSetAssignments": sets}},
        )  # fmt: skip

    def evict(self, job: str) -> None:
        self._write(job, {"Evicted": ("True", "Preempted")}, {})

    def _write(self, job: str, conditions: dict[str, tuple[str, str]], status: Object) -> None:
        workload = self.workload(job)
        before = (workload.get("status") or {}).get("conditions", [])
        kept = [each for each in before if each["type"] not in conditions]
        new = [
            {"type": type_, "status": true, "reason": reason, "message": "as a test wants it",
             "lastTransitionTime": SINCE}
            for type_, (true, reason) in conditions.items()
        ]  # fmt: skip
        path = f"{self._path}/{workload['metadata']['name']}/status"
        self._admin.merge(path, {"status": {"conditions": [*kept, *new]} | status})


VALUES = [*CLUSTER_WIDE, "kueue.enabled=true"]


@pytest.fixture
def operator(
    kueue: Client, control_plane: ControlPlane, tmp_path: Path
) -> Iterator[OperatorProcess]:
    """An operator with the rights of a chart that has kueue.enabled."""
    with installed(control_plane, tmp_path, VALUES, watched="") as release:
        made = apply_chart(kueue, release.namespace, ["kueue-rights.yaml"], VALUES)
        process = OperatorProcess(
            release.kubeconfig, tmp_path / "operator.log",
            {"BAGPIPE_LEASE_NAMESPACE": release.namespace, "BAGPIPE_KUEUE": "true"},
            release.forget_lease,
        )  # fmt: skip
        yield process.start()
        process.kill()
        for path in made:
            kueue.delete(path)


def test_a_job_runs_when_its_queue_admits_it_and_rests_when_it_does_not(
    admin: Client, namespace: str, kubelet: FakeKubelet, operator: OperatorProcess
) -> None:
    world, queue = Jobs(admin, namespace), Queue(admin, namespace)
    world.create("lane", queueName="nightly", spark={"executors": 3})
    world.await_reported("lane", "Suspended", "True/Queued")
    sets = queue.workload("lane")["spec"]["podSets"]
    assert [(each["name"], each["count"]) for each in sets] == [("driver", 1), ("executors", 3)]
    assert world.pods() == []

    queue.admit("lane")
    world.await_reported("lane", "Suspended", "False/Admitted")
    world.await_pods("lane-1-driver")
    pod = admin.get(core(namespace, "pods", "lane-1-driver"))
    assert pod["spec"]["nodeSelector"] == {"kubernetes.io/arch": "amd64", "pool": "spot"}
    assert f"{GROUP}/queue-name" not in pod["metadata"]["labels"]

    # On a node it takes its time to go.
    kubelet.bind(namespace, "lane-1-driver")
    queue.evict("lane")
    world.await_reported("lane", "Suspended", "False/Suspending")
    assert queue.stated("lane", "QuotaReserved") == "True/QuotaReserved"
    kubelet.remove(namespace, "lane-1-driver")
    queue.await_reported("lane", "QuotaReserved", "False/Pending")
    assert queue.stated("lane", "Requeued") == "True/Preempted"
    assert queue.stated("lane", "Admitted") == "False/NoReservation"
    world.await_reported("lane", "Suspended", "True/Queued")

    # Killed between admission and the next driver, it is as if nothing had been.
    operator.kill()
    queue.admit("lane")
    operator.start()
    world.await_pods("lane-2-driver")
    kubelet.end(namespace, "lane-2-driver", 0, account("Complete", verdict="Passed"))
    queue.await_reported("lane", "Finished", "True/Succeeded")
    assert world.get("lane")["status"]["lostDrivers"] == 0


@pytest.mark.usefixtures("operator")
def test_who_suspends_a_queued_job_takes_it_out_of_the_queue(admin: Client, namespace: str) -> None:
    world, queue = Jobs(admin, namespace), Queue(admin, namespace)
    job = a_job("lane")
    job["metadata"]["labels"] = {f"{GROUP}/priority-class": "urgent"}
    job["spec"]["queueName"] = "nightly"
    admin.create(jobs(namespace), job)
    assert queue.workload("lane")["spec"]["priority"] == 700
    first = queue.workload("lane")["metadata"]["uid"]
    world.edit("lane", suspend=True)
    world.await_reported("lane", "Suspended", "True/JobSuspended")
    path = f"{KUEUE}/namespaces/{namespace}/workloads"
    wait_until(lambda: admin.items(path) == [], PATIENCE, "its Workload stays")
    world.edit("lane", suspend=False)
    assert queue.workload("lane")["metadata"]["uid"] != first
    world.await_reported("lane", "Suspended", "True/Queued")


def test_an_operator_that_wants_kueue_waits_for_it_and_says_so(
    operator_process: StartOperator,
) -> None:
    process = operator_process(start=False, BAGPIPE_KUEUE="true")
    process.server.start()
    found = "what the operator watches can't be watched yet: 403"
    wait_until(lambda: found in process.logged(), PATIENCE, "it does not say what it misses")
    assert process.ask("/readyz")[0] == 503
    assert "workloads" in process.logged()
