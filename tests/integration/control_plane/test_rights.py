"""What accounts and users may do, asked of the real API server with the chart's Roles."""

import itertools
from collections.abc import Iterator

import pytest
import yaml
from embedded.api import ApiError

from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.observe import await_right
from tests.integration.control_plane.operator_process import rendered
from tests.integration.control_plane.release import (
    Installation,
    apply_chart,
    fresh_namespace,
    job_namespace,
)
from tests.integration.control_plane.server import ControlPlane
from tests.unit.operator.builders import make_job
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.integration

RBAC = "/apis/rbac.authorization.k8s.io/v1"
VERBS = ("get", "list", "watch", "create", "update", "patch", "delete", "deletecollection")
RESOURCES = (
    ("", "pods"), ("", "pods/exec"), ("", "pods/log"), ("", "pods/ephemeralcontainers"),
    ("", "secrets"), ("", "configmaps"), ("", "events"), ("", "serviceaccounts"),
    ("", "serviceaccounts/token"), ("", "persistentvolumeclaims"), ("", "services"), ("", "nodes"),
    ("", "namespaces"), ("apps", "deployments"), ("batch", "jobs"),
    ("sim.bagpipe.io", "simulationjobs"), ("sim.bagpipe.io", "simulationjobs/status"),
    ("sim.bagpipe.io", "simulationjobs/finalizers"), ("sim.bagpipe.io", "simulationschedules"),
    ("sim.bagpipe.io", "simulationschedules/status"), ("rbac.authorization.k8s.io", "roles"),
    ("rbac.authorization.k8s.io", "rolebindings"),
    ("apiextensions.k8s.io", "customresourcedefinitions"),
)  # fmt: skip


def rights(
    admin: Client, user: str, groups: list[str], namespace: str, of_group: str | None = None
) -> set[str]:
    """All that a user may do in a namespace ("" for everywhere), as `verb resource`."""
    found = set()
    resources = [each for each in RESOURCES if of_group is None or each[0] == of_group]
    for (group, resource), verb in itertools.product(resources, VERBS):
        kind, _, below = resource.partition("/")
        asked = {"verb": verb, "group": group, "resource": kind, "subresource": below}
        answer = admin.create(
            "/apis/authorization.k8s.io/v1/subjectaccessreviews",
            {"spec": {"user": user, "groups": groups,
                      "resourceAttributes": asked | {"namespace": namespace}}},
        )  # fmt: skip
        if answer["status"]["allowed"]:
            found.add(f"{verb} {resource}")
    return found


def of_account(admin: Client, home: str, account: str, namespace: str) -> set[str]:
    groups = ["system:serviceaccounts", f"system:serviceaccounts:{home}", "system:authenticated"]
    return rights(admin, f"system:serviceaccount:{home}:{account}", groups, namespace)


def await_rights(
    admin: Client, home: str, account: str, namespace: str, expected: set[str]
) -> None:
    """Until an account has just these rights: Roles come to the authorizer by a watch."""
    found: set[str] = set()

    def had() -> bool:
        found.clear()
        found.update(of_account(admin, home, account, namespace))
        return found == expected

    try:
        wait_until(had, PATIENCE, "")
    except AssertionError:
        assert found == expected


@pytest.fixture
def other(admin: Client) -> Iterator[str]:
    """Another team's namespace, with jobs of its own."""
    with job_namespace(admin, "other") as name:
        yield name


PODS = {f"{verb} pods" for verb in VERBS} - {"update pods", "patch pods"}
OPERATOR = {
    "get pods", "list pods", "watch pods", "create pods", "delete pods", "get configmaps",
    "create configmaps", "create events", "list events", "get persistentvolumeclaims",
    "get simulationjobs", "list simulationjobs", "watch simulationjobs", "create simulationjobs",
    "delete simulationjobs", "patch simulationjobs/status", "get simulationschedules",
    "list simulationschedules", "watch simulationschedules", "patch simulationschedules/status",
}  # fmt: skip


def test_a_driver_may_do_with_pods_of_its_namespace_what_spark_does(
    admin: Client, namespace: str, other: str
) -> None:
    await_rights(admin, namespace, "bagpipe-driver", namespace, PODS)
    for elsewhere in (other, "kube-system", ""):
        assert of_account(admin, namespace, "bagpipe-driver", elsewhere) == set()


def test_executors_may_do_nothing(admin: Client, namespace: str) -> None:
    # Theirs would be known by then as well.
    await_rights(admin, namespace, "bagpipe-driver", namespace, PODS)
    for where in (namespace, "kube-system", ""):
        assert of_account(admin, namespace, "bagpipe-executor", where) == set()


def test_the_operator_of_a_cluster(
    admin: Client, installation: Installation, namespace: str
) -> None:
    home = installation.namespace
    for where in (namespace, ""):
        await_rights(admin, home, "bagpipe-operator", where, OPERATOR)


@pytest.fixture
def narrow(admin: Client, namespace: str) -> Iterator[str]:
    """The namespace of a release as it is by default, with jobs in `namespace` alone."""
    with fresh_namespace(admin, "narrow") as home:
        values = [f'jobNamespaces=["{namespace}"]']
        apply_chart(admin, home, ["serviceaccount.yaml", "operator-rights.yaml"], values)
        yield home


def test_the_operator_of_a_namespace_may_do_the_same_there_and_nothing_elsewhere(
    admin: Client, narrow: str, namespace: str, other: str
) -> None:
    await_rights(admin, narrow, "bagpipe-operator", namespace, OPERATOR)
    for elsewhere in (other, narrow, "kube-system", ""):
        assert of_account(admin, narrow, "bagpipe-operator", elsewhere) == set()


@pytest.fixture
def user(control_plane: ControlPlane, namespace: str) -> Client:
    """Somebody who may create jobs in `namespace`, and nothing else."""
    admin = control_plane.admin
    admin.create(core(namespace, "serviceaccounts"), {"metadata": {"name": "developer"}})
    rule = {
        "apiGroups": ["sim.bagpipe.io"],
        "resources": ["simulationjobs"],
        "verbs": ["get", "list", "watch", "create", "delete"],
    }
    path = f"{RBAC}/namespaces/{namespace}"
    admin.create(f"{path}/roles", {"metadata": {"name": "developer"}, "rules": [rule]})
    binding = {
        "metadata": {"name": "developer"},
        "roleRef": {"apiGroup": "rbac.authorization.k8s.io", "kind": "Role", "name": "developer"},
        "subjects": [{"kind": "ServiceAccount", "name": "developer", "namespace": namespace}],
    }
    admin.create(f"{path}/rolebindings", binding)
    client = admin.with_token(control_plane.token(namespace, "developer"))
    await_right(client, "delete", namespace, "simulationjobs", "sim.bagpipe.io")
    return client


def a_job(**changed: str) -> Object:
    return make_job("mine").as_written(**changed)


def test_a_user_s_jobs_stay_in_the_user_s_namespace(
    user: Client, admin: Client, namespace: str, other: str
) -> None:
    user.create(jobs(namespace), a_job())
    forbidden: list[tuple[str, str, Object | None]] = [
        ("POST", jobs(other), a_job()),
        ("GET", jobs(other), None),
        ("GET", core(other, "pods"), None),
        ("GET", core(namespace, "secrets"), None),
        ("GET", core("kube-system", "secrets"), None),
        ("POST", core(namespace, "serviceaccounts", "bagpipe-driver") + "/token", {"spec": {}}),
        ("PATCH", jobs(namespace, "mine") + "/status", {"status": {"phase": "Complete"}}),
    ]
    for method, path, body in forbidden:
        with pytest.raises(ApiError) as refused:
            if method == "PATCH":
                user.merge(path, body or {})
            else:
                user.call(method, path, body)
        assert (refused.value.status, path) == (403, path)
    # A manifest that names another namespace than the path it is sent to is refused as well.
    with pytest.raises(ApiError) as mixed:
        user.create(jobs(namespace), a_job(namespace=other))
    assert mixed.value.status == 400
    assert admin.items(jobs(other)) == []


def test_a_forged_status_of_a_new_job_is_dropped(user: Client, namespace: str) -> None:
    forged = a_job() | {"status": {"phase": "Complete", "driver": "another-1-driver"}}
    assert "status" not in user.create(jobs(namespace), forged)


@pytest.mark.usefixtures("_helm")
def test_the_api_server_takes_the_network_policies(admin: Client, namespace: str) -> None:
    peer = '[{"namespaceSelector":{"matchLabels":{"kubernetes.io/metadata.name":"monitoring"}}}]'
    text = rendered(
        [f'jobNamespaces=["{namespace}"]', "networkPolicy.enabled=true",
         f"networkPolicy.metricsFrom={peer}"],
        "default", ["network-policies.yaml"],
    )  # fmt: skip
    policies = [p for p in yaml.safe_load_all(text) if p]
    for policy in policies:
        where = policy["metadata"]["namespace"]
        path = f"/apis/networking.k8s.io/v1/namespaces/{where}/networkpolicies"
        kept = admin.create(path + "?dryRun=All&fieldValidation=Strict", policy)
        assert kept["spec"] == policy["spec"]
    assert len(policies) == 3
