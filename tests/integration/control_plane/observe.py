"""What tests of whole operators look at: jobs, their children, and who leads."""

from collections.abc import Iterable
from datetime import datetime

from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.operator_process import OperatorProcess
from tests.integration.storage.servers import wait_until
from tests.unit.operator.builders import make_job

UID_LABEL = "sim.bagpipe.io/job-uid"


def a_job(name: str) -> Object:
    """A small valid job, without what the API server sets."""
    job = make_job(name).object
    job["metadata"] = {"name": name}
    return job


def create_jobs(admin: Client, namespace: str, names: Iterable[str]) -> None:
    """Creates small jobs."""
    for name in names:
        admin.create(jobs(namespace), a_job(name))


def children(admin: Client, namespace: str) -> dict[str, list[str]]:
    """The names of all pods and ConfigMaps of jobs, sorted, by resource."""
    return {
        resource: sorted(
            o["metadata"]["name"]
            for o in admin.items(f"{core(namespace, resource)}?labelSelector={UID_LABEL}")
        )
        for resource in ("pods", "configmaps")
    }


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


def await_phase(admin: Client, namespace: str, phase: str, count: int, seconds: float) -> None:
    """Waits until so many jobs are in a phase."""

    def reached() -> bool:
        found = [s.get("phase") for s in statuses(admin, namespace).values()]
        return found.count(phase) == count

    wait_until(reached, seconds, f"{count} jobs did not become {phase} within {seconds:g} s")


def leads(process: OperatorProcess) -> bool:
    """Whether a replica says that it leads."""
    return process.metric("bagpipe_leader") == 1.0


def await_lead(process: OperatorProcess, seconds: float) -> None:
    """Waits until a replica leads."""
    wait_until(lambda: leads(process), seconds, f"it did not lead within {seconds:g} s")


def moment(text: str) -> datetime:
    """A moment as the API server writes it."""
    return datetime.fromisoformat(text)
