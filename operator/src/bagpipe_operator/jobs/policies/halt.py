"""Whether a job may have pods: its deletion first, then suspension, then deadlines. Pure."""

from datetime import datetime

from bagpipe_operator.api import reasons
from bagpipe_operator.jobs.driver.progress import Progress
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.observation import Halt
from bagpipe_operator.jobs.policies.deadlines import late_end, late_start, reported_late
from bagpipe_operator.jobs.policies.deletion import deletion
from bagpipe_operator.jobs.policies.suspend import suspension


def halt_of(job: JobView, now: datetime) -> Halt | None:
    """Why the job may have no pods at this moment, if so.

    What has begun is completed, also when a suspension was withdrawn meanwhile, a deadline changed,
    or the clock set back: the driver has been asked to stop and must not be counted
    as lost.
    """
    if job.deleting:
        return reported_late(job) or deletion(job)
    return suspension(job) or reported_late(job) or late_start(job, now) or late_end(job, now)


def halt_as_seen(
    halt: Halt | None, job: JobView, running: bool, progress: Progress | None, now: datetime
) -> Halt | None:
    """The halt, now that the driver was looked at: a start deadline ends only what has not begun.

    The status may be behind: its operator was down, or could not reach the driver. So the driver's
    account counts, the last one of a driver that has ended too; and silence of one that is
    `running` is not "no case has begun".
    """
    if halt is None or halt.reason != reasons.START_DEADLINE_EXCEEDED:
        return halt
    if reported_late(job) is not None:
        return halt  # its pods are being stopped
    begun = progress.cases.begun if progress else running
    return late_end(job, now) if begun else halt
