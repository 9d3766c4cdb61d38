"""Deadlines: of a job's first case, and of its end. Pure."""

import re
from datetime import datetime

from bagpipe_operator.api import conditions, readings, reasons
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.observation import Halt

_DEADLINES = frozenset({reasons.START_DEADLINE_EXCEEDED, reasons.DEADLINE_EXCEEDED})
_STOPPING = re.compile(r" \d+ pods? (is|are) being stopped; what is done is kept\.$")


def late_start(job: JobView, now: datetime) -> Halt | None:
    """The halt of a job of which no case has begun within spec.startDeadline."""
    deadline = job.spec.get("startDeadline")
    if job.status.get("firstCaseTime") or not passed(job.status.get("startTime"), deadline, now):
        return None
    message = (
        f"No case began within spec.startDeadline ({deadline}). {_held_up_by(job)}"
        " Mend that, or allow more time, and create the job again."
    )
    return Halt(reasons.START_DEADLINE_EXCEEDED, message, final=True)


def reported_late(job: JobView) -> Halt | None:
    """The halt for which a late job's pods are being stopped, with the delay's cause as written."""
    running = conditions.find(job.status.get("conditions") or [], conditions.RUNNING)
    if running is None or running["reason"] not in _DEADLINES:
        return None
    return Halt(running["reason"], _STOPPING.sub("", str(running["message"])), final=True)


def late_end(job: JobView, now: datetime) -> Halt | None:
    """The halt of a job that runs for longer than spec.activeDeadline."""
    deadline = job.spec.get("activeDeadline")
    if not passed(job.status.get("startTime"), deadline, now):
        return None
    message = (
        f"The job ran for longer than spec.activeDeadline ({deadline}). What was done is"
        " kept in its results' journal: a job with spec.resumeFrom goes on from there."
    )
    return Halt(reasons.DEADLINE_EXCEEDED, message, final=True)


def _held_up_by(job: JobView) -> str:
    """What the conditions say that the job waits for."""
    written = job.status.get("conditions") or []
    for type_ in (conditions.ACCEPTED, conditions.RUNNING):
        found = conditions.find(written, type_)
        if found is not None and found["status"] == "False":
            return str(found["message"])
    return "Its executors run, and none has begun a case."


def passed(since: str | None, duration: object, now: datetime) -> bool:
    """Whether a duration of the spec is over since a moment of the status, where both are there."""
    seconds = readings.seconds(duration)
    if since is None or seconds is None:
        return False
    # Not `since` plus the seconds: of the largest numbers there is no such moment.
    return (now - datetime.fromisoformat(since)).total_seconds() >= seconds
