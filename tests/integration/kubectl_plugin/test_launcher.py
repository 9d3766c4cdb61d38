"""The plugin's archive, unpacked into a folder of PATH and called by a real kubectl."""

import os
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest
from embedded import tools

from tests.unit.bagpipe.bags import steady, write_bag

ROOT = Path(__file__).parents[3]
INSTALL_SECONDS = 300
SECONDS = 60


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """PATH with kubectl and the unpacked plugin, as after krew and a link for completion."""
    folder = tmp_path_factory.mktemp("plugin")
    packing = [sys.executable, str(ROOT / "images/build/plugin.py"), str(folder)]
    subprocess.run(packing, check=True, timeout=INSTALL_SECONDS)
    unpacked = folder / "unpacked"
    with tarfile.open(folder / "kubectl-bagpipe-v0.2.0.tar.gz") as tar:
        tar.extractall(unpacked, filter="data")
    path = f"{tools.link()}:{unpacked}:{os.environ['PATH']}"
    return {**os.environ, "PATH": path, "KUBECONFIG": str(folder / "none")}


def kubectl(environment: dict[str, str], *words: str, seconds: float = SECONDS) -> tuple[int, str]:
    done = subprocess.run(
        ["kubectl", *words], env=environment, capture_output=True, text=True, timeout=seconds,
        check=False,
    )  # fmt: skip
    return done.returncode, done.stdout + done.stderr


# pip fetches and installs for half a minute.
@pytest.mark.slow
@pytest.mark.timeout(INSTALL_SECONDS + 3 * SECONDS)
def test_kubectl_finds_installs_and_completes_the_plugin(
    environment: dict[str, str], tmp_path: Path
) -> None:
    # Before it is installed, Tab waits for nothing.
    assert "watch" not in kubectl(environment, "__complete", "bagpipe", "wat")[1]
    status, text = kubectl(environment, "bagpipe", "--version", seconds=INSTALL_SECONDS)
    assert status == 0, text
    assert "kubectl bagpipe, version 0.2.0" in text.splitlines()
    assert "installing bagpipe's packages into" in text
    status, text = kubectl(environment, "bagpipe", "watch", "nightly")
    assert (status, "there is no kubeconfig" in text) == (2, True)
    assert "installing" not in text
    status, text = kubectl(environment, "__complete", "bagpipe", "wat")
    assert (status, text.splitlines()[:2]) == (
        0,
        ["watch\tFollow a job in the cluster to its end.", ":4"],
    )
    # It reads recordings, by the native module.
    bag = tmp_path / "steady.bag"
    write_bag(bag, steady("/scan", 10, 50_000_000))
    status, text = kubectl(environment, "bagpipe", "bag", "info", str(bag))
    assert (status, "/scan" in text) == (0, True), text
    status, text = kubectl(environment, "plugin", "list")
    assert "kubectl-bagpipe" in text
