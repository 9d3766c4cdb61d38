"""What a job's status should say, given what was observed. Pure: the clock comes in from outside.

Levels, not edges: the same observation always gives the same status, so a lost event or a
restart of the operator changes nothing.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from datetime import datetime

from bagpipe_operator import conditions, names, reasons
from bagpipe_operator.children import Refusal
from bagpipe_operator.conditions import Condition
from bagpipe_operator.diagnose import Trouble
from bagpipe_operator.ending import Ending
from bagpipe_operator.progress import Progress
from bagpipe_operator.view import JobView, Json, PodView


@dataclass(frozen=True)
class Observation:
    """All that the status of one job depends on."""

    job: JobView
    attempt: int
    driver: PodView | None = None
    executors: tuple[PodView, ...] = ()
    progress: Progress | None = None
    refusal: Refusal | None = None
    troubles: tuple[Trouble, ...] = ()
    seen_for: Mapping[Hashable, float] = field(default_factory=dict)  # seconds, by Trouble.key
    refused_for: float = 0.0  # seconds
    ending: Ending | None = None

    @property
    def executor_runs(self) -> bool:
        """Whether a case may be running at all."""
        containers = (pod.container(names.CONTAINER_SPARK) for pod in self.executors)
        return any(container is not None and container.running for container in containers)


def decide(seen: Observation, now: datetime, stuck_seconds: float) -> Json:
    """The whole status; equal to the old one when nothing has changed."""
    ending = seen.ending or _stuck(seen, stuck_seconds)
    status = dict(seen.job.status)
    status["observedGeneration"] = seen.job.generation
    status["attempt"] = seen.attempt
    status.setdefault("startTime", conditions.timestamp(now))
    if seen.driver is not None:
        status["driver"] = seen.driver.name
    progress = (ending.progress if ending else None) or seen.progress
    if progress is not None:
        status |= progress.as_status()
    if ending is not None:
        status["phase"] = conditions.COMPLETE if ending.complete else conditions.FAILED
        status["completionTime"] = conditions.timestamp(now)
        status["cases"] = (status.get("cases") or {}) | {"running": 0}
        wanted = _ended_conditions(seen, ending, progress)
    else:
        status["phase"] = _phase(seen)
        wanted = _live_conditions(seen, status["phase"])
    status["conditions"] = conditions.merged(
        seen.job.status.get("conditions") or [], wanted, seen.job.generation, now
    )
    return status


def _stuck(seen: Observation, stuck_seconds: float) -> Ending | None:
    """The end of a job that only a person could help, after having waited for that person."""
    after = f"The job was ended after {stuck_seconds:g} s of this."
    if seen.refusal and seen.refusal.lasting and seen.refused_for >= stuck_seconds:
        return Ending(False, seen.refusal.reason, f"{seen.refusal.message} {after}")
    for trouble in seen.troubles:
        if trouble.lasting and seen.seen_for.get(trouble.key, 0.0) >= stuck_seconds:
            return Ending(False, trouble.reason, f"{trouble.message} {after}")
    return None


def _phase(seen: Observation) -> str:
    if seen.driver is None:
        # Not created yet, or out of sight for a moment: what was said stays said.
        return str(seen.job.status.get("phase") or "Pending")
    if seen.driver.phase == "Pending":
        return "Pending"
    if seen.progress is None:
        return "Running" if seen.job.status.get("phase") == "Running" else "Planning"
    return "Planning" if seen.progress.phase == "Planning" else "Running"


def _accepted(seen: Observation) -> Condition:
    name = seen.driver.name if seen.driver else seen.job.status.get("driver")
    if name:
        return Condition(
            conditions.ACCEPTED, True, reasons.DRIVER_CREATED, f"The driver's pod is {name}."
        )
    if seen.refusal:
        return Condition(conditions.ACCEPTED, False, seen.refusal.reason, seen.refusal.message)
    if seen.ending:
        return Condition(conditions.ACCEPTED, False, seen.ending.reason, seen.ending.message)
    return Condition(
        conditions.ACCEPTED, False, reasons.IN_PROGRESS, "The driver's pod is not created yet."
    )


def _live_conditions(seen: Observation, phase: str) -> list[Condition]:
    return [
        _accepted(seen),
        _planned(seen, phase == "Running", seen.progress),
        _running(seen, phase),
        Condition(conditions.COMPLETE, False, reasons.IN_PROGRESS, "The job has not ended."),
        Condition(conditions.FAILED, False, reasons.IN_PROGRESS, "The job has not failed."),
    ]


def _planned(seen: Observation, known: bool, progress: Progress | None) -> Condition:
    before = conditions.find(seen.job.status.get("conditions") or [], conditions.PLANNED)
    count = progress.cases.planned if progress else 0
    if (known and count) or (before and before["status"] == "True"):
        count = count or (seen.job.status.get("cases") or {}).get("planned", 0)
        return Condition(
            conditions.PLANNED, True, reasons.CASES_PLANNED, f"The job consists of {count} cases."
        )
    return Condition(conditions.PLANNED, False, reasons.PLANNING, "The cases are not planned yet.")


def _running(seen: Observation, phase: str) -> Condition:
    trouble = next(iter(seen.troubles), None)
    if phase == "Running" and seen.executor_runs:
        message = "Cases are running." + (f" {trouble.message}" if trouble else "")
        return Condition(conditions.RUNNING, True, reasons.CASES_RUNNING, message)
    if trouble is not None:
        return Condition(conditions.RUNNING, False, trouble.reason, trouble.message)
    reason, message = _waiting_for(seen, phase)
    return Condition(conditions.RUNNING, reason == reasons.CASES_RUNNING, reason, message)


def _waiting_for(seen: Observation, phase: str) -> tuple[str, str]:
    """What a job without trouble and without a running executor is at."""
    if phase == "Planning":
        said = seen.progress.message if seen.progress else ""
        return reasons.PLANNING, said or "The driver is planning the cases."
    if phase != "Running":
        return reasons.DRIVER_PENDING, "The driver's pod has not started yet."
    before = conditions.find(seen.job.status.get("conditions") or [], conditions.RUNNING)
    ran = before is not None and before["status"] == "True"
    if seen.progress.cases.begun if seen.progress else ran:
        # The watch of the executors is behind the driver's account, or the operator is new.
        return reasons.CASES_RUNNING, "Cases are running."
    return reasons.EXECUTORS_PENDING, "The cases wait for the executors' pods to start."


def _ended_conditions(
    seen: Observation, ending: Ending, progress: Progress | None
) -> list[Condition]:
    other = reasons.JOB_COMPLETE if ending.complete else reasons.JOB_FAILED
    return [
        _accepted(seen),
        _planned(seen, True, progress),
        Condition(conditions.RUNNING, False, reasons.JOB_FINISHED, "The job has ended."),
        Condition(
            conditions.COMPLETE,
            ending.complete,
            ending.reason if ending.complete else other,
            ending.message if ending.complete else "The job failed: see the condition Failed.",
        ),
        Condition(
            conditions.FAILED,
            not ending.complete,
            other if ending.complete else ending.reason,
            "The job completed." if ending.complete else ending.message,
        ),
    ]
