"""The removal of a job that has ended. Pure."""

from datetime import datetime

from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.policies.deadlines import passed


def expired(job: JobView, now: datetime) -> bool:
    """Whether a job that has ended was kept for as long as its spec says."""
    kept = job.spec.get("ttlAfterFinished")
    return job.finished and passed(job.status.get("completionTime"), kept, now)
