"""Every way of being stuck, made real: its reason is in the status within ten seconds.

The ten seconds count from the moment at which Kubernetes knew to that at which the status was
written, by the API server's own timestamps: a test that is held up does not count. These have whole
seconds, so a measured time may be up to one second off.
"""

import json
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from typing import Any

import pytest

from tests.e2e import fleet, jobs
from tests.e2e import kubectl as k
from tests.e2e.quotas import quota, refusals

pytestmark = [pytest.mark.e2e, pytest.mark.alone, pytest.mark.usefixtures("recordings")]

WITHIN_SECONDS = 10.0
# Each process is small, so the kernel takes the container's first one, which is marked for it.
HOG = """
import os, time
open("/proc/1/oom_score_adj", "w").write("1000")
for _ in range(600):
    if os.fork() == 0:
        held = bytearray(os.urandom(1 << 20) * 6)
        time.sleep(600)
time.sleep(30)
"""


def condition(namespace: str, name: str, kind: str) -> k.Object:
    """A job's condition; empty before it was written."""
    return condition_of(k.get(namespace, "simjob", name), kind)


def condition_of(job: k.Object, kind: str) -> k.Object:
    found = [c for c in job.get("status", {}).get("conditions", []) if c["type"] == kind]
    return found[0] if found else {}


def seen(namespace: str, name: str, reason: str, seconds: float, kind: str = "Running") -> datetime:
    """When the status was last written before the condition was first seen with that reason."""

    def look() -> k.Object | None:
        job = k.get(namespace, "simjob", name, "--show-managed-fields")
        return job if condition_of(job, kind).get("reason") == reason else None

    job = k.await_that(f"{kind} of {name} to be {reason}", look, seconds, every=0.2)
    writers = job["metadata"]["managedFields"]
    return max(moment(each["time"]) for each in writers if each.get("subresource") == "status")


def moment(text: str) -> datetime:
    return datetime.fromisoformat(text)


def pods(namespace: str, name: str, role: str) -> list[k.Object]:
    selector = f"sim.bagpipe.io/job={name},sim.bagpipe.io/role={role}"
    return k.items(namespace, "pods", "-l", selector)


def events(namespace: str, which: str) -> list[k.Object]:
    """The Events that a selector finds, once there is one: they come after what they report."""
    listed = (namespace, "events", "--field-selector", which)
    return k.await_that(f"an Event with {which}", lambda: k.items(*listed), 60)


def first_event(namespace: str, uid: str, reason: str) -> datetime:
    """When the first Event of a reason was reported about an object."""
    found = events(namespace, f"involvedObject.uid={uid},reason={reason}")
    return min(moment(e["firstTimestamp"] or e["eventTime"]) for e in found)


def pod_condition(pod: k.Object, kind: str) -> datetime:
    found = next(c for c in pod["status"]["conditions"] if c["type"] == kind)
    return moment(found["lastTransitionTime"])


def assert_in_time(what: str, knew: datetime, reported: datetime) -> None:
    seconds = (reported - knew).total_seconds()
    print(f"{what}: reported {seconds:.1f} s after Kubernetes knew")
    assert seconds <= WITHIN_SECONDS


def assert_reported_once(namespace: str, name: str, reason: str) -> None:
    uid = k.get(namespace, "simjob", name)["metadata"]["uid"]
    found = events(namespace, f"involvedObject.uid={uid},reason={reason},type=Warning")
    assert [event["count"] for event in found] == [1]


def only(found: list[k.Object]) -> k.Object:
    (one,) = found
    return one


def test_an_unknown_image(namespace: str) -> None:
    job = jobs.make_job("no-image-time", stack={"image": "bagpipe.local/none:9"})
    with jobs.applied(namespace, job) as name:
        reported = seen(namespace, name, "StackImageUnavailable", 240)
        pod = only(pods(namespace, name, "executor"))
        assert_in_time("image", first_event(namespace, pod["metadata"]["uid"], "Failed"), reported)
        assert_reported_once(namespace, name, "StackImageUnavailable")


def test_a_missing_claim(namespace: str) -> None:
    job = jobs.make_job("no-claim", output={"uri": "pvc://absent/results"})
    with jobs.applied(namespace, job) as name:
        reported = seen(namespace, name, "VolumeMissing", 240)
        pod = only(pods(namespace, name, "driver"))
        assert_in_time("claim", pod_condition(pod, "PodScheduled"), reported)
        assert_reported_once(namespace, name, "VolumeMissing")


def test_a_missing_secret(namespace: str) -> None:
    job = jobs.make_job("no-secret")
    job["spec"]["storage"] = {"secrets": ["absent"]}
    with jobs.applied(namespace, job) as name:
        reported = seen(namespace, name, "SecretMissing", 240)
        pod = only(pods(namespace, name, "driver"))
        assert_in_time("secret", first_event(namespace, pod["metadata"]["uid"], "Failed"), reported)
        assert "absent" in condition(namespace, name, "Running")["message"]
        assert_reported_once(namespace, name, "SecretMissing")


def test_a_claim_that_is_not_bound(namespace: str) -> None:
    claim = {
        "apiVersion": "v1",
        "kind": "PersistentVolumeClaim",
        "metadata": {"name": "unbound"},
        "spec": {
            "accessModes": ["ReadWriteOnce"],
            "storageClassName": "absent",
            "resources": {"requests": {"storage": "1Gi"}},
        },
    }
    k.kubectl("-n", namespace, "apply", "-f", "-", given=json.dumps(claim))
    with jobs.applied(
        namespace, jobs.make_job("unbound", output={"uri": "pvc://unbound/results"})
    ) as name:
        reported = seen(namespace, name, "VolumePending", 240)
        pod = only(pods(namespace, name, "driver"))
        assert_in_time("unbound claim", pod_condition(pod, "PodScheduled"), reported)
        assert_reported_once(namespace, name, "VolumePending")


def test_a_volume_that_does_not_mount(namespace: str) -> None:
    """A node's folder that is not there, behind a claim that is bound."""
    size = {"storage": "1Gi"}
    volume = {
        "apiVersion": "v1",
        "kind": "PersistentVolume",
        "metadata": {"name": f"{namespace}-unmountable"},
        "spec": {
            "capacity": size,
            "accessModes": ["ReadWriteOnce"],
            "persistentVolumeReclaimPolicy": "Retain",
            "storageClassName": "",
            "hostPath": {"path": "/no/such/folder", "type": "Directory"},
            "claimRef": {"namespace": namespace, "name": "unmountable"},
        },
    }
    claim = {
        "apiVersion": "v1",
        "kind": "PersistentVolumeClaim",
        "metadata": {"name": "unmountable", "namespace": namespace},
        "spec": {
            "accessModes": ["ReadWriteOnce"],
            "storageClassName": "",
            "volumeName": f"{namespace}-unmountable",
            "resources": {"requests": size},
        },
    }
    k.kubectl("apply", "-f", "-", given=json.dumps(volume))
    k.kubectl("apply", "-f", "-", given=json.dumps(claim))
    job = jobs.make_job("unmountable", output={"uri": "pvc://unmountable/results"})
    try:
        with jobs.applied(namespace, job) as name:
            reported = seen(namespace, name, "VolumeNotMounted", 240)
            pod = only(pods(namespace, name, "driver"))
            knew = first_event(namespace, pod["metadata"]["uid"], "FailedMount")
            assert_in_time("mount", knew, reported)
            assert_reported_once(namespace, name, "VolumeNotMounted")
    finally:
        k.kubectl("-n", namespace, "delete", "pvc", "unmountable")
        k.kubectl("delete", "pv", f"{namespace}-unmountable")


def test_no_node_and_then_no_config_map(namespace: str) -> None:
    # A label that no node has yet: pods of other tests go on being placed.
    room = f"{namespace}/room"
    job = jobs.make_job("unplaced")
    job["spec"]["spark"]["driver"] |= {"pod": {"nodeSelector": {room: "yes"}}}
    nodes = [node["metadata"]["name"] for node in k.items("default", "nodes")]
    try:
        jobs.apply(namespace, job)
        reported = seen(namespace, "unplaced", "Unschedulable", 240)
        pod = only(pods(namespace, "unplaced", "driver"))
        assert_in_time("no node", pod_condition(pod, "PodScheduled"), reported)
        volumes = pod["spec"]["volumes"]
        (config,) = [v["configMap"]["name"] for v in volumes if v["name"] == "config"]
        k.kubectl("-n", namespace, "delete", "configmap", config)
        k.kubectl("label", "nodes", *nodes, f"{room}=yes")
        reported = seen(namespace, "unplaced", "ConfigMapMissing", 240)
        knew = first_event(namespace, pod["metadata"]["uid"], "FailedMount")
        assert_in_time("ConfigMap", knew, reported)
        assert_reported_once(namespace, "unplaced", "ConfigMapMissing")
    finally:
        k.kubectl("label", "nodes", *nodes, f"{room}-")
        jobs.delete(namespace, "unplaced")


def test_executors_that_no_node_has_room_for(namespace: str) -> None:
    large = {"resources": {"cpu": "500", "memory": "1Gi"}}
    spark = jobs.spark(1, 1) | {"executor": large}
    with jobs.applied(namespace, jobs.make_job("too-large", spark=spark)) as name:
        reported = seen(namespace, name, "Unschedulable", 240)
        pod = only(pods(namespace, name, "executor"))
        assert_in_time("no room", pod_condition(pod, "PodScheduled"), reported)


def test_no_quota_for_the_driver(namespace: str) -> None:
    with quota(namespace, 0), jobs.applied(namespace, jobs.make_job("no-driver")) as name:
        reported = seen(namespace, name, "QuotaExceeded", 240, "Accepted")
        job = k.get(namespace, "simjob", name)
        assert_in_time("driver's quota", moment(job["metadata"]["creationTimestamp"]), reported)


@pytest.mark.slow
def test_no_quota_for_executors(namespace: str) -> None:
    """Refused more often than Spark would tolerate by its default, and as if nothing had been."""
    name = "no-executors"
    fleet.put_files(namespace)
    spark = jobs.spark(1, 1)
    # No replay, which a busy machine could make lossy after so long a wait.
    inputs = {"files": [f"pvc://recordings/{fleet.FOLDER}/000.bin"]}
    try:
        with quota(namespace, 1):
            jobs.apply(namespace, fleet.make_job(name, source=inputs, spark=spark))
            reported = seen(namespace, name, "QuotaExceeded", 240)
            pod = only(pods(namespace, name, "driver"))["metadata"]["name"]

            def refused() -> list[str]:
                return refusals(k.kubectl("-n", namespace, "logs", pod, "--timestamps"))

            first = k.await_that("Spark to be refused an executor", refused, 120)[-1]
            knew = moment(first.split()[0][:26] + "+00:00")
            assert_in_time("executors' quota", knew, reported)
            assert_reported_once(namespace, name, "QuotaExceeded")
            # Spark asks once a second, and with its default of failures it gives up soon.
            k.await_that("more refusals", lambda: len(refused()) > 25, 120, every=2.0)
        job = jobs.ended(namespace, name, 240)
        assert job["status"]["phase"] == "Complete", jobs.condition(job, "Failed")
        # Without another driver.
        assert (job["status"]["attempt"], job["status"].get("lostDrivers", 0)) == (1, 0)
    finally:
        jobs.delete(namespace, name)


def long_job(name: str) -> k.Object:
    """200 cases of five seconds each, one at a time: long enough for all faults."""
    return fleet.make_job(
        name,
        f"pvc://results/{name}",
        spark=jobs.spark(1, 1),
        stack={
            "engine": "exec",
            "image": "bagpipe.local/spark:0.2.0",
            "command": ["python3", "-c", fleet.PROGRAM.replace("sleep(1.0)", "sleep(5.0)")],
            "resources": {
                "requests": {"cpu": "50m", "memory": "512Mi"},
                "limits": {"memory": "512Mi"},
            },
        },
    )


@pytest.fixture(scope="module")
def running(namespace: str) -> Iterator[str]:
    """A long job that has begun; its faults are made one after the other."""
    fleet.put_files(namespace)
    with jobs.applied(namespace, long_job("long")) as name:
        seen(namespace, name, "CasesRunning", 240)
        yield name


def at_work(namespace: str, name: str, role: str) -> k.Object:
    """The job's pod of a role, once it runs and nobody has deleted it."""

    def look() -> k.Object | None:
        alive = [p for p in fleet.pods(namespace, name, role)
                 if "deletionTimestamp" not in p["metadata"]]  # fmt: skip
        return alive[0] if len(alive) == 1 else None

    return k.await_that(f"a {role} of {name} to run", look, 240)


def executor(namespace: str, name: str) -> k.Object:
    """The executor, once no trouble of another is reported any more."""
    seen(namespace, name, "CasesRunning", 240)
    return at_work(namespace, name, "executor")


def fill_memory(namespace: str, pod: str, container: str) -> None:
    """Real lack of memory: the kernel ends the container's first process for it."""
    with suppress(k.KubectlError):  # the container goes, and with it the command
        k.kubectl("-n", namespace, "exec", pod, "-c", container, "--", "python3", "-c", HOG,
                  seconds=60)  # fmt: skip


def ended_at(pod: k.Object, container: str) -> datetime:
    """When a container was ended, now or the last time."""
    status = pod["status"]
    listed = [*status.get("initContainerStatuses", []), *status["containerStatuses"]]
    found = next(c for c in listed if c["name"] == container)
    state: dict[str, Any] = found["state"].get("terminated") or found["lastState"]["terminated"]
    assert state["reason"] == "OOMKilled", state
    return moment(state["finishedAt"])


def evict(namespace: str, pod: str) -> datetime:
    """What `kubectl drain` asks for."""
    body = {
        "apiVersion": "policy/v1",
        "kind": "Eviction",
        "metadata": {"name": pod, "namespace": namespace},
    }
    path = f"/api/v1/namespaces/{namespace}/pods/{pod}/eviction"
    k.kubectl("create", "--raw", path, "-f", "-", given=json.dumps(body))
    return datetime.now(UTC)


# An executor's trouble is reported for a minute; a driver's end, which follows here, cuts it short.


@pytest.mark.slow
def test_a_stack_that_takes_too_much_memory(namespace: str, running: str) -> None:
    pod = executor(namespace, running)["metadata"]["name"]
    fill_memory(namespace, pod, "stack")
    reported = seen(namespace, running, "ExecutorOutOfMemory", 30)
    knew = ended_at(k.get(namespace, "pod", pod), "stack")
    assert_in_time("stack's memory", knew, reported)
    assert "container stack" in condition(namespace, running, "Running")["message"].lower()
    assert_reported_once(namespace, running, "ExecutorOutOfMemory")


@pytest.mark.slow
def test_a_driver_that_is_evicted(namespace: str, running: str) -> None:
    pod = at_work(namespace, running, "driver")["metadata"]["name"]
    knew = evict(namespace, pod)
    reported = seen(namespace, running, "DriverEvicted", 240)
    # The pod's grace period is Kubernetes' own; the driver's Java ends at once.
    assert_in_time("driver evicted", knew, reported)
    assert_reported_once(namespace, running, "DriverEvicted")


@pytest.mark.slow
def test_an_executor_that_takes_too_much_memory(namespace: str, running: str) -> None:
    pod = executor(namespace, running)
    begun = datetime.now(UTC)
    fill_memory(namespace, pod["metadata"]["name"], "spark")
    reported = seen(namespace, running, "ExecutorOutOfMemory", 30)
    # Spark deletes the pod, and with it the moment; the memory was full some time after this.
    assert_in_time("executor's memory, and filling it", begun, reported)


@pytest.mark.slow
def test_a_driver_that_takes_too_much_memory(namespace: str, running: str) -> None:
    pod = at_work(namespace, running, "driver")["metadata"]["name"]
    fill_memory(namespace, pod, "driver")
    reported = seen(namespace, running, "DriverOutOfMemory", 240)
    assert_in_time("driver's memory", ended_at(k.get(namespace, "pod", pod), "driver"), reported)
    assert_reported_once(namespace, running, "DriverOutOfMemory")


@pytest.mark.slow
def test_an_executor_that_is_evicted(namespace: str, running: str) -> None:
    pod = executor(namespace, running)["metadata"]["name"]
    knew = evict(namespace, pod)
    assert_in_time("executor evicted", knew, seen(namespace, running, "ExecutorEvicted", 30))
