"""A job that is deleted while somebody's finalizer keeps it, on a real API server."""

from tests.integration.control_plane.client import Client, core, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.observe import a_job, await_phase
from tests.waiting import PATIENCE, wait_until


def test_it_gives_its_pods_back_and_ends_and_is_gone_with_its_finalizer(
    admin: Client, namespace: str, operator_process: StartOperator
) -> None:
    operator = operator_process()
    job = a_job("kept")
    job["metadata"]["finalizers"] = ["example.com/mine"]
    admin.create(jobs(namespace), job)
    driver = core(namespace, "pods", "kept-1-driver")
    wait_until(lambda: admin.exists(driver), PATIENCE, "no driver was made")
    admin.delete(jobs(namespace, "kept"))
    await_phase(admin, namespace, "Failed", 1)
    assert not admin.exists(driver)
    status = admin.get(jobs(namespace, "kept"))["status"]
    failed = next(c for c in status["conditions"] if c["type"] == "Failed")
    assert failed["reason"] == "JobDeleted"
    assert operator.metric("bagpipe_status_age_seconds") == 0
    admin.merge(jobs(namespace, "kept"), {"metadata": {"finalizers": None}})
    wait_until(
        lambda: operator.metric('bagpipe_jobs{phase="Failed"}') == 0, PATIENCE, "it is not gone"
    )
    assert not admin.exists(jobs(namespace, "kept"))
