"""An admission webhook whose backend hangs: a job says so, its deadline counts, and it goes on."""

import contextlib
import socket
from collections.abc import Iterator

import pytest

from bagpipe_operator.api import names
from tests.integration.control_plane.client import Client, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.due_schedules import schedules, start_run
from tests.integration.control_plane.observe import children as made_in
from tests.integration.control_plane.observe import create_jobs, expected_children, statuses
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.integration

WEBHOOKS = "/apis/admissionregistration.k8s.io/v1/validatingwebhookconfigurations"
# Shorter than a webhook's default of ten, after which the API server gives up a handshake, too.
REQUEST_SECONDS = "5"


@contextlib.contextmanager
def hanging_webhook(
    admin: Client,
    namespace: str,
    failure_policy: str,
    condition: str,
    shown: tuple[str, str, str] = ("", "v1", "pods"),
) -> Iterator[None]:
    """Objects of a namespace, by group, version and resource, are shown to a server that takes
    connections and reads nothing."""
    group, version, resource = shown
    with socket.create_server(("127.0.0.1", 0)) as silent:
        webhook = {
            "name": "silent.example.com",
            "clientConfig": {"url": f"https://127.0.0.1:{silent.getsockname()[1]}/"},
            "rules": [{
                "apiGroups": [group], "apiVersions": [version], "operations": ["CREATE"],
                "resources": [resource],
            }],
            "namespaceSelector": {"matchLabels": {"kubernetes.io/metadata.name": namespace}},
            "matchConditions": [{"name": "tried", "expression": condition}],
            "failurePolicy": failure_policy,
            "sideEffects": "None",
            "admissionReviewVersions": ["v1"],
        }  # fmt: skip
        path = f"{WEBHOOKS}/{namespace}"
        admin.create(WEBHOOKS, {"metadata": {"name": namespace}, "webhooks": [webhook]})
        try:
            yield
        finally:
            admin.delete(path)


@pytest.mark.parametrize("failure_policy", ["Fail", "Ignore"])
@pytest.mark.parametrize(
    "condition", ["request.dryRun", "!request.dryRun"], ids=["dry-run", "creation"]
)
def test_a_job_says_that_a_webhook_hangs_and_starts_when_it_does_not(
    admin: Client,
    namespace: str,
    operator_process: StartOperator,
    failure_policy: str,
    condition: str,
) -> None:
    operator_process(BAGPIPE_REQUEST_SECONDS=REQUEST_SECONDS)

    def refused() -> bool:
        found = statuses(admin, namespace)["x"].get("conditions", [])
        reasons = {c["reason"]: c["message"] for c in found if c["type"] == "Accepted"}
        return "webhook" in reasons.get("CreationRefused", "")

    with hanging_webhook(admin, namespace, failure_policy, condition):
        create_jobs(admin, namespace, ["x"])
        wait_until(refused, PATIENCE, "the job does not say that a webhook hangs")
        assert "startTime" in statuses(admin, namespace)["x"]
    wanted = expected_children(["x"])
    wait_until(lambda: made_in(admin, namespace) == wanted, PATIENCE, "the job has no driver")


@pytest.mark.parametrize("failure_policy", ["Fail", "Ignore"])
def test_a_schedule_says_that_a_webhook_hangs_and_starts_its_run_when_it_does_not(
    admin: Client, namespace: str, operator_process: StartOperator, failure_policy: str
) -> None:
    operator_process(BAGPIPE_REQUEST_SECONDS=REQUEST_SECONDS)

    def refused() -> bool:
        schedule = admin.get(schedules(namespace, "nightly"))
        found = schedule.get("status", {}).get("conditions", [])
        reasons = {c["reason"]: c["message"] for c in found if c["type"] == "OnTime"}
        return "webhook" in reasons.get("CreationRefused", "")

    shown = (names.GROUP, names.VERSION, names.PLURAL)
    with hanging_webhook(admin, namespace, failure_policy, "true", shown):
        start_run(admin, namespace, "nightly")
        wait_until(refused, PATIENCE, "the schedule does not say that a webhook hangs")
        assert admin.items(jobs(namespace)) == []
    wait_until(lambda: len(admin.items(jobs(namespace))) == 1, PATIENCE, "the run has no job")
