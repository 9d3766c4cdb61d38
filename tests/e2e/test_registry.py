"""Chart and images from a registry: helm installs oci://, nodes pull by digest, a job runs.

The registry is in the node's network namespace: containerd pulls without TLS from loopback only.

    make cluster install
    KUBECONFIG=/var/lib/bagpipe/kubeconfig .venv/bin/python -m pytest tests/e2e/test_registry.py
"""

import tempfile
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest
from embedded import images

from release import archives, charts, push, version
from release.make import RELEASED
from tests.e2e import fleet, jobs
from tests.e2e import kubectl as k
from tests.e2e.installation import OPERATOR, SYSTEM, helm, keep_values, upgrade
from tests.e2e.storage_servers import NODE
from tests.integration.release.registry import registry

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(1200)]
# Below the ports that connections take by themselves, as those of the storage servers are.
_PORT = 21950


@pytest.fixture
def values(tmp_path: Path) -> Iterator[Path]:
    """What the release was given; in the end the checkout's chart is installed again."""
    found = keep_values(tmp_path)
    yield found
    upgrade(found)


def pushed(target: push.Registry, folder: Path) -> dict[str, str]:
    """Push the cluster's own images and a chart that pins them; their digests."""
    found = {}
    for name in RELEASED:
        archive = images.folder() / f"{name}.oci.tar"
        found[name] = archives.inspect(archive).digest
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            target.image(archives.unpack(archive, Path(scratch)), name, version.version())
    target.chart(charts.pack("bagpipe", version.version(), folder, digests=found))
    return found


def test_a_release_is_installed_from_a_registry_and_runs_a_job(
    namespace: str, values: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HELM_REGISTRY_CONFIG", str(tmp_path / "helm.json"))
    monkeypatch.setenv("PATH", k.tool_environment()["PATH"])
    # A node asks for no digest that it has by the same name, as from a run before.
    project = f"robots-{uuid.uuid4().hex[:6]}"
    nodes = f"127.0.0.1:{_PORT}/{project}"
    with registry(tmp_path, NODE, _PORT, login=False) as running:
        pushed_to = f"{running.address}:{running.port}/{project}"
        digests = pushed(push.Registry(pushed_to, plain_http=True), tmp_path)
        helm(
            "upgrade", "--install", "bagpipe", f"oci://{pushed_to}/charts/bagpipe",
            "--version", version.version(), "--plain-http", "-f", str(values),
            "--set", f"images.registry={nodes}", "--wait", "--timeout", "5m",
        )  # fmt: skip
        (operator,) = k.get(SYSTEM, "deployment", OPERATOR)["spec"]["template"]["spec"][
            "containers"
        ]
        assert operator["image"] == f"{nodes}/operator@{digests['operator']}"
        # The one before it may lead until it has ended.
        k.await_that("one operator", lambda: len(k.items(SYSTEM, "pods")) == 1, 120)
        fleet.put_files(namespace)
        job = fleet.make_job("pulled", "pvc://results/pulled", spark=jobs.spark(1, 1))
        with jobs.applied(namespace, job) as name:
            (driver,) = k.await_that("a driver", lambda: fleet.pods(namespace, name, "driver"), 120)
            (spark,) = driver["spec"]["containers"]
            assert spark["image"] == f"{nodes}/spark@{digests['spark']}"
            status = jobs.ended(namespace, name, 600)["status"]
        assert (status["phase"], status["verdict"]) == ("Complete", "Passed"), status
        log = (tmp_path / "registry.log").read_text()
        for name, digest in digests.items():
            assert f"/v2/{project}/{name}/manifests/{digest}" in log, f"no node asked for {name}"
