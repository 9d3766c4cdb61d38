"""The pod of a `bagpipe pull`: what it is, what keeps it, and that none is left behind."""

import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, cast

import pytest

from bagpipe.cli.pulling.claim import made_pod
from bagpipe.cli.pulling.pod import claimed, end_of, manifest, runs, waits_for
from tests.unit.cli.cluster_objects import a_job


@pytest.mark.parametrize("uri", [
    "pvc://results", "pvc://results/", "pvc://results/../x", "pvc://results/a//b", "pvc:///a",
    "pvc://results/a/.", "s3://bucket/a",
])  # fmt: skip
def test_a_uri_that_leads_nowhere_on_a_claim_is_none(uri: str) -> None:
    assert claimed(uri) is None
    assert claimed("pvc://results/out/lane/uid-1/") is not None


def test_the_pod_is_the_driver_s_without_what_gives_it_rights() -> None:
    driver = {
        "spec": {
            "serviceAccountName": "bagpipe-driver",
            "securityContext": {"fsGroup": 1000660000, "supplementalGroups": [5]},
            "tolerations": [{"key": "gpu"}],
            "affinity": {"nodeAffinity": {"a": 1}, "podAntiAffinity": {"b": 1}},
            "volumes": [{"name": "secret", "secret": {"secretName": "s3"}}],
            "containers": [
                {
                    "image": "spark:1", "imagePullPolicy": "Never", "envFrom": [{"secretRef": {}}],
                    "securityContext": {"runAsUser": 1000660000, "privileged": True},
                }
            ],
        }
    }  # fmt: skip
    job = a_job() | {"apiVersion": "sim.bagpipe.io/v1alpha1", "kind": "SimulationJob"}
    spec = manifest(job, driver, "", "results", 90.4)["spec"]
    assert "serviceAccountName" not in spec
    assert spec["affinity"] == {"nodeAffinity": {"a": 1}}
    assert spec["tolerations"] == [{"key": "gpu"}]
    assert spec["activeDeadlineSeconds"] == 90
    assert (spec["securityContext"]["fsGroup"], len(spec["volumes"])) == (1000660000, 1)
    (container,) = spec["containers"]
    assert (container["image"], container["imagePullPolicy"]) == ("spark:1", "Never")
    assert "envFrom" not in container
    assert container["securityContext"]["runAsUser"] == 1000660000
    assert "privileged" not in container["securityContext"]
    assert [each["name"] for each in container["env"]] == ["BAGPIPE_PULL"]


def test_what_keeps_a_pod_and_what_ended_it_is_read_off_its_status() -> None:
    def pod(phase: str, **state: object) -> dict[str, object]:
        statuses = [{"name": "pull", "state": state}]
        return {"status": {"phase": phase, "containerStatuses": statuses}}

    assert runs(pod("Running", running={}))
    assert not runs(pod("Pending", waiting={"reason": "ContainerCreating"}))
    assert waits_for(pod("Pending", waiting={"reason": "ContainerCreating"})) == ""
    held = {"reason": "ErrImagePull", "message": "no such tag"}
    assert waits_for(pod("Pending", waiting=held)) == "ErrImagePull: no such tag"
    conditions = [{"type": "PodScheduled", "status": "False", "message": "0/3 nodes"}]
    assert waits_for({"status": {"conditions": conditions}}) == "no node takes it: 0/3 nodes"
    assert end_of(pod("Running", running={})) == ""
    assert end_of({"status": {"phase": "Failed", "reason": "DeadlineExceeded"}}) == (
        "DeadlineExceeded"
    )
    lost = {"reason": "StartError", "message": "python3: not found"}
    assert end_of(pod("Failed", terminated=lost)) == "StartError: python3: not found"


@dataclass
class SlowPods:
    """An API server whose admission takes so long that somebody ends the program meanwhile."""

    number: signal.Signals
    done: list[str] = field(default_factory=list)

    def create(self, _manifest: Any) -> None:
        os.kill(os.getpid(), self.number)
        self.done.append("created")

    def remove(self, _name: str) -> None:
        self.done.append("removed")


@pytest.fixture
def on_a_terminal() -> Iterator[None]:
    """A hang-up ends a program as it does where no `nohup` is before the tests' command."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures("on_a_terminal")
@pytest.mark.parametrize(("number", "ends"), [
    (signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit), (signal.SIGHUP, SystemExit),
])  # fmt: skip
def test_a_pod_that_is_being_created_is_removed_when_it_is_there(
    number: signal.Signals, ends: type[BaseException]
) -> None:
    pods = SlowPods(number)
    made: Any = {"metadata": {"name": "p"}, "spec": {}}
    with pytest.raises(ends), made_pod(cast("Any", pods), made, print):
        pods.done.append("used")
    assert pods.done == ["created", "removed"]


def test_a_hang_up_that_nohup_ignores_ends_no_pull() -> None:
    pods = SlowPods(signal.SIGHUP)
    made: Any = {"metadata": {"name": "p"}, "spec": {}}
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with made_pod(cast("Any", pods), made, print):
            os.kill(os.getpid(), signal.SIGHUP)
            pods.done.append("used")
    finally:
        signal.signal(signal.SIGHUP, before)
    assert pods.done == ["created", "used", "removed"]
