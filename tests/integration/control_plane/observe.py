"""What tests of whole operators look at: jobs, their children, and who leads."""

from collections.abc import Iterable
from datetime import datetime

from embedded.api import ApiError

from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.operator_process import OperatorProcess
from tests.unit.operator.builders import make_job
from tests.waiting import PATIENCE, wait_until

UID_LABEL = "sim.bagpipe.io/job-uid"


def a_job(name: str) -> Object:
    """A small valid job, without what the API server sets."""
    return make_job(name).as_written()


def create_jobs(admin: Client, namespace: str, names: Iterable[str]) -> None:
    """Creates small jobs."""
    for name in names:
        admin.create(jobs(namespace), a_job(name))


def children(admin: Client, namespace: str) -> dict[str, list[str]]:
    """The names of all pods and ConfigMaps of jobs, sorted, by resource.

    Those of ConfigMaps without their last part, which says what is in them.
    """
    found = {
        resource: [
            o["metadata"]["name"]
            for o in admin.items(f"{core(namespace, resource)}?labelSelector={UID_LABEL}")
        ]
        for resource in ("pods", "configmaps")
    }
    stems = [name.rpartition("-")[0] for name in found["configmaps"]]
    return {"pods": sorted(found["pods"]), "configmaps": sorted(stems)}


def expected_children(names: Iterable[str]) -> dict[str, list[str]]:
    """What jobs of these names have: one driver and one ConfigMap each, of the first attempt."""
    given = sorted(names)
    return {
        "pods": sorted(f"{name}-1-driver" for name in given),
        "configmaps": sorted(f"{name}-1" for name in given),
    }


def statuses(admin: Client, namespace: str) -> dict[str, Object]:
    """The status of each job, by name."""
    return {o["metadata"]["name"]: o.get("status") or {} for o in admin.items(jobs(namespace))}


def await_phase(admin: Client, namespace: str, phase: str, count: int) -> None:
    """Waits until so many jobs are in a phase."""

    def reached() -> bool:
        found = [s.get("phase") for s in statuses(admin, namespace).values()]
        return found.count(phase) == count

    wait_until(reached, PATIENCE, f"{count} jobs did not become {phase}")


def leads(process: OperatorProcess) -> bool:
    """Whether a replica says that it leads."""
    return process.metric("bagpipe_leader") == 1.0


def await_lead(process: OperatorProcess, seconds: float = PATIENCE) -> None:
    """Waits until a replica leads."""
    wait_until(lambda: leads(process), seconds, f"it did not lead within {seconds:g} s")


def limit_pods(admin: Client, namespace: str, name: str, count: int) -> str:
    """A quota of so many pods that is in force; gives its path."""
    quotas = core(namespace, "resourcequotas")
    admin.create(quotas, {"metadata": {"name": name}, "spec": {"hard": {"pods": str(count)}}})
    path = f"{quotas}/{name}"
    wait_until(lambda: "used" in admin.get(path).get("status", {}), PATIENCE, "it is not counted")
    return path


def is_admitted(
    admin: Client, namespace: str, pod: Object, refusal: str = "violates PodSecurity"
) -> bool:
    """Whether Pod Security, or who else refuses so, lets a pod pass; other refusals are errors."""
    try:
        admin.create(core(namespace, "pods") + "?dryRun=All", pod)
    except ApiError as error:
        assert refusal in str(error), error
        return False
    return True


def await_right(client: Client, verb: str, namespace: str, resource: str, group: str = "") -> None:
    """Waits until the API server's authorizer, which has Roles from a watch, knows of a right."""
    asked = {"verb": verb, "namespace": namespace, "resource": resource, "group": group}
    review = {"spec": {"resourceAttributes": asked}}

    def allowed() -> bool:
        path = "/apis/authorization.k8s.io/v1/selfsubjectaccessreviews"
        return bool(client.create(path, review)["status"]["allowed"])

    wait_until(allowed, PATIENCE, f"nobody may {verb} {resource} in {namespace}")


def moment(text: str) -> datetime:
    """A moment as the API server writes it."""
    return datetime.fromisoformat(text)
