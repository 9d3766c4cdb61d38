"""Which jobs an operator runs: by default those of jobNamespaces, with no right elsewhere."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from bagpipe_operator.api.objects import Json
from tests.integration.control_plane.client import Client, core, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.observe import children as made_in
from tests.integration.control_plane.observe import create_jobs, expected_children, statuses
from tests.integration.control_plane.operator_process import OperatorProcess
from tests.integration.control_plane.release import (
    COLLECTIONS,
    OPERATOR,
    Installation,
    apply_chart,
    fresh_namespace,
    installed,
)
from tests.integration.control_plane.server import ControlPlane
from tests.integration.control_plane.test_rights import PODS, await_rights, of_account
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.integration

ROLE_BINDINGS = COLLECTIONS["RoleBinding"]


@pytest.fixture
def elsewhere(admin: Client) -> Iterator[str]:
    """A namespace that no release knows of."""
    with fresh_namespace(admin, "elsewhere") as name:
        yield name


@pytest.fixture
def by_default(
    control_plane: ControlPlane, tmp_path: Path, namespace: str
) -> Iterator[Installation]:
    """A release that knows its namespace of jobs, and no other."""
    values = [f'jobNamespaces=["{namespace}"]']
    with installed(control_plane, tmp_path, values, watched=namespace) as release:
        yield release


@pytest.fixture
def narrow_operator(
    by_default: Installation, namespace: str, tmp_path: Path
) -> Iterator[OperatorProcess]:
    """Its operator, with the environment that its Deployment gives it."""
    environment = {
        "BAGPIPE_LEASE_NAMESPACE": by_default.namespace,
        "BAGPIPE_WATCH_NAMESPACES": namespace,
    }
    process = OperatorProcess(by_default.kubeconfig, tmp_path / "narrow.log", environment)
    yield process.start()
    process.kill()


@pytest.fixture
def of_two(
    control_plane: ControlPlane, tmp_path: Path, namespace: str, elsewhere: str
) -> Iterator[Installation]:
    """A release with two namespaces of jobs."""
    both = json.dumps([namespace, elsewhere])
    with installed(control_plane, tmp_path, [f"jobNamespaces={both}"], watched=namespace) as made:
        yield made


@pytest.fixture
def operator_of_two(
    of_two: Installation, namespace: str, elsewhere: str, tmp_path: Path
) -> Iterator[OperatorProcess]:
    """Its operator, not yet started."""
    environment = {
        "BAGPIPE_LEASE_NAMESPACE": of_two.namespace,
        "BAGPIPE_WATCH_NAMESPACES": f"{elsewhere},{namespace}",
    }
    process = OperatorProcess(
        of_two.kubeconfig, tmp_path / "two.log", environment, of_two.forget_lease
    )
    yield process
    process.kill()


def await_children(admin: Client, namespace: str, job_names: list[str]) -> None:
    """Until the jobs of a namespace have their drivers, and nothing else is there."""
    wanted = expected_children(job_names)
    wait_until(lambda: made_in(admin, namespace) == wanted, 2 * PATIENCE, "a job has no driver")


def await_status(admin: Client, namespace: str, job_name: str) -> None:
    """Until the operator has looked at a job."""
    seen = f"nobody has looked at the job {job_name}"
    wait_until(lambda: statuses(admin, namespace)[job_name] != {}, 2 * PATIENCE, seen)


def operator_s_binding(admin: Client, namespace: str) -> tuple[str, Json]:
    """Where a namespace's RoleBindings are, and the operator's, as it may be created again."""
    bindings = ROLE_BINDINGS.format(namespace=namespace)
    binding = next(
        each for each in admin.items(bindings)
        if any(subject["name"] == OPERATOR for subject in each["subjects"])
    )  # fmt: skip
    return bindings, {**binding, "metadata": {"name": binding["metadata"]["name"]}}


@pytest.mark.usefixtures("narrow_operator")
def test_jobs_run_in_the_namespaces_of_jobs_and_others_are_not_looked_at(
    admin: Client, namespace: str, elsewhere: str
) -> None:
    create_jobs(admin, elsewhere, ["unseen"])
    create_jobs(admin, namespace, ["seen"])
    wanted = expected_children(["seen"])
    wait_until(lambda: made_in(admin, namespace) == wanted, PATIENCE, "the job has no driver")
    assert statuses(admin, elsewhere) == {"unseen": {}}
    assert made_in(admin, elsewhere) == expected_children([])


def test_a_namespace_without_rights_holds_up_no_other_and_goes_on_when_it_has_some(
    admin: Client, namespace: str, elsewhere: str, operator_of_two: OperatorProcess
) -> None:
    """Whoever administers a namespace may delete the RoleBinding there."""
    bindings, binding = operator_s_binding(admin, elsewhere)
    admin.delete(f"{bindings}/{binding['metadata']['name']}")
    operator_of_two.start()
    create_jobs(admin, namespace, ["here"])
    create_jobs(admin, elsewhere, ["there"])
    await_children(admin, namespace, ["here"])
    assert operator_of_two.metric("bagpipe_unlisted_namespaces") == 1.0
    assert f"namespace {elsewhere} can't be watched" in operator_of_two.logged()
    assert statuses(admin, elsewhere) == {"there": {}}
    admin.create(bindings, binding)
    await_status(admin, elsewhere, "there")
    assert operator_of_two.ended() is None


def test_rights_that_go_while_the_operator_watches_hold_up_no_other_namespace(
    control_plane: ControlPlane, namespace: str, elsewhere: str, operator_of_two: OperatorProcess
) -> None:
    """A watch that is open goes on without rights; the API server's restart ends all of them."""
    admin = control_plane.admin
    operator_of_two.start()
    create_jobs(admin, elsewhere, ["before"])
    await_status(admin, elsewhere, "before")
    bindings, binding = operator_s_binding(admin, elsewhere)
    admin.delete(f"{bindings}/{binding['metadata']['name']}")
    control_plane.stop_api_server()
    control_plane.start_api_server()
    create_jobs(admin, elsewhere, ["after"])
    create_jobs(admin, namespace, ["after"])
    await_children(admin, namespace, ["after"])
    unlisted = "bagpipe_unlisted_namespaces"
    noticed = "the metric does not show which namespaces are listed"
    wait_until(lambda: operator_of_two.metric(unlisted) == 1.0, 2 * PATIENCE, noticed)
    assert statuses(admin, elsewhere)["after"] == {}
    assert operator_of_two.ask("/readyz") == (200, "ok\n")
    admin.create(bindings, binding)
    await_status(admin, elsewhere, "after")
    wait_until(lambda: operator_of_two.metric(unlisted) == 0.0, 2 * PATIENCE, noticed)
    assert operator_of_two.ended() is None


def test_a_namespace_is_made_ready_without_touching_the_release(
    admin: Client, elsewhere: str, operator_process: StartOperator
) -> None:
    operator_process()
    secrets = ['serviceAccounts.imagePullSecrets=[{"name":"login"}]']
    apply_chart(admin, elsewhere, ["driver-rights.yaml"], secrets, chart="bagpipe-namespace")
    create_jobs(admin, elsewhere, ["new"])
    wanted = expected_children(["new"])
    wait_until(lambda: made_in(admin, elsewhere) == wanted, PATIENCE, "the job has no driver")
    driver = admin.get(core(elsewhere, "pods", "new-1-driver"))
    assert driver["spec"]["imagePullSecrets"] == [{"name": "login"}]
    await_rights(admin, elsewhere, "bagpipe-driver", elsewhere, PODS)
    assert of_account(admin, elsewhere, "bagpipe-executor", elsewhere) == set()


def test_cluster_wide_a_job_without_accounts_names_what_is_missing(
    admin: Client, elsewhere: str, operator_process: StartOperator
) -> None:
    process = operator_process(BAGPIPE_LOG_FORMAT="json")
    create_jobs(admin, elsewhere, ["lost"])

    def refused() -> list[str]:
        found = admin.get(jobs(elsewhere, "lost")).get("status", {}).get("conditions", [])
        return [c["reason"] for c in found if c["type"] == "Accepted"]

    wait_until(lambda: bool(refused()), PATIENCE, "the operator reported nothing about the job")
    assert refused() == ["ServiceAccountMissing"]
    assert admin.items(core(elsewhere, "pods")) == []
    lines = [json.loads(line) for line in process.logged().splitlines()]
    assert "watching all namespaces" in {line["message"] for line in lines}
