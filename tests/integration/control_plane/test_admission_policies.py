"""The pods that Bagpipe's accounts may make: the product's own and no others, by the API server."""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml
from embedded.api import ApiError

from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pods.driver_pod import driver_pod
from bagpipe_operator.jobs.pods.executor_template import executor_template, executor_trial
from bagpipe_operator.jobs.pods.job_config import read_spec
from bagpipe_operator.settings import Settings
from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.observe import a_job, await_right, is_admitted
from tests.integration.control_plane.release import ADMISSION, OPERATOR, Installation
from tests.integration.control_plane.server import ControlPlane
from tests.integration.spark_builder import built, spark_classes
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.integration

Change = Callable[[Object], object]


@dataclass(frozen=True)
class Accounts:
    """A job with its driver, and who made the one and is the other."""

    job: JobView
    operator: Client
    driver: Client

    def executor(self) -> Object:
        """What Spark makes, but for Spark's own words."""
        pod = executor_trial(self.job, read_spec(self.job), 1, Settings())
        pod["metadata"]["name"] = "x-1-exec-1"
        return pod

    def second_driver(self) -> Object:
        """What the operator makes when the first is lost."""
        return driver_pod(self.job, read_spec(self.job), 2, Settings(), "x-2-0a")


@pytest.fixture
def accounts(control_plane: ControlPlane, installation: Installation, namespace: str) -> Accounts:
    """The operator has made the driver's pod, whose token this is; the policies are in force."""
    admin = control_plane.admin
    job = JobView.from_object(admin.create(jobs(namespace), a_job("x")))
    first = driver_pod(job, read_spec(job), 1, Settings(), "x-1-0a")
    installation.client.create(core(namespace, "pods"), first)
    token = control_plane.token(namespace, "bagpipe-driver", "x-1-driver")
    found = Accounts(job, installation.client, admin.with_token(token))
    await_right(found.driver, "create", namespace, "pods")
    for client, pod in ((found.driver, found.second_driver()), (found.operator, found.executor())):
        pod["spec"]["serviceAccountName"] = "default"
        await_policy(client, pod)
    return found


def await_policy(client: Client, pod: Object) -> None:
    """The API server has policies, as Roles, from a watch."""
    where = pod["metadata"]["namespace"]
    wait_until(
        lambda: not is_admitted(client, where, pod, "ValidatingAdmissionPolicy"),
        PATIENCE,
        "the policies are not in force",
    )


def with_change(pod: Object, change: Change) -> Object:
    changed = copy.deepcopy(pod)
    change(changed)
    return changed


def volume(pod: Object) -> None:
    pod["spec"]["volumes"].append({"name": "node", "hostPath": {"path": "/"}})


def spec(**fields: object) -> Change:
    return lambda pod: pod["spec"].update(fields)


def label(name: str, value: str) -> Change:
    return lambda pod: pod["metadata"]["labels"].update({f"sim.bagpipe.io/{name}": value})


def security(**fields: object) -> Change:
    # A privileged container that may not escalate is no valid one.
    fields = {"allowPrivilegeEscalation": True} | fields
    return lambda pod: pod["spec"]["containers"][0]["securityContext"].update(fields)


def sidecar(**fields: object) -> Change:
    container = {"name": "own", "image": "example/own:1", "securityContext": fields}
    return lambda pod: pod["spec"].setdefault("initContainers", []).append(container)


WALLS: dict[str, tuple[Change, str]] = {
    "the node's files": (volume, "no hostPath volume"),
    "the node's network": (spec(hostNetwork=True), "no hostNetwork, hostPID or hostIPC"),
    "the node's processes": (spec(hostPID=True), "no hostNetwork, hostPID or hostIPC"),
    "the node's memory": (spec(hostIPC=True), "no hostNetwork, hostPID or hostIPC"),
    "privileges": (security(privileged=True), "no privileged container"),
    "privileges at the start": (sidecar(privileged=True), "no privileged container"),
    "a capability": (security(capabilities={"add": ["SYS_ADMIN"]}), "add no capabilities"),
    "a node": (spec(nodeName="node-1"), "go by the scheduler"),
    "the cluster's priority": (
        spec(priorityClassName="system-node-critical"), "go by the scheduler",
    ),
}  # fmt: skip
OF_DRIVERS: dict[str, tuple[Change, str]] = {
    "another account": (spec(serviceAccountName="default"), "may make executors only"),
    "its own account": (spec(serviceAccountName="bagpipe-driver"), "may make executors only"),
    "a driver": (label("role", "driver"), "may make executors only"),
    "no labels": (lambda pod: pod["metadata"].pop("labels"), "may make executors only"),
    "another job's": (label("job", "y"), "executors of its own job only"),
    "another attempt's": (label("attempt", "2"), "executors of its own job only"),
    "no job's UID": (label("job-uid", ""), "executors of its own job only"),
}
OF_THE_OPERATOR: dict[str, tuple[Change, str]] = {
    "another account": (spec(serviceAccountName="default"), "may make drivers only"),
    "the executors' account": (
        spec(serviceAccountName="bagpipe-executor"), "may make drivers only",
    ),
    "an executor": (label("role", "executor"), "may make drivers only"),
    "no labels": (lambda pod: pod["metadata"].pop("labels"), "may make drivers only"),
    "another name": (lambda pod: pod["metadata"].update(name="own"), "drivers of jobs only"),
    "no owner": (lambda pod: pod["metadata"].pop("ownerReferences"), "drivers of jobs only"),
    "another owner": (label("job-uid", "another"), "drivers of jobs only"),
}  # fmt: skip


def assert_refused(client: Client, pod: Object, sentence: str, query: str = "") -> None:
    with pytest.raises(ApiError) as refused:
        client.create(core(pod["metadata"]["namespace"], "pods") + query, pod)
    assert refused.value.status == 403
    assert sentence in str(refused.value)
    assert "ValidatingAdmissionPolicy" in str(refused.value)


def test_a_driver_makes_executors_of_its_job_and_nothing_else(accounts: Accounts) -> None:
    pod = accounts.executor()
    for change, sentence in [*OF_DRIVERS.values(), *WALLS.values()]:
        assert_refused(accounts.driver, with_change(pod, change), sentence)
    accounts.driver.create(core(accounts.job.namespace, "pods"), pod)


def test_the_operator_makes_drivers_of_jobs_and_nothing_else(accounts: Accounts) -> None:
    pod = accounts.second_driver()
    for change, sentence in [*OF_THE_OPERATOR.values(), *WALLS.values()]:
        assert_refused(accounts.operator, with_change(pod, change), sentence)
    accounts.operator.create(core(accounts.job.namespace, "pods"), pod)


def test_the_operator_shows_an_executor_and_keeps_none(accounts: Accounts) -> None:
    pod = accounts.executor()
    assert_refused(accounts.operator, pod, "may make drivers only")
    accounts.operator.create(core(accounts.job.namespace, "pods") + "?dryRun=All", pod)
    for change, sentence in WALLS.values():
        assert_refused(accounts.operator, with_change(pod, change), sentence, "?dryRun=All")


def test_cluster_wide_the_operator_s_token_makes_no_pods_of_other_accounts(
    accounts: Accounts, installation: Installation
) -> None:
    """It has the right to make pods there: nothing but the policy is in its way."""
    for where in ("kube-system", "default", installation.namespace):
        await_right(accounts.operator, "create", where, "pods")
        pod = accounts.second_driver()
        pod["metadata"]["namespace"] = where
        pod["spec"]["serviceAccountName"] = "default"
        assert_refused(accounts.operator, pod, "may make drivers only")


def test_a_driver_s_account_without_a_driver_makes_no_pods(
    accounts: Accounts, control_plane: ControlPlane
) -> None:
    """Who may ask for tokens of the account gets none that is a driver's."""
    token = control_plane.token(accounts.job.namespace, "bagpipe-driver")
    loose = control_plane.admin.with_token(token)
    assert_refused(loose, accounts.executor(), "executors of its own job only")


def test_executors_as_spark_builds_them_are_admitted(accounts: Accounts, tmp_path: Path) -> None:
    template = tmp_path / "executor.yaml"
    job = accounts.job
    template.write_text(yaml.safe_dump(executor_template(job, read_spec(job), 1, Settings())))
    with spark_classes() as jvm:
        pod, spark = built(jvm, template)
    pod["metadata"]["namespace"] = job.namespace
    pod["spec"]["containers"] = [spark]
    made = accounts.driver.create(core(job.namespace, "pods"), pod)
    assert made["metadata"]["labels"]["spark-role"] == "executor"


def test_what_a_service_mesh_adds_is_admitted(accounts: Accounts) -> None:
    mesh = sidecar(runAsUser=0, capabilities={"add": ["NET_ADMIN", "NET_RAW"], "drop": ["ALL"]})
    pod = with_change(accounts.executor(), mesh)
    accounts.driver.create(core(accounts.job.namespace, "pods"), pod)


def test_others_pods_are_their_own_affair(accounts: Accounts, admin: Client) -> None:
    for change, _ in WALLS.values():
        pod = with_change(accounts.executor(), change)
        admin.create(core(accounts.job.namespace, "pods") + "?dryRun=All", pod)


def test_the_api_server_finds_no_fault_with_the_expressions(
    admin: Client, installation: Installation
) -> None:
    """It checks their types against a pod's schema, and only writes down what does not fit."""
    for name in ("drivers", "pods"):
        path = f"{ADMISSION}/validatingadmissionpolicies/{installation.namespace}-{OPERATOR}-{name}"

        def status(path: str = path) -> Object:
            found: Object = admin.get(path).get("status", {})
            return found

        wait_until(lambda: "typeChecking" in status(), PATIENCE, "the types were not checked")
        assert status()["typeChecking"] == {}
