"""Deletion: a job that is being deleted, and whose object somebody's finalizer keeps. Pure."""

from bagpipe_operator.api import conditions, reasons
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.observation import Halt


def deletion(job: JobView) -> Halt | None:
    """The halt of a job that is being deleted.

    Its pods go with its object, by their owner's deletion, which anybody's entry in
    metadata.finalizers may put off for ever.
    """
    if not job.deleting:
        return None
    message = (
        "The job was deleted before it ended: its object is gone when metadata.finalizers has no"
        " entry any more."
    )
    return Halt(reasons.JOB_DELETED, message, final=True)


def was_deleted(status: Json) -> bool:
    """Whether a job ended because somebody deleted it: nobody has to be notified of that."""
    failed = conditions.find(status.get("conditions") or [], conditions.FAILED)
    return failed is not None and failed["reason"] == reasons.JOB_DELETED
