"""A release of the chart on the throwaway control plane: namespaces, accounts, rights."""

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

import yaml
from embedded import tools

from tests.integration.control_plane.client import JOBS, Client, core
from tests.integration.control_plane.observe import await_right
from tests.integration.control_plane.operator_process import rendered
from tests.integration.control_plane.server import ControlPlane
from tests.waiting import PATIENCE, wait_until

ROOT = Path(__file__).parents[3]
OPERATOR = "bagpipe-operator"
OPERATOR_TEMPLATES = [
    "serviceaccount.yaml", "operator-rights.yaml", "lease-rights.yaml", "admission-policies.yaml",
]  # fmt: skip
# Values of a release whose operator watches all namespaces.
CLUSTER_WIDE = ["clusterWide=true"]
ADMISSION = "/apis/admissionregistration.k8s.io/v1"
LEASES = "/apis/coordination.k8s.io/v1/namespaces/{namespace}/leases"
COLLECTIONS = {
    "ServiceAccount": "/api/v1/namespaces/{namespace}/serviceaccounts",
    "Role": "/apis/rbac.authorization.k8s.io/v1/namespaces/{namespace}/roles",
    "RoleBinding": "/apis/rbac.authorization.k8s.io/v1/namespaces/{namespace}/rolebindings",
    "ClusterRole": "/apis/rbac.authorization.k8s.io/v1/clusterroles",
    "ClusterRoleBinding": "/apis/rbac.authorization.k8s.io/v1/clusterrolebindings",
    "ValidatingAdmissionPolicy": f"{ADMISSION}/validatingadmissionpolicies",
    "ValidatingAdmissionPolicyBinding": f"{ADMISSION}/validatingadmissionpolicybindings",
}
CLAIMS = ("recordings", "results")


@dataclass(frozen=True)
class Installation:
    """A release of the chart without its pod: a namespace, an account, its rights, its token."""

    namespace: str
    kubeconfig: Path
    client: Client
    admin: Client

    @property
    def lease(self) -> str:
        """The path of the Lease that its operators lead by."""
        return f"{LEASES.format(namespace=self.namespace)}/{OPERATOR}"

    def forget_lease(self) -> None:
        """Removes that Lease."""
        self.admin.delete(self.lease)


def find_helm() -> None:
    """Helm on PATH: the machine's if it is new enough, else the one that tests/cluster builds."""
    os.environ["PATH"] = f"{tools.link()}:{os.environ['PATH']}"


@contextlib.contextmanager
def installed(
    control_plane: ControlPlane, folder: Path, values: list[str], watched: str
) -> Iterator[Installation]:
    """A release in a namespace of its own, whose operator may watch `watched` ("" for all).

    Its account has exactly the chart's rights, and its kubeconfig is put into the folder.
    """
    admin = control_plane.admin
    with fresh_namespace(admin, "system") as name:
        made = apply_chart(admin, name, OPERATOR_TEMPLATES, values)
        token = control_plane.token(name, OPERATOR)
        kubeconfig = folder / f"{name}.kubeconfig"
        control_plane.write_kubeconfig(kubeconfig, token)
        client = admin.with_token(token)
        await_right(client, "list", watched, "pods")
        await_right(client, "create", name, "leases", "coordination.k8s.io")
        yield Installation(name, kubeconfig, client, admin)
        for path in made:
            admin.delete(path)


@contextlib.contextmanager
def job_namespace(admin: Client, purpose: str = "jobs") -> Iterator[str]:
    """A fresh namespace with the accounts that the chart gives a job namespace."""
    with fresh_namespace(admin, purpose) as name:
        chart = [f'jobNamespaces=["{name}"]']
        apply_chart(admin, "bagpipe-system", ["driver-rights.yaml"], chart)
        yield name


@contextlib.contextmanager
def fresh_namespace(admin: Client, purpose: str) -> Iterator[str]:
    """A namespace with its default account; its deletion is asked for and not waited for."""
    name = f"{purpose}-{uuid4().hex[:8]}"
    admin.create("/api/v1/namespaces", {"metadata": {"name": name}})
    account = f"/api/v1/namespaces/{name}/serviceaccounts/default"
    wait_until(lambda: admin.exists(account), PATIENCE, f"{account} was not made")
    yield name
    # A namespace takes its time to go, and the next test's operator would see its jobs and count.
    for kind in ("simulationschedules", "simulationjobs"):
        admin.delete(f"{JOBS}/namespaces/{name}/{kind}")
    # Nobody else would say of a bound pod that it has ended.
    admin.delete(core(name, "pods"), grace_seconds=0)
    admin.delete(f"/api/v1/namespaces/{name}")


@contextlib.contextmanager
def bound(admin: Client, namespace: str) -> Iterator[None]:
    """The claims of the tests' jobs in a namespace, with a volume each."""
    volumes = "/api/v1/persistentvolumes"
    claims = core(namespace, "persistentvolumeclaims")
    common = {"storageClassName": "", "accessModes": ["ReadWriteOnce"]}
    for name in CLAIMS:
        volume = common | {
            "capacity": {"storage": "1Gi"},
            "hostPath": {"path": "/nowhere"},
            "claimRef": {"namespace": namespace, "name": name},
        }
        admin.create(volumes, {"metadata": {"name": f"{namespace}-{name}"}, "spec": volume})
        claim = common | {
            "volumeName": f"{namespace}-{name}",
            "resources": {"requests": {"storage": "1Gi"}},
        }
        admin.create(claims, {"metadata": {"name": name}, "spec": claim})

    def are_bound() -> bool:
        return all(claim["status"].get("phase") == "Bound" for claim in admin.items(claims))

    wait_until(are_bound, PATIENCE, "the claims were not bound")
    yield
    for name in CLAIMS:
        admin.delete(f"{volumes}/{namespace}-{name}")


def apply_chart(
    admin: Client,
    namespace: str,
    templates: list[str],
    values: list[str] | None = None,
    chart: str = "bagpipe",
) -> list[str]:
    """Creates what templates of a chart render; the paths of what was made."""
    made = []
    for obj in yaml.safe_load_all(rendered(values or [], namespace, templates, chart)):
        if obj:
            where = obj["metadata"].get("namespace", "")
            collection = COLLECTIONS[obj["kind"]].format(namespace=where)
            admin.create(collection, obj)
            made.append(f"{collection}/{obj['metadata']['name']}")
    return made
