"""Stuck jobs on a real API server: what it and its controllers say reaches the status.

The operator runs with the chart's rights only. The kubelet is a fake; quota, limits, evictions,
claims and the Events' selectors are Kubernetes' own.
"""

import json
import signal
import time
from collections import Counter

import pytest

from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.fake_driver import fake_driver
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.integration.control_plane.observe import is_admitted, limit_pods
from tests.integration.control_plane.operators.dying_operator import DIES, PROGRAM
from tests.unit.operator.builders import account, make_job
from tests.waiting import PATIENCE, wait_until


def a_job(name: str, memory: str = "1Gi") -> Object:
    resources = {"cpu": "1", "memory": memory}
    return make_job(name).with_spec("spark.executor.resources", resources).as_written()


def condition(admin: Client, namespace: str, name: str, kind: str) -> Object:
    status = admin.get(jobs(namespace, name)).get("status", {})
    return next((c for c in status.get("conditions", []) if c["type"] == kind), {})


def await_reason(
    admin: Client, namespace: str, name: str, reason: str, kind: str = "Running"
) -> str:
    """The condition's message once it has the reason."""
    found: Object = {}

    def is_reported() -> bool:
        found.clear()
        found.update(condition(admin, namespace, name, kind))
        return found.get("reason") == reason

    wait_until(is_reported, PATIENCE, f"{name} did not become {reason}")
    return str(found["message"])


def await_pod(admin: Client, namespace: str, name: str) -> Object:
    path = core(namespace, "pods", name)
    wait_until(lambda: admin.exists(path), PATIENCE, f"{name} was not created")
    return admin.get(path)


def warnings(admin: Client, namespace: str, reason: str) -> int:
    """How many Warnings of a reason there are, once there is one: it comes after the status."""

    def count() -> int:
        found = admin.items(core(namespace, "events"))
        return sum(e["reason"] == reason and e["type"] == "Warning" for e in found)

    wait_until(lambda: count() > 0, PATIENCE, f"there is no Event of {reason}")
    return count()


def test_no_quota_for_executors(
    admin: Client, namespace: str, kubelet: FakeKubelet, operator_process: StartOperator
) -> None:
    quota = limit_pods(admin, namespace, "small", 1)
    operator_process()
    admin.create(jobs(namespace), a_job("x"))
    await_pod(admin, namespace, "x-1-driver")
    with fake_driver(account(cases={"planned": 4, "running": 0})) as driver:
        kubelet.run(namespace, "x-1-driver", ip=driver.ip)
        message = await_reason(admin, namespace, "x", "QuotaExceeded")
        assert "exceeded quota: small, requested: pods=1, used: pods=1, limited: pods=1" in message
        assert len(admin.items(core(namespace, "pods"))) == 1, "the dry run has created a pod"
        admin.merge(quota, {"spec": {"hard": {"pods": "9"}}})
        await_reason(admin, namespace, "x", "ExecutorsPending")
    assert warnings(admin, namespace, "QuotaExceeded") == 1


def test_no_quota_for_the_driver(
    admin: Client, namespace: str, operator_process: StartOperator
) -> None:
    quota = limit_pods(admin, namespace, "none", 0)
    operator_process()
    admin.create(jobs(namespace), a_job("x"))
    await_reason(admin, namespace, "x", "QuotaExceeded", "Accepted")
    admin.merge(quota, {"spec": {"hard": {"pods": "9"}}})
    await_reason(admin, namespace, "x", "DriverCreated", "Accepted")


def test_executors_that_a_limit_refuses(
    admin: Client, namespace: str, kubelet: FakeKubelet, operator_process: StartOperator
) -> None:
    """A limit that came after the driver; one that was there before lets no driver begin."""
    limit = {"type": "Container", "max": {"memory": "2Gi"}}
    limits = {"metadata": {"name": "m"}, "spec": {"limits": [limit]}}
    operator_process()
    admin.create(jobs(namespace), a_job("x", memory="3Gi"))
    await_pod(admin, namespace, "x-1-driver")
    admin.create(core(namespace, "limitranges"), limits)
    # The API server learns of a new limit from a watch.
    large = {"name": "c", "image": "i", "resources": {"limits": {"memory": "3Gi"}}}
    probe = {"metadata": {"name": "probe"}, "spec": {"containers": [large]}}
    words = "maximum memory usage per Container"
    wait_until(lambda: not is_admitted(admin, namespace, probe, words), PATIENCE, "no limit")
    admin.create(jobs(namespace), a_job("y", memory="3Gi"))
    message = await_reason(admin, namespace, "y", "CreationRefused", "Accepted")
    assert "maximum memory usage per Container is 2Gi, but limit is 3Gi" in message
    assert not admin.exists(core(namespace, "pods", "y-1-driver"))
    with fake_driver(account(cases={"planned": 4, "running": 0})) as driver:
        kubelet.run(namespace, "x-1-driver", ip=driver.ip)
        message = await_reason(admin, namespace, "x", "ExecutorsRefused")
    assert "maximum memory usage per Container is 2Gi, but limit is 3Gi" in message


def test_a_claim_that_nobody_provisions(
    admin: Client, namespace: str, operator_process: StartOperator
) -> None:
    for name in ("recordings", "results"):
        claim = {
            "metadata": {"name": name},
            "spec": {
                "accessModes": ["ReadWriteOnce"],
                "storageClassName": "absent",
                "resources": {"requests": {"storage": "1Gi"}},
            },
        }
        admin.create(core(namespace, "persistentvolumeclaims"), claim)
    operator_process()
    admin.create(jobs(namespace), a_job("x"))
    message = await_reason(admin, namespace, "x", "VolumePending")
    assert "PersistentVolumeClaim recordings, which is Pending" in message


def test_a_volume_that_does_not_mount(
    admin: Client, namespace: str, kubelet: FakeKubelet, operator_process: StartOperator
) -> None:
    """The Event is the kubelet's words; that the operator finds it is under test."""
    operator_process()
    admin.create(jobs(namespace), a_job("x"))
    pod = await_pod(admin, namespace, "x-1-driver")
    node = kubelet.bind(namespace, "x-1-driver")
    for uid, text in ((pod["metadata"]["uid"], "timed out"), ("another", "not this one")):
        admin.create(core(namespace, "events"), mount_failed(namespace, uid, text))
    message = await_reason(admin, namespace, "x", "VolumeNotMounted")
    assert message.endswith(f"on node {node}: timed out.")
    assert warnings(admin, namespace, "VolumeNotMounted") == 1


def mount_failed(namespace: str, uid: str, text: str) -> Object:
    moment = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    about = {"kind": "Pod", "namespace": namespace, "name": "x-1-driver", "uid": uid}
    return {
        "metadata": {"generateName": "x-1-driver.", "namespace": namespace},
        "involvedObject": about,
        "reason": "FailedMount",
        "message": text,
        "type": "Warning",
        "firstTimestamp": moment,
        "lastTimestamp": moment,
    }


@pytest.mark.usefixtures("bound_claims")
def test_a_driver_that_is_evicted(
    admin: Client, namespace: str, kubelet: FakeKubelet, operator_process: StartOperator
) -> None:
    operator_process()
    admin.create(jobs(namespace), a_job("x"))
    await_pod(admin, namespace, "x-1-driver")
    kubelet.bind(namespace, "x-1-driver")
    kubelet.run(namespace, "x-1-driver")
    await_reason(admin, namespace, "x", "Planning")
    eviction = {
        "apiVersion": "policy/v1",
        "kind": "Eviction",
        "metadata": {"name": "x-1-driver", "namespace": namespace},
    }
    admin.create(core(namespace, "pods", "x-1-driver") + "/eviction", eviction)
    message = await_reason(admin, namespace, "x", "DriverEvicted")
    assert "is being evicted through the eviction API" in message
    kubelet.remove(namespace, "x-1-driver")
    await_pod(admin, namespace, "x-2-driver")
    assert condition(admin, namespace, "x", "Running")["reason"] == "DriverEvicted"
    assert warnings(admin, namespace, "DriverEvicted") == 1


def own_events(admin: Client, namespace: str) -> Counter[str]:
    found = admin.items(core(namespace, "events"))
    return Counter(e["reason"] for e in found if e["involvedObject"]["kind"] == "SimulationJob")


@pytest.mark.usefixtures("bound_claims")
@pytest.mark.parametrize(
    "dies",
    [
        'before PATCH \\S+/status\\S* .*"reason": "{}"',
        'after PATCH \\S+/status\\S* .*"reason": "{}"',
        'after POST \\S+/events\\S* .*"reason": "{}"',
    ],
    ids=["before its status", "before its Event", "after its Event"],
)
def test_every_transition_once_under_an_operator_that_is_killed(
    admin: Client,
    namespace: str,
    kubelet: FakeKubelet,
    operator_process: StartOperator,
    dies: str,
) -> None:
    operator = operator_process(start=False)
    operator.server.command[-1:] = PROGRAM

    def begun_to_die_at(reason: str) -> None:
        operator.server.environment[DIES] = dies.format(reason)
        operator.start()

    def killed() -> None:
        wait_until(lambda: not operator.server.alive, PATIENCE, "there was no such write")
        assert operator.ended() == -signal.SIGKILL, operator.logged()[-2000:]
        operator.kill()

    begun_to_die_at("DriverCreated")
    admin.create(jobs(namespace), a_job("x"))
    killed()
    begun_to_die_at("DriverImageUnavailable")
    await_reason(admin, namespace, "x", "DriverCreated", "Accepted")
    await_pod(admin, namespace, "x-1-driver")
    kubelet.wait(namespace, "x-1-driver", "ErrImagePull")
    killed()
    begun_to_die_at("AllCasesRan")
    await_reason(admin, namespace, "x", "DriverImageUnavailable")
    done = json.loads(account("Complete", reason="AllCasesRan", message="4 of 4."))
    kubelet.end(namespace, "x-1-driver", message=json.dumps(done))
    killed()
    del operator.server.environment[DIES]
    operator.start()
    wanted = Counter(["DriverCreated", "DriverImageUnavailable", "CasesPlanned", "AllCasesRan"])
    wait_until(lambda: own_events(admin, namespace) >= wanted, PATIENCE, "an Event is missing")
    operator.kill()
    operator.start()
    worked = 'bagpipe_reconciles_total{result="done"}'
    wait_until(
        lambda: (operator.metric(worked) or 0) > 0, PATIENCE, "the job was not looked at again"
    )
    assert own_events(admin, namespace) == wanted
