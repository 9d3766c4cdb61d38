"""`bagpipe pull` against a real API server, with its admission, quotas and rights.

What a kubelet does is faked (exec_kubelet.py): the pod's command runs on this machine, and the
claim is a folder here. The websocket goes through the API server as it does in a cluster.
"""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from tests.integration.control_plane.cli_process import CliProcess
from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.exec_kubelet import ExecKubelet, serving
from tests.integration.control_plane.observe import a_job, await_right, limit_pods
from tests.integration.control_plane.server import ControlPlane
from tests.integration.control_plane.test_cli import Ended, report_end, run
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.integration

DRIVER_IMAGE = "registry.example/bagpipe/spark:1"


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """A claim's folder with a job's results in it, and a recording of several frames."""
    claim = tmp_path / "claim"
    claim.mkdir()
    row = make_row("a-0000") | {"recorded": "cases/a-0000.1.bag"}
    folder = publish(claim, [row, make_row("a-0001") | {"recorded": "cases/a-0001.1.bag"}])
    (folder / "cases").mkdir(exist_ok=True)
    (folder / "cases/a-0000.1.bag").write_bytes(os.urandom(3_000_001))
    (folder / "cases/a-0001.1.bag").write_bytes(b"")
    return folder


@pytest.fixture
def kubelet(control_plane: ControlPlane, namespace: str, tmp_path: Path) -> Iterator[ExecKubelet]:
    # Whatever is made has to pass the strictest of Kubernetes' levels.
    labels = {"pod-security.kubernetes.io/enforce": "restricted"}
    path = f"/api/v1/namespaces/{namespace}"
    control_plane.admin.merge(path, {"metadata": {"labels": labels}})
    pki = control_plane.folder / "pki"
    with serving(control_plane.admin, pki, namespace, tmp_path / "claim") as found:
        yield found


@pytest.fixture
def lane(admin: Client, namespace: str, results: Path, tmp_path: Path) -> str:
    """The job `lane`, which has ended, with its driver's pod."""
    admin.create(jobs(namespace), a_job("lane"))
    admin.create(core(namespace, "pods"), driver_pod())
    uri = f"pvc://results/{results.relative_to(tmp_path / 'claim')}"
    report_end(admin, namespace, "lane", "Passed", results=uri, driver="lane-1-driver")
    return "lane"


def driver_pod() -> Object:
    """As the operator makes it, as far as a pull looks at it."""
    security = {
        "allowPrivilegeEscalation": False, "capabilities": {"drop": ["ALL"]},
        "runAsNonRoot": True, "runAsUser": 10001, "runAsGroup": 10001,
        "seccompProfile": {"type": "RuntimeDefault"},
    }  # fmt: skip
    return {
        "metadata": {"name": "lane-1-driver", "labels": {"sim.bagpipe.io/role": "driver"}},
        "spec": {
            "securityContext": {"fsGroup": 10001},
            "nodeSelector": {"pool": "simulation"},
            "imagePullSecrets": [{"name": "registry"}],
            "containers": [
                {
                    "name": "driver", "image": DRIVER_IMAGE, "imagePullPolicy": "IfNotPresent",
                    "securityContext": security,
                }
            ],
        },
    }  # fmt: skip


def pull(control_plane: ControlPlane, namespace: str, *words: str | Path) -> Ended:
    return run(control_plane.kubeconfig, "pull", *map(str, words), "-n", namespace)


def files_of(folder: Path) -> dict[str, bytes]:
    """What is in a folder, without a pull's own marker."""
    found = {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    found.pop(".bagpipe-pull.jsonl", None)
    return found


def pull_pods(admin: Client, namespace: str) -> list[str]:
    selector = "labelSelector=app.kubernetes.io/name=bagpipe-pull"
    return [p["metadata"]["name"] for p in admin.items(f"{core(namespace, 'pods')}?{selector}")]


def await_no_pod(admin: Client, namespace: str) -> None:
    wait_until(lambda: not pull_pods(admin, namespace), PATIENCE, "a pod is left behind")


def test_results_on_a_claim_come_through_a_pod_that_goes(
    control_plane: ControlPlane, admin: Client, namespace: str, kubelet: ExecKubelet, lane: str,
    results: Path, tmp_path: Path,
) -> None:  # fmt: skip
    target = tmp_path / "here"
    done = pull(control_plane, namespace, lane, target)
    assert done.status == 0, done.text
    assert files_of(target) == files_of(results)
    assert f"page: {target}/report.html" in done.stdout
    assert run(control_plane.kubeconfig, "results", str(target)).status == 0
    await_no_pod(admin, namespace)
    (pod,) = kubelet.specs
    job = admin.get(jobs(namespace, lane))
    (owner,) = pod["metadata"]["ownerReferences"]
    assert (owner["uid"], owner.get("blockOwnerDeletion")) == (job["metadata"]["uid"], None)
    spec = pod["spec"]
    (container,) = spec["containers"]
    assert container["image"] == DRIVER_IMAGE
    assert (spec["nodeSelector"], spec["imagePullSecrets"]) == (
        {"pool": "simulation"}, [{"name": "registry"}],
    )  # fmt: skip
    assert (spec["activeDeadlineSeconds"], spec["automountServiceAccountToken"]) == (3600, False)
    assert set(container["resources"]["limits"]) == {"cpu", "memory"}
    assert [volume["persistentVolumeClaim"]["claimName"] for volume in spec["volumes"]] == [
        "results"
    ]
    assert [mount["readOnly"] for mount in container["volumeMounts"]] == [True]


@pytest.mark.usefixtures("lane")
def test_some_files_are_chosen_and_named_by_namespace(
    control_plane: ControlPlane, namespace: str, kubelet: ExecKubelet, tmp_path: Path
) -> None:
    words = ("pull", f"{namespace}/lane", str(tmp_path / "some"))
    only = ("--only", "report.html,results.jsonl", "--only", "cases/a-0001*")
    done = run(control_plane.kubeconfig, *words, *only, "--output", "json")
    assert done.status == 0, done.text
    expected = {"report.html", "results.jsonl", "cases/a-0001.1.bag"}
    assert set(files_of(tmp_path / "some")) == expected
    assert len(kubelet.specs) == 1
    none = run(control_plane.kubeconfig, *words, "--only", "nothing.bag")
    assert (none.status, "--only nothing.bag: the results have no such file" in none.stderr) == (
        2, True,
    )  # fmt: skip


def test_a_cut_stream_is_noticed_and_the_next_pull_goes_on(
    control_plane: ControlPlane, admin: Client, namespace: str, kubelet: ExecKubelet, lane: str,
    results: Path, tmp_path: Path,
) -> None:  # fmt: skip
    target = tmp_path / "here"
    # In the middle of the recording, behind the files of the folder itself.
    kubelet.most_bytes = 1_500_000
    cut = pull(control_plane, namespace, lane, target)
    assert cut.status == 2
    assert "the connection to the pod broke" in cut.stderr
    assert "pull again, and it goes on where it stopped" in cut.stderr
    there = files_of(target)
    assert "report.html" in there
    assert not {"manifest.json", "cases/a-0000.1.bag"} & set(there)
    assert all(files_of(results)[name] == data for name, data in there.items())
    await_no_pod(admin, namespace)
    assert run(control_plane.kubeconfig, "results", str(target)).status == 2
    kubelet.most_bytes = None
    again = pull(control_plane, namespace, lane, target, "--output", "json")
    assert again.status == 0, again.text
    assert f'"alreadyHere": {len(there)}' in again.stdout
    assert files_of(target) == files_of(results)
    nothing = pull(control_plane, namespace, lane, target, "--output", "json")
    assert (nothing.status, '"files": 0' in nothing.stdout) == (0, True)


def test_a_byte_that_is_another_one_is_noticed(
    control_plane: ControlPlane, namespace: str, kubelet: ExecKubelet, lane: str, tmp_path: Path
) -> None:
    kubelet.spoiled = 1_500_000
    done = pull(control_plane, namespace, lane, tmp_path / "here")
    assert done.status == 2
    assert "cases/a-0000.1.bag came with other bytes than it was read with" in done.stderr
    assert not list((tmp_path / "here/cases").iterdir())


def test_results_that_are_not_on_the_claim_are_reported_in_the_pod_s_words(
    control_plane: ControlPlane, admin: Client, namespace: str, kubelet: ExecKubelet, lane: str,
    tmp_path: Path,
) -> None:  # fmt: skip
    report_end(admin, namespace, lane, "Passed", results="pvc://results/gone")
    done = pull(control_plane, namespace, lane, tmp_path / "here")
    assert done.status == 2
    assert "can't send the results: there is no such folder on the claim" in done.stderr
    await_no_pod(admin, namespace)
    assert len(kubelet.specs) == 1


@pytest.mark.parametrize(("number", "status"), [
    (signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129),
])  # fmt: skip
def test_a_signal_leaves_no_pod(
    control_plane: ControlPlane, admin: Client, namespace: str, kubelet: ExecKubelet, lane: str,
    tmp_path: Path, number: signal.Signals, status: int,
) -> None:  # fmt: skip
    kubelet.waits = ("ImagePullBackOff", "no such tag")
    words = ("pull", lane, str(tmp_path / "here"), "-n", namespace)
    with CliProcess(control_plane.kubeconfig, *words) as program:
        program.read_until("waits: ImagePullBackOff: no such tag")
        assert pull_pods(admin, namespace)
        program.interrupt(number)
        assert program.end() == status
    await_no_pod(admin, namespace)


def test_an_interrupt_amid_a_file_leaves_neither_a_part_of_it_nor_a_pod(
    control_plane: ControlPlane, admin: Client, namespace: str, kubelet: ExecKubelet, lane: str,
    tmp_path: Path,
) -> None:  # fmt: skip
    kubelet.most_bytes, kubelet.stalls = 1_500_000, True
    cases = tmp_path / "here/cases"
    words = ("pull", lane, str(tmp_path / "here"), "-n", namespace)
    with CliProcess(control_plane.kubeconfig, *words) as program:
        wait_until(lambda: list(cases.glob(".*.part")), PATIENCE, "no file was begun")
        program.interrupt(signal.SIGINT)
        assert program.end() == 130
    assert not list(cases.iterdir())
    await_no_pod(admin, namespace)


def test_the_pod_of_a_program_that_was_killed_goes_with_its_job(
    control_plane: ControlPlane, admin: Client, namespace: str, kubelet: ExecKubelet, lane: str,
    tmp_path: Path,
) -> None:  # fmt: skip
    kubelet.waits = ("ImagePullBackOff", "no such tag")
    words = ("pull", lane, str(tmp_path / "here"), "-n", namespace)
    with CliProcess(control_plane.kubeconfig, *words) as program:
        program.read_until("waits: ImagePullBackOff")
        program.interrupt(signal.SIGKILL)
    assert pull_pods(admin, namespace)
    admin.delete(jobs(namespace, lane))
    await_no_pod(admin, namespace)


@pytest.mark.usefixtures("kubelet")
def test_a_pod_that_does_not_start_says_why(
    control_plane: ControlPlane, admin: Client, namespace: str, kubelet: ExecKubelet, lane: str,
    tmp_path: Path,
) -> None:  # fmt: skip
    kubelet.waits = ("ContainerCreating", "")
    # By when the Event has to be there: a slow machine needs some seconds for it.
    words = ("pull", lane, str(tmp_path / "here"), "-n", namespace, "--start-timeout", "30s")
    with CliProcess(control_plane.kubeconfig, *words) as program:
        wait_until(lambda: pull_pods(admin, namespace), PATIENCE, "no pod was made")
        (name,) = pull_pods(admin, namespace)
        _write_event(admin, namespace, name)
        assert program.end() == 2
        why = "did not start within 30 s: FailedAttachVolume: Multi-Attach error"
        assert why in program.plain()
        assert "is free when that pod has ended" in program.plain()
    await_no_pod(admin, namespace)


def _write_event(admin: Client, namespace: str, pod: str) -> None:
    """As the controller that attaches volumes writes it."""
    event: Object = {
        "metadata": {"name": f"{pod}.1", "namespace": namespace},
        "involvedObject": {"kind": "Pod", "name": pod, "namespace": namespace},
        "type": "Warning",
        "reason": "FailedAttachVolume",
        "message": "Multi-Attach error for volume pv-1: Volume is already used by pod(s) toolbox",
        "lastTimestamp": "2026-11-20T04:00:00Z",
    }
    admin.create(core(namespace, "events"), event)


@pytest.mark.usefixtures("kubelet")
def test_a_quota_without_room_is_named(
    control_plane: ControlPlane, admin: Client, namespace: str, lane: str, tmp_path: Path
) -> None:
    limit_pods(admin, namespace, "small", 1)
    done = pull(control_plane, namespace, lane, tmp_path / "here")
    assert done.status == 2
    assert "exceeded quota: small, requested: pods=1, used: pods=1" in done.stderr
    assert not pull_pods(admin, namespace)


def test_the_page_s_role_is_enough_and_without_it_all_that_lacks_is_named(
    control_plane: ControlPlane, admin: Client, namespace: str, kubelet: ExecKubelet, lane: str,
    tmp_path: Path,
) -> None:  # fmt: skip
    rbac = f"/apis/rbac.authorization.k8s.io/v1/namespaces/{namespace}"
    admin.create(core(namespace, "serviceaccounts"), {"metadata": {"name": "ci"}})
    page = (Path(__file__).parents[3] / "docs/tasks/ci-gate.md").read_text()
    blocks = [b.removeprefix("yaml") for b in page.split("```") if "kind: Role" in b]
    base, more = (list(yaml.safe_load_all(block)) for block in blocks)
    config = tmp_path / "config"
    token = control_plane.token(namespace, "ci")
    control_plane.write_kubeconfig(config, token)
    client = admin.with_token(token)
    words = ("pull", lane, str(tmp_path / "here"), "-n", namespace)
    for role, binding in (base, more):
        role["metadata"]["namespace"] = namespace
        binding["metadata"]["namespace"] = binding["subjects"][0]["namespace"] = namespace
    _grant(admin, rbac, base)
    await_right(client, "get", namespace, "simulationjobs", "sim.bagpipe.io")
    await_right(client, "list", namespace, "pods")
    refused = run(config, *words)
    assert refused.status == 2
    assert (
        "you may not create pods, delete pods, get pods/exec, create pods/exec in namespace"
        f" {namespace}"
    ) in refused.stderr
    assert not kubelet.specs
    _grant(admin, rbac, more)
    await_right(client, "delete", namespace, "pods")
    done = run(config, *words)
    assert done.status == 0, done.text


def _grant(admin: Client, rbac: str, objects: list[Object]) -> None:
    role, binding = objects
    admin.create(f"{rbac}/roles", role)
    admin.create(f"{rbac}/rolebindings", binding)


@pytest.mark.usefixtures("kubelet")
def test_without_any_driver_s_pod_an_image_is_asked_for(
    control_plane: ControlPlane, admin: Client, namespace: str, kubelet: ExecKubelet, lane: str,
    results: Path, tmp_path: Path,
) -> None:  # fmt: skip
    admin.delete(core(namespace, "pods", "lane-1-driver"), grace_seconds=0)
    done = pull(control_plane, namespace, lane, tmp_path / "here")
    assert (done.status, "give --image IMAGE" in done.stderr) == (2, True)
    words = (lane, tmp_path / "here", "--image", "registry.example/python:3")
    again = pull(control_plane, namespace, *words)
    assert again.status == 0, again.text
    assert files_of(tmp_path / "here") == files_of(results)
    (container,) = kubelet.specs[0]["spec"]["containers"]
    assert container["image"] == "registry.example/python:3"
    assert container["securityContext"]["runAsUser"] == 10001
