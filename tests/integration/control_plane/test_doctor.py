"""`bagpipe doctor` against a real API server: as an administrator, and with few rights."""

import json
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner
from embedded.api import ApiError

from bagpipe.cli.__main__ import main
from tests.integration.control_plane.client import STRATEGIC_PATCH, Client, Object, core
from tests.integration.control_plane.observe import a_job, await_right, limit_pods
from tests.integration.control_plane.release import bound, fresh_namespace
from tests.integration.control_plane.server import ControlPlane

pytestmark = pytest.mark.integration

RBAC = "/apis/rbac.authorization.k8s.io/v1"


def a_whole_job() -> Object:
    return {"apiVersion": "sim.bagpipe.io/v1alpha1", "kind": "SimulationJob"} | a_job("lane")


@pytest.fixture
def manifest(tmp_path: Path) -> Path:
    path = tmp_path / "job.yaml"
    path.write_text(yaml.safe_dump(a_whole_job()))
    return path


def asked(kubeconfig: Path, *words: str) -> tuple[int, dict[str, Object]]:
    """The exit status, and the findings about what is not this machine's."""
    done = CliRunner(env={"KUBECONFIG": str(kubeconfig)}).invoke(
        main, ["doctor", *words, "--output", "json", "--timeout", "90s"]
    )
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    found = [each for each in json.loads(done.stdout) if each["part"] != "machine"]
    return done.exit_code, {each["what"]: each for each in found}


def states(found: dict[str, Object]) -> dict[str, str]:
    return {what: each["state"] for what, each in found.items()}


def with_account(control_plane: ControlPlane, namespace: str, folder: Path, *verbs: str) -> Path:
    """The kubeconfig of an account that may do so with jobs of a namespace, and nothing else."""
    admin = control_plane.admin
    admin.create(core(namespace, "serviceaccounts"), {"metadata": {"name": "person"}})
    if verbs:
        rules = [
            {
                "apiGroups": ["sim.bagpipe.io"],
                "resources": ["simulationjobs"],
                "verbs": list(verbs),
            }
        ]
        inside = f"{RBAC}/namespaces/{namespace}"
        admin.create(f"{inside}/roles", {"metadata": {"name": "person"}, "rules": rules})
        reference = {"kind": "Role", "name": "person", "apiGroup": "rbac.authorization.k8s.io"}
        subject = {"kind": "ServiceAccount", "name": "person", "namespace": namespace}
        binding = {"metadata": {"name": "person"}, "roleRef": reference, "subjects": [subject]}
        admin.create(f"{inside}/rolebindings", binding)
    token = control_plane.token(namespace, "person")
    for verb in verbs:
        await_right(admin.with_token(token), verb, namespace, "simulationjobs", "sim.bagpipe.io")
    kubeconfig = folder / "person.kubeconfig"
    control_plane.write_kubeconfig(kubeconfig, token)
    return kubeconfig


def test_a_namespace_that_is_fit_but_for_its_claims(
    control_plane: ControlPlane, admin: Client, namespace: str, manifest: Path
) -> None:
    status, found = asked(control_plane.kubeconfig, str(manifest), "-n", namespace)
    assert status == 1
    lacking = {what for what, each in found.items() if each["state"] == "missing"}
    assert lacking == {"claim recordings", "claim results"}, found
    assert found["Kubernetes"]["found"].startswith("v1.34.")
    assert found["CRDs' version"]["state"] == "done", found["CRDs' version"]
    # No operator is installed here.
    assert found["operator"]["state"] == "unknown"
    with bound(admin, namespace):
        status, found = asked(control_plane.kubeconfig, str(manifest), "-n", namespace)
    assert status == 0
    assert found["claim results"]["found"] == "bound, ReadWriteOnce"
    assert found["the job"] == found["the job"] | {
        "state": "done", "found": "the API server takes it",
    }  # fmt: skip
    with pytest.raises(ApiError, match="not found"):
        admin.get(f"/apis/sim.bagpipe.io/v1alpha1/namespaces/{namespace}/simulationjobs/lane")


def test_a_namespace_that_nobody_made_fit(
    control_plane: ControlPlane, admin: Client, manifest: Path
) -> None:
    with fresh_namespace(admin, "bare") as name:
        closed = {"podSelector": {}, "policyTypes": ["Ingress"]}
        path = f"/apis/networking.k8s.io/v1/namespaces/{name}/networkpolicies"
        admin.create(path, {"metadata": {"name": "closed"}, "spec": closed})
        limit_pods(admin, name, "few", 1)
        labels = {"pod-security.kubernetes.io/enforce": "restricted"}
        admin.merge(f"/api/v1/namespaces/{name}", {"metadata": {"labels": labels}})
        status, found = asked(control_plane.kubeconfig, str(manifest), "-n", name)
    assert status == 1
    assert {what for what, each in found.items() if each["state"] == "missing"} == {
        "service account bagpipe-driver", "service account bagpipe-executor", "quota few",
        "network policies", "claim recordings", "claim results",
    }  # fmt: skip
    assert "needs 2 of pods, of which it gives 1" in found["quota few"]["found"]
    assert found["Pod Security"]["found"].startswith("restricted: ")


@pytest.mark.parametrize(("cpu", "state"), [("64", "done"), ("10m", "missing")])
def test_nodes_are_looked_at(
    control_plane: ControlPlane, admin: Client, namespace: str, manifest: Path, cpu: str, state: str
) -> None:
    admin.create("/api/v1/nodes", {"metadata": {"name": "of-doctor"}})
    status = {
        "allocatable": {"cpu": cpu, "memory": "256Gi"},
        "conditions": [{"type": "Ready", "status": "True"}],
    }
    path = "/api/v1/nodes/of-doctor"
    try:
        admin.call("PATCH", f"{path}/status", {"status": status}, STRATEGIC_PATCH)
        # What the admission taints it with, until a controller has seen that it is ready.
        admin.merge(path, {"spec": {"taints": None}})
        _, found = asked(control_plane.kubeconfig, str(manifest), "-n", namespace)
    finally:
        admin.delete(path)
    pods = ("a node for an executor", "a node for the driver")
    assert [found[what]["state"] for what in pods] == [state, state], found


def test_names_that_a_job_has_are_looked_for_without_their_values(
    control_plane: ControlPlane, admin: Client, namespace: str, tmp_path: Path
) -> None:
    job = a_whole_job()
    job["spec"]["storage"] = {"secrets": ["there", "gone"]}
    job["spec"]["spark"] = {"executor": {"pod": {"priorityClassName": "nobody-s"}}}
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(job))
    secret = {"metadata": {"name": "there"}, "stringData": {"key": "never-shown"}}
    admin.create(core(namespace, "secrets"), secret)
    account = core(namespace, "serviceaccounts", "bagpipe-driver")
    admin.merge(account, {"imagePullSecrets": [{"name": "registry"}]})
    _, found = asked(control_plane.kubeconfig, str(tmp_path / "job.yaml"), "-n", namespace)
    assert {what: each for what, each in states(found).items() if "Secret" in what} == {
        "Secret there": "done", "Secret gone": "missing", "Secret registry": "missing",
    }  # fmt: skip
    assert states(found)["priority class nobody-s"] == "missing"
    assert "never-shown" not in json.dumps(found)


def test_a_job_that_the_api_server_refuses_is_shown_with_its_faults(
    control_plane: ControlPlane, namespace: str, tmp_path: Path
) -> None:
    job = a_whole_job()
    job["metadata"]["name"] = "a-name-of-more-than-forty-letters-for-one-job"
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(job))
    status, found = asked(control_plane.kubeconfig, str(tmp_path / "job.yaml"), "-n", namespace)
    assert (status, found["the job"]["state"]) == (1, "missing")
    assert "metadata.name must have at most 40 characters" in found["the job"]["found"]


def test_someone_who_may_only_create_jobs_is_no_fault(
    control_plane: ControlPlane, namespace: str, manifest: Path, tmp_path: Path
) -> None:
    kubeconfig = with_account(control_plane, namespace, tmp_path, "create")
    status, found = asked(kubeconfig, str(manifest), "-n", namespace)
    assert status == 0, found
    known = {what for what, each in found.items() if each["state"] == "done"}
    assert known == {
        "Kubernetes", "CRDs", "CRDs' version", "your right to create jobs", "the job",
    }  # fmt: skip
    for what in found.keys() - known:
        assert found[what]["state"] == "unknown"
        assert found[what]["found"].startswith("you may not read"), found[what]


def test_someone_without_any_right_lacks_it(
    control_plane: ControlPlane, namespace: str, manifest: Path, tmp_path: Path
) -> None:
    kubeconfig = with_account(control_plane, namespace, tmp_path)
    status, found = asked(kubeconfig, str(manifest), "-n", namespace)
    assert status == 1
    assert {what for what, each in found.items() if each["state"] == "missing"} == {
        "your right to create jobs"
    }
    assert found["the job"]["state"] == "unknown"


def test_a_namespace_that_is_not_there(control_plane: ControlPlane, manifest: Path) -> None:
    status, found = asked(control_plane.kubeconfig, str(manifest), "-n", "nowhere")
    assert status == 1
    assert states(found)["nowhere"] == "missing"
    assert "the job" not in found
