"""Fixtures around a real control plane; see server.py, operator_process.py, fake_kubelet.py."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from tests.integration.control_plane import server
from tests.integration.control_plane.client import Client
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.integration.control_plane.operator_process import OperatorProcess
from tests.integration.control_plane.release import (
    CLUSTER_WIDE,
    ROOT,
    Installation,
    bound,
    find_helm,
    installed,
    job_namespace,
)
from tests.integration.control_plane.server import ControlPlane

StartOperator = Callable[..., OperatorProcess]


@pytest.fixture(scope="session")
def control_plane() -> Iterator[ControlPlane]:
    """etcd, API server and controllers of this run's own, with the CRD."""
    plane = server.prepare()
    try:
        plane.start([yaml.safe_load(p.read_text()) for p in sorted((ROOT / "crds").glob("*.yaml"))])
        yield plane
    finally:
        plane.stop()


@pytest.fixture(scope="session")
def admin(control_plane: ControlPlane) -> Client:
    """The administrator."""
    return control_plane.admin


@pytest.fixture(scope="session")
def kubelet(admin: Client) -> FakeKubelet:
    """What says of pods what a kubelet would say."""
    return FakeKubelet(admin)


@pytest.fixture(scope="session")
def _helm() -> None:
    """Helm on PATH."""
    find_helm()


@pytest.fixture
def namespace(admin: Client, _helm: None) -> Iterator[str]:
    """A fresh namespace with the accounts that the chart gives a job namespace."""
    with job_namespace(admin) as name:
        yield name


@pytest.fixture
def bound_claims(admin: Client, namespace: str) -> Iterator[None]:
    """The claims of the tests' jobs, each bound: else a job reports after 2 s what it misses.

    For tests of which Events there are, and of no other.
    """
    with bound(admin, namespace):
        yield


@pytest.fixture
def installation(
    control_plane: ControlPlane, tmp_path: Path, _helm: None
) -> Iterator[Installation]:
    """The operator's account with exactly the chart's rights, for all namespaces."""
    with installed(control_plane, tmp_path, CLUSTER_WIDE, watched="") as release:
        yield release


@pytest.fixture
def operator_process(installation: Installation, tmp_path: Path) -> Iterator[StartOperator]:
    """`operator_process(BAGPIPE_WORKERS="2")` starts an operator and waits until it is ready.

    With `start=False` it is returned as it is. All of them are killed after the test.
    """
    processes: list[OperatorProcess] = []

    def begin(start: bool = True, **environment: str) -> OperatorProcess:
        log = tmp_path / f"operator-{len(processes)}.log"
        lease = {"BAGPIPE_LEASE_NAMESPACE": installation.namespace}
        process = OperatorProcess(
            installation.kubeconfig, log, lease | environment, installation.forget_lease
        )
        processes.append(process)
        return process.start() if start else process

    yield begin
    for process in processes:
        process.kill()
