"""Suspension: whether a job is suspended, and whether its status reports it. Pure."""

from bagpipe_operator.api import conditions, reasons
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.observation import Halt


def suspension(job: JobView) -> Halt | None:
    """The halt of a job that is suspended, or whose suspension has begun."""
    found = conditions.find(job.status.get("conditions") or [], conditions.SUSPENDED)
    if job.spec.get("suspend"):
        return Halt(reasons.JOB_SUSPENDED, "spec.suspend is true: set it to false to go on.")
    if found is not None and found["reason"] == reasons.SUSPENDING:
        return Halt(reasons.JOB_SUSPENDED, "The job goes on when its pods are gone.")
    return None


def rests(job: JobView) -> bool:
    """Whether only an event can bring the job forward: it is suspended, and reported as such."""
    return bool(job.spec.get("suspend")) and is_reported(job)


def is_swept(job: JobView) -> bool:
    """Whether time alone may bring the job forward, so that it is visited every few seconds."""
    return not job.finished and (job.deleting or not rests(job))


def is_reported(job: JobView) -> bool:
    """Whether the status says of the job as it is now that it is suspended, without pods."""
    return job.suspended and job.status.get("observedGeneration") == job.generation
