"""Whoever has Kubernetes' role `edit` may write Events: about a pod that waits, the operator reads
them."""

import time
from pathlib import Path

from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.integration.control_plane.observe import a_job, await_lead, statuses
from tests.waiting import PATIENCE, wait_until

# It has 70 when it starts; these Events, read at once, take 300 more.
MOST_MIB = 200
LARGE_EVENTS = 60


def event(namespace: str, uid: str, name: str, seconds: float, **more: object) -> Object:
    moment = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(time.time() + seconds))
    about = {"kind": "Pod", "namespace": namespace, "name": "x-1-driver", "uid": uid}
    if path := more.pop("fieldPath", None):
        about["fieldPath"] = str(path)
    return {
        "metadata": {"name": name, "namespace": namespace}, "involvedObject": about,
        "type": "Warning", "firstTimestamp": moment, "lastTimestamp": moment, **more,
    }  # fmt: skip


def peak_mib(process: int) -> int:
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM:")).split()[1]) // 1024


def test_events_of_a_megabyte_take_neither_the_operator_s_memory_nor_its_time(
    admin: Client, namespace: str, kubelet: FakeKubelet, operator_process: StartOperator
) -> None:
    operator = operator_process()
    await_lead(operator)
    admin.create(jobs(namespace), a_job("x"))
    pods, events = core(namespace, "pods", "x-1-driver"), core(namespace, "events")
    wait_until(lambda: admin.exists(pods), PATIENCE, "no driver")
    uid = admin.get(pods)["metadata"]["uid"]
    for number in range(LARGE_EVENTS):
        large = event(namespace, uid, f"m-{number:02}", 0, reason="Other", message="y" * 1_400_000)
        admin.create(events, large)
    admin.create(events, event(namespace, uid, "n", 0, reason="FailedMount", message="no volume"))
    kubelet.bind(namespace, "x-1-driver")
    kubelet.wait(namespace, "x-1-driver", "ContainerCreating")

    def reason() -> str:
        found = statuses(admin, namespace)["x"].get("conditions") or []
        return next((str(c["reason"]) for c in found if c["type"] == "Running"), "")

    wait_until(lambda: reason() == "VolumeNotMounted", PATIENCE, "the Events are not read")
    hostile = event(
        namespace, uid, "o", 5, reason="Failed", message="Failed to pull image",
        fieldPath=".containers{" * 50_000,
    )  # fmt: skip
    admin.create(events, hostile)
    wait_until(lambda: reason() != "VolumeNotMounted", PATIENCE, "the last Event holds it up")
    assert operator.ask("/livez")[0] == 200
    process = operator._process
    assert process is not None
    assert peak_mib(process.pid) < MOST_MIB
