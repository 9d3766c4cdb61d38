"""Everything that we create is admitted where Pod Security enforces the level restricted."""

import pytest
import yaml
from embedded.api import ApiError

from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pods.driver_pod import driver_pod
from bagpipe_operator.jobs.pods.executor_template import executor_trial
from bagpipe_operator.jobs.pods.job_config import read_spec
from bagpipe_operator.settings import Settings
from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.observe import is_admitted
from tests.integration.control_plane.operator_process import rendered
from tests.unit.operator.builders import make_job
from tests.unit.operator.test_pod_templates import POD
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.integration

GENEROUS = {
    "all that a template has": ("spark.executor.pod", POD | {"labels": {"team": "lanes"}}),
    "the driver's too": ("spark.driver.pod", POD | {"labels": {"team": "lanes"}}),
    "nothing special": ("maxFailedCases", 3),
    "a user of the image": ("stack.securityContext", {"runAsUser": 1000}),
    "an image that writes where it likes": (
        "stack.securityContext", {"readOnlyRootFilesystem": False},
    ),
}  # fmt: skip


@pytest.fixture
def restricted(admin: Client, namespace: str) -> str:
    """A job namespace in which everything that PodSecurity calls restricted is enforced."""
    priority = "/apis/scheduling.k8s.io/v1/priorityclasses"
    if not admin.exists(f"{priority}/nightly"):
        admin.create(priority, {"metadata": {"name": "nightly"}, "value": 10})
    runtime = "/apis/node.k8s.io/v1/runtimeclasses"
    if not admin.exists(f"{runtime}/nvidia"):
        admin.create(runtime, {"metadata": {"name": "nvidia"}, "handler": "nvidia"})
    lax = {"containers": [{"name": "c", "image": "i"}]}
    hasty = {"metadata": {"name": "hasty"}, "spec": lax | {"priorityClassName": "nightly"}}
    # The API server learns from watches: of a new class, and of a namespace's new level.
    wait_until(
        lambda: is_admitted(admin, namespace, hasty, "no PriorityClass"), PATIENCE, "no class"
    )
    level = {"pod-security.kubernetes.io/enforce": "restricted"}
    admin.merge(f"/api/v1/namespaces/{namespace}", {"metadata": {"labels": level}})
    wait_until(lambda: not is_admitted(admin, namespace, hasty), PATIENCE, "it is not enforced")
    return namespace


def pods_of(
    namespace: str, path: str, value: object, settings: Settings | None = None
) -> list[Object]:
    """The driver and an executor of a job, as the operator and Spark make them."""
    job = make_job("x").with_spec(path, value).object
    job["metadata"]["namespace"] = namespace
    view = JobView.from_object(job)
    spec = read_spec(view)
    settings = settings or Settings()
    made = [
        driver_pod(view, spec, 1, settings, "x-1-0a"),
        executor_trial(view, spec, 1, settings),
    ]
    for pod in made:
        affinity = pod["spec"].get("affinity", {})
        if affinity:
            affinity["nodeAffinity"] = {}  # the example's is no whole one
        pod["metadata"].pop("ownerReferences", None)
    return made


@pytest.mark.parametrize("case", GENEROUS)
def test_driver_and_executors_are_admitted(admin: Client, restricted: str, case: str) -> None:
    for pod in pods_of(restricted, *GENEROUS[case]):
        admin.create(core(restricted, "pods") + "?dryRun=All", pod)


def test_pods_that_name_no_user_are_admitted(admin: Client, restricted: str) -> None:
    """As on OpenShift, which gives them one."""
    for pod in pods_of(restricted, "maxFailedCases", 3, Settings(fixed_users=False)):
        made = admin.create(core(restricted, "pods") + "?dryRun=All", pod)
        assert "runAsUser" not in str(made)


def pod_of(template: str, kind: str) -> Object:
    """The pod that a template of the chart makes: itself, or what a Deployment makes it of."""
    objects = [o for o in yaml.safe_load_all(rendered([], "bagpipe-system", [template])) if o]
    (found,) = [o for o in objects if o["kind"] == kind]
    pod: Object = found if kind == "Pod" else found["spec"]["template"]
    return {"metadata": {"name": kind.lower()}, "spec": pod["spec"]}


@pytest.mark.usefixtures("_helm")
@pytest.mark.parametrize(
    ("template", "kind"), [("deployment.yaml", "Deployment"), ("tests/acceptance.yaml", "Pod")]
)
def test_the_operator_s_pod_is_admitted(
    admin: Client, restricted: str, template: str, kind: str
) -> None:
    """And the one of `helm test`, which is made in the same namespace."""
    pod = pod_of(template, kind)
    pod["spec"]["serviceAccountName"] = "default"
    admin.create(core(restricted, "pods") + "?dryRun=All", pod)


LOOSENED = {
    "root": ({"runAsNonRoot": False, "runAsUser": 0}, "runAsNonRoot != true"),
    "the image's user": ({"runAsNonRoot": False}, "runAsNonRoot != true"),
    "usual capabilities": ({"capabilities": {"drop": []}}, "unrestricted capabilities"),
}


@pytest.mark.parametrize("case", LOOSENED)
def test_what_a_job_loosens_is_the_namespace_s_to_allow(
    admin: Client, restricted: str, namespace: str, case: str
) -> None:
    context, violation = LOOSENED[case]
    driver, executor = pods_of(restricted, "stack.securityContext", context)
    path = core(restricted, "pods") + "?dryRun=All"
    admin.create(path, driver)
    with pytest.raises(ApiError, match=violation):
        admin.create(path, executor)
    level = {"pod-security.kubernetes.io/enforce": "baseline"}
    admin.merge(f"/api/v1/namespaces/{namespace}", {"metadata": {"labels": level}})
    wait_until(lambda: is_admitted(admin, namespace, executor), PATIENCE, "baseline refuses it too")


def test_a_job_whose_stack_the_namespace_refuses_says_so_and_starts_nothing(
    admin: Client, restricted: str, operator_process: StartOperator
) -> None:
    operator_process()
    job = make_job("lax").with_spec("stack.securityContext", {"runAsNonRoot": False}).as_written()
    admin.create(jobs(restricted), job)

    def accepted() -> Object | None:
        status = admin.get(jobs(restricted, "lax")).get("status", {})
        found = [c for c in status.get("conditions", []) if c["type"] == "Accepted"]
        return found[0] if found else None

    condition = wait_until(accepted, PATIENCE, "the operator reported nothing about the job")
    assert (condition["status"], condition["reason"]) == ("False", "CreationRefused")
    assert 'violates PodSecurity "restricted' in condition["message"]
    assert (
        'container "stack" must not set securityContext.runAsNonRoot=false' in condition["message"]
    )
    assert admin.items(core(restricted, "pods")) == []


def test_a_job_starts_in_a_restricted_namespace(
    admin: Client, restricted: str, operator_process: StartOperator
) -> None:
    operator_process()
    job = make_job("plain").as_written()
    admin.create(jobs(restricted), job)
    path = core(restricted, "pods", "plain-1-driver")
    wait_until(lambda: admin.exists(path), PATIENCE, "the operator created no driver")
    spec = admin.get(path)["spec"]
    assert not any(v["name"].startswith("kube-api-access") for v in spec["volumes"])
