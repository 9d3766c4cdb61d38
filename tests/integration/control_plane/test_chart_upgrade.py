"""Helm on a real API server: from the release before to this one, and CRDs of somebody else."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from tests.integration.control_plane.client import Client, Object, jobs
from tests.integration.control_plane.server import ControlPlane
from tests.unit.operator.builders import make_job

ROOT = Path(__file__).parents[3]
CHART = ROOT / "charts/bagpipe"
PREVIOUS = ROOT / "tests/e2e/previous/release.yaml"
SYSTEM = "bagpipe-system"
DEFINITIONS = "/apis/apiextensions.k8s.io/v1/customresourcedefinitions"
CRD = f"{DEFINITIONS}/simulationjobs.sim.bagpipe.io"
CRDS = (CRD, f"{DEFINITIONS}/simulationschedules.sim.bagpipe.io")


class Helm:
    """Helm for one control plane."""

    def __init__(self, control_plane: ControlPlane) -> None:
        self.kubeconfig = str(control_plane.kubeconfig)

    def __call__(self, *words: str) -> str:
        command = ["helm", *words, "--namespace", SYSTEM, "--kubeconfig", self.kubeconfig]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout


@pytest.fixture
def helm(control_plane: ControlPlane, _helm: None) -> Iterator[Helm]:
    """Helm; whatever the test has left of its release is removed."""
    found = Helm(control_plane)
    yield found
    found("uninstall", "bagpipe", "--ignore-not-found")


@pytest.fixture
def previous(tmp_path: Path) -> str:
    """The release before, as a chart."""
    (tmp_path / "templates").mkdir()
    chart = {"apiVersion": "v2", "name": "bagpipe", "version": "0.1.0", "appVersion": "0.1.0"}
    (tmp_path / "Chart.yaml").write_text(yaml.safe_dump(chart))
    (tmp_path / "release.yaml").write_text(PREVIOUS.read_text())
    (tmp_path / "templates/all.yaml").write_text('{{ .Files.Get "release.yaml" }}\n')
    return str(tmp_path)


def fields(schema: Object, path: str = "") -> set[str]:
    """The paths of all fields of a schema."""
    found: set[str] = set()
    for name, below in (schema.get("properties") or {}).items():
        found |= {f"{path}.{name}"} | fields(below, f"{path}.{name}")
    return found | fields(schema["items"], f"{path}[]") if "items" in schema else found


def schema_of(crd: Object) -> Object:
    schema: Object = crd["spec"]["versions"][0]["schema"]["openAPIV3Schema"]
    return schema


def hand_over(admin: Client) -> None:
    """As docs/operations/upgrade.md says it."""
    owner = {"meta.helm.sh/release-name": "bagpipe", "meta.helm.sh/release-namespace": SYSTEM}
    labels = {"app.kubernetes.io/managed-by": "Helm"}
    for crd in CRDS:
        admin.merge(crd, {"metadata": {"annotations": owner, "labels": labels}})


def take_away(admin: Client) -> None:
    owner = {"meta.helm.sh/release-name": None, "meta.helm.sh/release-namespace": None}
    for crd in CRDS:
        admin.merge(crd, {"metadata": {"annotations": owner}})


def test_from_the_release_before_to_this_one(
    admin: Client, namespace: str, helm: Helm, previous: str
) -> None:
    here = yaml.safe_load((ROOT / "crds/simulationjobs.yaml").read_text())
    before = next(
        o
        for o in yaml.safe_load_all(PREVIOUS.read_text())
        if o["kind"] == "CustomResourceDefinition"
    )
    job = make_job("x").as_written()
    hand_over(admin)
    try:
        helm("install", "bagpipe", previous, "--create-namespace")
        assert fields(schema_of(admin.get(CRD))) == fields(schema_of(before))
        uid = admin.create(jobs(namespace), job)["metadata"]["uid"]
        output = helm("upgrade", "bagpipe", str(CHART))
        assert "not this release's" not in output
        assert fields(schema_of(admin.get(CRD))) == fields(schema_of(here))
        deployment = admin.get(f"/apis/apps/v1/namespaces/{SYSTEM}/deployments/bagpipe-operator")
        container = deployment["spec"]["template"]["spec"]["containers"][0]
        assert "PYTHONPATH" not in {each["name"] for each in container["env"]}
        helm("uninstall", "bagpipe")
        assert admin.get(jobs(namespace, "x"))["metadata"]["uid"] == uid, "the job is gone"
    finally:
        take_away(admin)


def test_a_crd_of_somebody_else_is_left_alone_and_reported(admin: Client, helm: Helm) -> None:
    take_away(admin)
    before = admin.get(CRD)["metadata"]["generation"]
    output = helm("install", "bagpipe", str(CHART), "--create-namespace")
    for kind in ("simulationjobs", "simulationschedules"):
        assert f"The CRD {kind} is not this release's" in output
    assert admin.get(CRD)["metadata"]["generation"] == before
    helm("uninstall", "bagpipe")
    assert all(admin.exists(crd) for crd in CRDS)
