"""What people of Kubernetes' own roles may do with jobs, by the chart's aggregated ClusterRoles."""

from collections.abc import Iterator

import pytest

from tests.integration.control_plane.client import Client
from tests.integration.control_plane.release import apply_chart
from tests.integration.control_plane.test_rights import RBAC, VERBS, rights
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.integration

KINDS = ("simulationjobs", "simulationschedules")
READ = {f"{verb} {kind}" for verb in ("get", "list", "watch") for kind in KINDS}
READ_STATUS = {f"get {kind}/status" for kind in ("simulationjobs", "simulationschedules")}
ALL = {f"{verb} {kind}" for verb in VERBS for kind in KINDS}
EXPECTED = {
    "view": READ | READ_STATUS,
    "edit": ALL | READ_STATUS,
    "admin": ALL | READ_STATUS,
}


@pytest.fixture
def team(admin: Client, namespace: str) -> Iterator[str]:
    """A namespace in which a person each has one of Kubernetes' roles, and the chart's beside."""
    made = apply_chart(admin, "bagpipe-system", ["user-roles.yaml"])
    for role in EXPECTED:
        subject = {"kind": "User", "name": f"{role}er", "apiGroup": "rbac.authorization.k8s.io"}
        reference = {"kind": "ClusterRole", "name": role, "apiGroup": "rbac.authorization.k8s.io"}
        binding = {"metadata": {"name": role}, "roleRef": reference, "subjects": [subject]}
        admin.create(f"{RBAC}/namespaces/{namespace}/rolebindings", binding)
    yield namespace
    for path in made:
        admin.delete(path)


def of_jobs(admin: Client, role: str, namespace: str) -> set[str]:
    found = rights(admin, f"{role}er", ["system:authenticated"], namespace, "sim.bagpipe.io")
    return {right for right in found if "simulation" in right}


def test_readers_read_and_editors_write_and_nobody_writes_a_status(
    admin: Client, team: str
) -> None:
    for role, expected in EXPECTED.items():

        def had(role: str = role, expected: set[str] = expected) -> bool:
            return of_jobs(admin, role, team) == expected

        wait_until(had, PATIENCE, f"{role} has other rights than it should")
        assert of_jobs(admin, role, "default") == set()
