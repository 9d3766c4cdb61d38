"""Suspension: whether a job rests, and whether that is told. Pure."""

from bagpipe_operator.api import conditions, reasons
from bagpipe_operator.jobs.observation import Halt
from bagpipe_operator.jobs.view import JobView


def suspension(job: JobView) -> Halt | None:
    """The halt of a job that is suspended, or whose suspension has begun."""
    said = conditions.find(job.status.get("conditions") or [], conditions.SUSPENDED)
    if job.spec.get("suspend"):
        return Halt(reasons.JOB_SUSPENDED, "spec.suspend is true: set it to false to go on.")
    if said is not None and said["reason"] == reasons.SUSPENDING:
        return Halt(reasons.JOB_SUSPENDED, "The job goes on when its pods are gone.")
    return None


def rests(job: JobView) -> bool:
    """Whether nothing but an event can bring the job forward: it is suspended, and that is told."""
    return bool(job.spec.get("suspend")) and is_told(job)


def is_told(job: JobView) -> bool:
    """Whether the status says of the job as it is now that it is suspended, without pods."""
    return job.suspended and job.status.get("observedGeneration") == job.generation
