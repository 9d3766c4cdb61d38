"""The drivers of pools, as the view of the cluster shows them. Pure.

Which driver waits stands in the status of the job that it ran last, which nobody but the operator
writes: a pod that somebody made with the labels of a driver is none.
"""

from bagpipe_operator.api import conditions, names, readings
from bagpipe_operator.jobs.claim import claim_of
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.pools.warm import WarmDriver
from bagpipe_operator.jobs.view import View


def drivers_of_pools(view: View, namespace: str) -> list[WarmDriver]:
    """All of a namespace that have a job, were promised to one, or wait.

    Its jobs take no others, so that those of another namespace cost it nothing.
    """
    pooled = view.pooled(namespace)
    unfinished = (job for job in pooled if not job.finished)
    claims = (claim_of(job.status) for job in unfinished)
    promised = {claim.driver for claim in claims if claim is not None}
    found = (_driver_of(view, job, promised) for job in pooled)
    return [driver for driver in found if driver is not None]


def standing_driver(view: View, job: JobView) -> PodView | None:
    """The pod of a job's last driver that runs, for whatever reason."""
    driver = view.driver(job.uid, int(job.status.get("attempt") or 1))
    container = driver.container(names.CONTAINER_DRIVER) if driver is not None else None
    runs = container is not None and container.running
    return driver if driver is not None and runs and not driver.deleting else None


def _driver_of(view: View, job: JobView, promised: set[str]) -> WarmDriver | None:
    pool = job.status.get("pool") or {}
    pod = standing_driver(view, job)
    if pod is None or not pod.shape or _failed(job):
        return None
    waits = job.finished and pod.uid not in promised
    return WarmDriver(
        uid=pod.uid,
        namespace=job.namespace,
        pool=str(pool.get("name") or ""),
        shape=pod.shape,
        idle_since=readings.moment(job.status.get("completionTime")) if waits else None,
    )


def _failed(job: JobView) -> bool:
    """Whether it ended without having run all cases: such a driver takes no other job."""
    failed = conditions.find(job.status.get("conditions") or [], conditions.FAILED)
    return failed is not None and failed["status"] == "True"
