"""From the previous release to this one while a job runs: the job ends well, and so does the CRD.

The previous release is tests/e2e/previous/release.yaml: its CRD, rights and Deployment, and its
operator's sources. Driver and executors are of the present images, as they would be of any image
that was pulled.
"""

import json
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.e2e import fleet, jobs
from tests.e2e import kubectl as k
from tests.e2e.installation import CHART, OPERATOR, SYSTEM, helm, installed, keep_values, upgrade

pytestmark = [pytest.mark.e2e, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
PREVIOUS = Path(__file__).parent / "previous/release.yaml"
CRD = "simulationjobs.sim.bagpipe.io"


@dataclass(frozen=True)
class Release:
    """How to bring either version up."""

    values: Path
    previous: Path

    def install_previous(self) -> None:
        helm("uninstall", "bagpipe", "--wait", "--timeout", "3m")
        helm("install", "bagpipe", str(self.previous), "--wait", "--timeout", "5m")

    def upgrade(self) -> None:
        upgrade(self.values)


@pytest.fixture
def release(tmp_path: Path) -> Iterator[Release]:
    """The installed release; whatever happens, this version is installed again in the end."""
    values = keep_values(tmp_path)
    previous = tmp_path / "previous"
    (previous / "templates").mkdir(parents=True)
    chart = {"apiVersion": "v2", "name": "bagpipe", "version": "0.1.0", "appVersion": "0.1.0"}
    (previous / "Chart.yaml").write_text(yaml.safe_dump(chart))
    (previous / "release.yaml").write_text(PREVIOUS.read_text())
    (previous / "templates/all.yaml").write_text('{{ .Files.Get "release.yaml" }}\n')
    found = Release(values, previous)
    yield found
    found.upgrade()


@pytest.fixture
def as_before(namespace: str) -> Iterator[None]:
    """The namespace as the release before wants it, which met only Pod Security's level baseline.

    Its drivers' account put a token into every pod; now the driver's pod asks for its own.
    """

    def change(level: str, tokens: bool) -> None:
        label = f"pod-security.kubernetes.io/enforce={level}"
        k.kubectl("label", "--overwrite", "namespace", namespace, label)
        patch = json.dumps({"automountServiceAccountToken": tokens})
        account = ("serviceaccount", "bagpipe-driver")
        k.kubectl("-n", namespace, "patch", *account, "--type=merge", "-p", patch)

    change("baseline", tokens=True)
    yield
    change("restricted", tokens=False)


def fields(schema: k.Object, path: str = "") -> set[str]:
    """The paths of all fields of a schema."""
    found: set[str] = set()
    for name, below in (schema.get("properties") or {}).items():
        found |= {f"{path}.{name}"} | fields(below, f"{path}.{name}")
    if isinstance(schema.get("items"), dict):
        found |= fields(schema["items"], f"{path}[]")
    return found


def schema_of(crd: k.Object) -> k.Object:
    schema: k.Object = crd["spec"]["versions"][0]["schema"]["openAPIV3Schema"]
    return schema


def passed(namespace: str, name: str, least: int) -> k.Object | None:
    job = k.get(namespace, "simjob", name)
    return job if job.get("status", {}).get("cases", {}).get("passed", 0) >= least else None


def event_counts(namespace: str, uid: str) -> Counter[str]:
    found = k.items(namespace, "events", "--field-selector", f"involvedObject.uid={uid}")
    return Counter(event["reason"] for event in found)


def long_job() -> k.Object:
    """100 cases of a second each, one at a time: longer than an upgrade takes."""
    changed: dict[str, Any] = {
        "source": {"files": [f"pvc://recordings/{fleet.FOLDER}/0*.bin"]},
        "spark": jobs.spark(1, 1),
    }
    return fleet.make_job("upgraded", "pvc://results/upgraded", **changed)


@pytest.mark.usefixtures("as_before")
def test_a_job_that_runs_while_bagpipe_is_upgraded(namespace: str, release: Release) -> None:
    fleet.put_files(namespace)
    release.install_previous()
    assert installed() == "bagpipe-0.1.0"
    with jobs.applied(namespace, long_job()) as name:
        k.await_that("five cases", lambda: passed(namespace, name, 5), 240)
        (driver,) = fleet.pods(namespace, name, "driver")
        release.upgrade()
        version = yaml.safe_load((CHART / "Chart.yaml").read_text())["version"]
        assert installed() == f"bagpipe-{version}" != "bagpipe-0.1.0"
        during = k.get(namespace, "simjob", name)
        assert during["status"]["phase"] == "Running", "the job was over before the upgrade was"

        job = jobs.ended(namespace, name, 400)
        status = job["status"]
        assert (status["phase"], status["verdict"]) == ("Complete", "Passed"), status
        assert status["cases"]["passed"] == status["cases"]["planned"] == 100
        assert status["attempt"] == 1
        assert status["driver"] == driver["metadata"]["name"]
        assert job["metadata"]["uid"] == during["metadata"]["uid"]
        uid = job["metadata"]["uid"]
        # Events come after the status that they report.
        k.await_that(
            "its end to be reported", lambda: event_counts(namespace, uid)["AllCasesRan"], 60
        )
        counts = event_counts(namespace, uid)
        wanted = ("DriverCreated", "CasesPlanned", "CasesRunning", "AllCasesRan")
        assert {reason: counts[reason] for reason in wanted} == dict.fromkeys(wanted, 1)

    live = k.get("default", "crd", CRD)
    here = yaml.safe_load((ROOT / "crds/simulationjobs.yaml").read_text())
    assert fields(schema_of(here)) <= fields(schema_of(live))
    assert live["metadata"]["annotations"]["meta.helm.sh/release-name"] == "bagpipe"
    helm("test", "bagpipe", "--timeout", "3m")


@contextmanager
def unplaced() -> Iterator[None]:
    """The operator's next pod finds no node; its earlier one goes on."""

    def schedule_by(name: str) -> None:
        patch = json.dumps({"spec": {"template": {"spec": {"schedulerName": name}}}})
        k.kubectl("-n", SYSTEM, "patch", "deployment", OPERATOR, "--type=merge", "-p", patch)

    schedule_by("none")
    try:
        yield
    finally:
        # Helm leaves alone what its own manifests do not say.
        schedule_by("default-scheduler")


@pytest.mark.usefixtures("release")
def test_helm_test_reports_an_operator_that_is_not_ready() -> None:
    with unplaced():
        with pytest.raises(AssertionError, match=r"[Ff]ailed"):
            helm("test", "bagpipe", "--timeout", "3m")
        log = k.kubectl("-n", SYSTEM, "logs", "bagpipe-operator-test")
        assert "pods of the operator are ready" in log or "newest Deployment" in log
    rollout = ("rollout", "status", f"deployment/{OPERATOR}", "--timeout=3m")
    k.kubectl("-n", SYSTEM, *rollout, seconds=200)
    helm("test", "bagpipe", "--timeout", "3m")
