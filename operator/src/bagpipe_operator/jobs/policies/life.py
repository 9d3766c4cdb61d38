"""The clock of a job's life: suspension, deadlines, pauses between drivers, removal. Pure."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime

from bagpipe_operator.api import conditions, names, readings, reasons
from bagpipe_operator.jobs.driver.ending import overdue
from bagpipe_operator.jobs.driver.progress import Progress
from bagpipe_operator.jobs.view import JobView, PodView

# A driver that is lost again and again is not helped by haste, and its node or its storage is.
FIRST_PAUSE_SECONDS = 10.0
LONGEST_PAUSE_SECONDS = 300.0
# More of them only make numbers that no float holds.
_MOST_DOUBLINGS = 10
# A native sidecar, or a mesh that is told to, ends within seconds after the driver.
LINGER_SECONDS = 30.0
# The kubelet's word for a container that its runtime knows no more: no moment of its end, no log.
_LOST_CONTAINER = "ContainerStatusUnknown"
_DEADLINES = frozenset({reasons.START_DEADLINE_EXCEEDED, reasons.DEADLINE_EXCEEDED})
_STOPPING = re.compile(r" \d+ pods? (is|are) being stopped; what is done is kept\.$")


@dataclass(frozen=True)
class Halt:
    """Why a job's pods are stopped. `final`: the job fails when they are gone; else it rests."""

    reason: str
    message: str
    final: bool = False

    def while_stopping(self, pods: int) -> str:
        """The message as long as there are pods."""
        left = "1 pod is" if pods == 1 else f"{pods} pods are"
        return f"{self.message} {left} being stopped; what is done is kept."


def halt_of(job: JobView, now: datetime) -> Halt | None:
    """Why the job may have no pods at this moment, if so.

    What has begun is brought to its end, also when a suspension was taken back meanwhile, a
    deadline moved, or the clock set back: the driver has been told to stop and must not be counted
    as lost.
    """
    said = conditions.find(job.status.get("conditions") or [], conditions.SUSPENDED)
    if job.spec.get("suspend"):
        return Halt(reasons.JOB_SUSPENDED, "spec.suspend is true: set it to false to go on.")
    if said is not None and said["reason"] == reasons.SUSPENDING:
        return Halt(reasons.JOB_SUSPENDED, "The job goes on when its pods are gone.")
    return _told_late(job) or _late_start(job, now) or _late_end(job, now)


def _late_start(job: JobView, now: datetime) -> Halt | None:
    deadline = job.spec.get("startDeadline")
    if job.status.get("firstCaseTime") or not _passed(job.status.get("startTime"), deadline, now):
        return None
    message = (
        f"No case began within spec.startDeadline ({deadline}). {_held_up_by(job)}"
        " Mend that, or allow more time, and create the job again."
    )
    return Halt(reasons.START_DEADLINE_EXCEEDED, message, final=True)


def _told_late(job: JobView) -> Halt | None:
    """The halt for which a late job's pods are being stopped; what held it up was said then."""
    told = conditions.find(job.status.get("conditions") or [], conditions.RUNNING)
    if told is None or told["reason"] not in _DEADLINES:
        return None
    return Halt(told["reason"], _STOPPING.sub("", str(told["message"])), final=True)


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
    if _told_late(job) is not None:
        return halt  # its pods are being stopped
    begun = progress.cases.begun if progress else running
    return _late_end(job, now) if begun else halt


def _late_end(job: JobView, now: datetime) -> Halt | None:
    deadline = job.spec.get("activeDeadline")
    if not _passed(job.status.get("startTime"), deadline, now):
        return None
    message = (
        f"The job ran for longer than spec.activeDeadline ({deadline}). What was done is"
        " kept in its results' journal: a job with spec.resumeFrom goes on from there."
    )
    return Halt(reasons.DEADLINE_EXCEEDED, message, final=True)


def _held_up_by(job: JobView) -> str:
    """What the conditions say that the job waits for."""
    told = job.status.get("conditions") or []
    for type_ in (conditions.ACCEPTED, conditions.RUNNING):
        said = conditions.find(told, type_)
        if said is not None and said["status"] == "False":
            return str(said["message"])
    return "Its executors run, and none has begun a case."


def _passed(since: str | None, duration: object, now: datetime) -> bool:
    seconds = readings.seconds(duration)
    if since is None or seconds is None:
        return False
    # Not `since` plus the seconds: of the largest numbers there is no such moment.
    return (now - datetime.fromisoformat(since)).total_seconds() >= seconds


def pausing(job: JobView, now: datetime) -> bool:
    """Whether the next driver is not to be created yet."""
    until = job.status.get("nextAttemptTime")
    if until is None:
        return False
    left = (datetime.fromisoformat(until) - now).total_seconds()
    # Twice as much is no pause, but a clock that was ahead: by days, maybe.
    return 0 < left <= 2 * LONGEST_PAUSE_SECONDS


def pause_seconds(lost: int) -> float:
    """How long to wait with the next driver after `lost` were lost, from 1 on."""
    doublings = min(lost - 1, _MOST_DOUBLINGS)
    return float(min(LONGEST_PAUSE_SECONDS, FIRST_PAUSE_SECONDS * 2**doublings))


def lost_drivers(job: JobView) -> int:
    """How many drivers were lost; a status of an earlier release counts attempts only."""
    lost = job.status.get("lostDrivers")
    return int(job.status.get("attempt") or 1) - 1 if lost is None else int(lost)


def living(pods: Iterable[PodView], now: datetime) -> tuple[PodView, ...]:
    """The pods that hold a place: their node's, their quota's, and what they mount.

    One that is being deleted holds it until it is gone: its volumes are taken down after its
    containers have ended. One that ended by itself is kept for its log and holds nothing.
    """
    holding = (pod for pod in pods if pod.deleting or not pod.ended)
    return tuple(pod for pod in holding if not overdue(pod, now))


def over(pod: PodView) -> bool:
    """Whether the pod's driver has ended; the phase of its pod follows in a moment."""
    driver = pod.container(names.CONTAINER_DRIVER)
    return driver is not None and driver.exit_code is not None


def lingers(pod: PodView, now: datetime) -> bool:
    """Whether a pod goes on without its driver: a container that somebody has put beside it runs.

    A service mesh's proxy that is no native sidecar does not end, and would keep the pod's place,
    its quota and its claims for ever.
    """
    driver = pod.container(names.CONTAINER_DRIVER)
    if driver is None or driver.exit_code is None or pod.ended or pod.deleting:
        return False
    if driver.ended_at is None:
        return driver.reason == _LOST_CONTAINER
    return (now - driver.ended_at).total_seconds() >= LINGER_SECONDS


def needs_stop(pod: PodView, now: datetime) -> bool:
    """Whether a pod that holds a place gives it back only when it is deleted."""
    return not over(pod) or lingers(pod, now)


def rests(job: JobView) -> bool:
    """Whether nothing but an event can bring the job forward: it is suspended, and that is told."""
    return bool(job.spec.get("suspend")) and is_told(job)


def is_told(job: JobView) -> bool:
    """Whether the status says of the job as it is now that it is suspended, without pods."""
    return job.suspended and job.status.get("observedGeneration") == job.generation


def expired(job: JobView, now: datetime) -> bool:
    """Whether a job that has ended was kept for as long as its spec says."""
    kept = job.spec.get("ttlAfterFinished")
    return job.finished and _passed(job.status.get("completionTime"), kept, now)
