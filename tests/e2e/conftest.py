"""A namespace of the run's own, on the cluster of KUBECONFIG with the operator installed."""

import json
import subprocess
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.e2e import jobs
from tests.e2e import kubectl as k
from tests.recording import fetch

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs/examples/robot-state-publisher"


@pytest.fixture(scope="session")
def namespace() -> Iterator[str]:
    """A fresh namespace with the driver's rights and both claims; removed after the run."""
    name = f"bagpipe-e2e-{uuid.uuid4().hex[:6]}"
    k.create_namespace(name)
    # Whatever we create has to pass the strictest of Kubernetes' levels.
    k.kubectl("label", "namespace", name, "pod-security.kubernetes.io/enforce=restricted")
    k.kubectl("apply", "-f", "-", given=driver_rights(name))
    k.kubectl("-n", name, "apply", "-f", "-", given=_claims())
    k.start_toolbox(name)
    yield name
    try:
        k.kubectl("delete", "namespace", name, "--wait=true", "--timeout=300s", seconds=320)
    except k.KubectlError as error:
        error.add_note(f"these are left: {'; '.join(jobs.left_in(name))}")
        raise


def _claims() -> str:
    """The example's claims; on several nodes of the embedded cluster for pods on all of them."""
    text = (EXAMPLE / "volumes.yaml").read_text()
    embedded = k.tool_environment()["KUBECONFIG"] == k.EMBEDDED_KUBECONFIG
    if embedded and len(k.items("default", "nodes")) > 1:
        return text.replace("[ReadWriteOnce]", "[ReadWriteMany]")
    return text


def driver_rights(namespace: str) -> str:
    """What the chart gives the drivers of a job namespace, for this one."""
    return subprocess.run(
        [
            *("helm", "template", "bagpipe", str(ROOT / "charts/bagpipe")),
            *("--show-only", "templates/driver-rights.yaml", "--kube-version", "1.34"),
            *("--set-json", f"jobNamespaces={json.dumps([namespace])}"),
            *("--set", "pools.enabled=true"),
        ],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        env=k.tool_environment(),
    ).stdout


@pytest.fixture(scope="session")
def recordings(namespace: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    """The real recording on the claim, and every way in which a bag can be wrong beside it."""
    folder = tmp_path_factory.mktemp("recordings")
    whole = fetch()
    cut = folder / "cut.bag"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    empty = folder / "empty.bag"
    empty.touch()
    text = folder / "text.bag"
    text.write_text("This is no bag.\n")
    k.put(namespace, whole, "pr2/joint_states.bag")
    for bad in (cut, empty, text):
        k.put(namespace, bad, f"bad/{bad.name}")
