"""What a job's status should say, given what was observed. Pure: the clock comes in from outside.

Levels, not edges: the same observation always gives the same status, so a lost event or a
restart of the operator changes nothing.
"""

from dataclasses import replace
from datetime import datetime, timedelta

from bagpipe.counted import counted
from bagpipe_operator.api import conditions, reasons
from bagpipe_operator.api.conditions import Condition
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.claim import is_asked_for, taken
from bagpipe_operator.jobs.driver.ending import Ending
from bagpipe_operator.jobs.driver.progress import Progress
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.observation import Halt, Observation
from bagpipe_operator.jobs.pods.pinned import none_yet, pinned_baseline
from bagpipe_operator.jobs.policies import verdict
from bagpipe_operator.jobs.policies.replacement import (
    lost_drivers,
    may_be_replaced,
    pause_seconds,
    pausing,
)
from bagpipe_operator.jobs.policies.stuck import stuck

_UNENDED = (
    Condition(conditions.COMPLETE, False, reasons.IN_PROGRESS, "The job has not ended."),
    Condition(conditions.FAILED, False, reasons.IN_PROGRESS, "The job has not failed."),
    verdict.NOT_ENDED,
)


def decide(seen: Observation, now: datetime, stuck_seconds: float) -> Json:
    """The whole status; equal to the old one when nothing has changed."""
    ending = seen.ending
    if seen.halt is not None and (ending is None or ending.lost):
        # A driver of a pool that was asked may run the job, until its pod is gone.
        if seen.alive or is_asked_for(seen.job.status):
            return _stopping(seen, seen.halt, now)
        if not seen.halt.final:
            return _suspended(seen, seen.halt, now)
        account = ending.progress if ending else None
        ending = Ending(False, seen.halt.reason, seen.halt.message, account)
    ending = ending or stuck(seen, stuck_seconds)
    if ending is not None and ending.lost and may_be_replaced(seen.job, ending, seen.backoff_limit):
        return _replaced(seen, ending, now)
    status = _noted(seen, now)
    if ending is None and pausing(seen.job, now):
        return status
    status.setdefault("startTime", conditions.timestamp(now))
    if seen.driver is not None:
        status.pop("nextAttemptTime", None)
    progress = (ending.progress if ending else None) or seen.progress
    if ending is not None:
        status["phase"] = conditions.COMPLETE if ending.complete else conditions.FAILED
        # A clock that is behind the one that wrote the start, such as another replica's, ends no
        # job before it began.
        status["completionTime"] = max(conditions.timestamp(now), str(status["startTime"]))
        status["cases"] = (status.get("cases") or {}) | {"running": 0}
        passed = verdict.passed(
            status, ending.complete, ending.reason, ending.final_message,
            progress.verdict_reason if progress else "",
        )  # fmt: skip
        return _with(seen, status, [*_ended_conditions(seen, ending, progress), passed], now)
    status["phase"] = _phase(seen)
    return _with(seen, status, _live_conditions(seen, status["phase"]), now)


def acknowledged(job: JobView) -> Json:
    """The status of a job that has ended: an edit changes nothing of its end.

    One that ended under an earlier release has the condition Passed from here on.
    """
    completed = verdict.completed(job.status)
    if job.status.get("observedGeneration") == job.generation:
        return job.status | {"conditions": completed}
    seen = [condition | {"observedGeneration": job.generation} for condition in completed]
    return job.status | {"observedGeneration": job.generation, "conditions": seen}


def _noted(seen: Observation, now: datetime) -> Json:
    """The old status with what was observed, whatever follows from it."""
    status = dict(seen.job.status)
    status["observedGeneration"] = seen.job.generation
    status["attempt"] = seen.attempt
    status["lostDrivers"] = lost_drivers(seen.job)
    if seen.driver is not None:
        status["driver"] = seen.driver.name
    if seen.resumed_from is not None:
        status["resumedFrom"] = seen.resumed_from
    if seen.baseline is not None:
        status["baseline"] = seen.baseline
    progress = (seen.ending.progress if seen.ending else None) or seen.progress
    if progress is not None:
        status |= progress.as_status()
        if progress.cases.begun:
            status.setdefault("firstCaseTime", conditions.timestamp(now))
    if seen.ending is None or not seen.ending.complete:
        # A driver decides before it commits, which its storage, or its own end, may forbid.
        status.pop("verdict", None)
    return status


def _with(seen: Observation, status: Json, wanted: list[Condition], now: datetime) -> Json:
    status["conditions"] = conditions.merged(
        seen.job.status.get("conditions") or [],
        [*wanted, *_baseline(replace(seen.job, status=status))],
        seen.job.generation,
        now,
    )
    return status


def _baseline(job: JobView) -> list[Condition]:
    """Of a job that follows a schedule, whether there is a run of it to be compared with."""
    pinned = pinned_baseline(job)
    if pinned is None:
        return []
    schedule, name = pinned["schedule"], pinned["job"]
    if not name:
        words = none_yet(schedule)
        words = f"{words[0].upper()}{words[1:]}."
        return [Condition(conditions.BASELINE_FOUND, False, reasons.NO_BASELINE_YET, words)]
    words = f"The job is compared with {name}, the last job of the schedule {schedule} that passed."
    return [Condition(conditions.BASELINE_FOUND, True, reasons.LAST_PASSED, words)]


def _stopping(seen: Observation, halt: Halt, now: datetime) -> Json:
    """The status while the pods of a suspended or late job end."""
    status = _noted(seen, now)
    message = halt.while_stopping(max(1, len(seen.alive)))
    suspending = reasons.SUSPENDING if not halt.final else halt.reason
    wanted = [
        _accepted(seen),
        _planned(seen, False, seen.progress),
        Condition(conditions.RUNNING, False, suspending, message),
        *_UNENDED,
        _not_suspended(seen)
        if halt.final
        else Condition(conditions.SUSPENDED, False, reasons.SUSPENDING, message),
    ]
    return _with(seen, status, wanted, now)


def _suspended(seen: Observation, halt: Halt, now: datetime) -> Json:
    """The status of a job without pods: its clock rests, and the next driver is another attempt."""
    status = _noted(seen, now)
    if status.get("driver"):
        status["attempt"] = seen.attempt + 1
    status["driver"] = ""
    status["phase"] = conditions.SUSPENDED
    status["cases"] = (status.get("cases") or {}) | {"running": 0}
    for clock in ("startTime", "firstCaseTime", "nextAttemptTime"):
        status.pop(clock, None)
    wanted = [
        Condition(conditions.ACCEPTED, False, halt.reason, halt.message),
        _planned(seen, False, None),
        Condition(conditions.RUNNING, False, halt.reason, halt.message),
        *_UNENDED,
        Condition(conditions.SUSPENDED, True, halt.reason, f"No pod holds a place. {halt.message}"),
    ]
    return _with(seen, status, wanted, now)


def _not_suspended(seen: Observation) -> Condition:
    if seen.job.deleting:
        return Condition(
            conditions.SUSPENDED, False, reasons.JOB_DELETED, "The job is being deleted."
        )
    before = conditions.find(seen.job.status.get("conditions") or [], conditions.SUSPENDED)
    if seen.kueue and before and before["reason"] in {reasons.QUEUED, reasons.ADMITTED}:
        return Condition(
            conditions.SUSPENDED, False, reasons.ADMITTED, "Kueue has admitted the job."
        )
    if before and (before["status"] == "True" or before["reason"] == reasons.JOB_RESUMED):
        return Condition(
            conditions.SUSPENDED,
            False,
            reasons.JOB_RESUMED,
            "The job was resumed: cases that are done are not run again.",
        )
    return Condition(
        conditions.SUSPENDED, False, reasons.NOT_SUSPENDED, "spec.suspend is not true."
    )


def _replaced(seen: Observation, ending: Ending, now: datetime) -> Json:
    """The status between two drivers: when the pause is over, the next attempt's is created."""
    status = _noted(seen, now)
    lost = lost_drivers(seen.job) + (not ending.voluntary)
    # Who is evicted again and again waits longer too, or a full cluster would be asked for ever.
    pause = pause_seconds(seen.attempt if ending.voluntary else lost)
    status["attempt"] = seen.attempt + 1
    status["lostDrivers"] = lost
    status["nextAttemptTime"] = conditions.timestamp(now + timedelta(seconds=pause))
    status["driver"] = ""
    status["phase"] = "Pending"
    status["cases"] = (status.get("cases") or {}) | {"running": 0}
    which = (
        "Another driver takes over, which does not count against spec.backoffLimit,"
        if ending.voluntary
        else f"Driver {lost + 1} of at most {seen.backoff_limit + 1} takes over"
    )
    message = f"{ending.message} {which} in {pause:g} s; cases that are done are not run again."
    wanted = [
        Condition(conditions.ACCEPTED, False, reasons.IN_PROGRESS, "The next driver is created."),
        _planned(seen, False, None),
        Condition(conditions.RUNNING, False, ending.reason, message),
        *_UNENDED,
        _not_suspended(seen),
    ]
    return _with(seen, status, wanted, now)


def _phase(seen: Observation) -> str:
    if seen.driver is None:
        # Not created yet, or out of sight for a moment: the phase stays as it was.
        before = str(seen.job.status.get("phase") or "Pending")
        return "Pending" if before == conditions.SUSPENDED else before
    if seen.driver.phase == "Pending":
        return "Pending"
    if seen.progress is None:
        return "Running" if seen.job.status.get("phase") == "Running" else "Planning"
    return "Planning" if seen.progress.phase == "Planning" else "Running"


def _accepted(seen: Observation) -> Condition:
    name = seen.driver.name if seen.driver else seen.job.status.get("driver")
    if name:
        claim = taken(seen.job.status)
        of = f", which was made for job {claim.job}" if claim is not None else ""
        return Condition(
            conditions.ACCEPTED, True, reasons.DRIVER_CREATED, f"The driver's pod is {name}{of}."
        )
    if seen.refusal:
        return Condition(conditions.ACCEPTED, False, seen.refusal.reason, seen.refusal.message)
    if seen.ending:
        return Condition(conditions.ACCEPTED, False, seen.ending.reason, seen.ending.final_message)
    return Condition(
        conditions.ACCEPTED, False, reasons.IN_PROGRESS, "The driver's pod is not created yet."
    )


def _live_conditions(seen: Observation, phase: str) -> list[Condition]:
    return [
        _accepted(seen),
        _planned(seen, phase == "Running", seen.progress),
        _running(seen, phase),
        *_UNENDED,
        _not_suspended(seen),
    ]


def _planned(seen: Observation, known: bool, progress: Progress | None) -> Condition:
    before = conditions.find(seen.job.status.get("conditions") or [], conditions.PLANNED)
    count = progress.cases.planned if progress else 0
    if (known and count) or (before and before["status"] == "True"):
        count = count or (seen.job.status.get("cases") or {}).get("planned", 0)
        message = f"The job consists of {counted(count, 'case')}."
        return Condition(conditions.PLANNED, True, reasons.CASES_PLANNED, message)
    return Condition(conditions.PLANNED, False, reasons.PLANNING, "The cases are not planned yet.")


def _running(seen: Observation, phase: str) -> Condition:
    trouble = next(iter(seen.troubles), None)
    if phase == "Running" and seen.executor_runs:
        warning = seen.progress.warning if seen.progress else ""
        texts = ["Cases are running.", trouble.message if trouble else "", warning]
        message = " ".join(part for part in texts if part)
        # Cases run, and still somebody should look: the reason is what `kubectl get` shows.
        reason = trouble.reason if trouble else reasons.CASES_RUNNING
        return Condition(conditions.RUNNING, True, reason, message)
    if trouble is not None:
        return Condition(conditions.RUNNING, False, trouble.reason, trouble.message)
    before = conditions.find(seen.job.status.get("conditions") or [], conditions.RUNNING)
    if phase != "Running" and before and before.get("reason") in reasons.DRIVER_ENDS:
        # The next driver is not at work yet: the status keeps what ended the one before.
        return Condition(conditions.RUNNING, False, before["reason"], before["message"])
    reason, message = _waiting_for(seen, phase)
    return Condition(conditions.RUNNING, reason == reasons.CASES_RUNNING, reason, message)


def _waiting_for(seen: Observation, phase: str) -> tuple[str, str]:
    """What a job without trouble and without a running executor is at."""
    if phase == "Planning":
        message = seen.progress.message if seen.progress else ""
        return reasons.PLANNING, message or "The driver is planning the cases."
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
            ending.final_message
            if ending.complete
            else "The job failed: see the condition Failed.",
        ),
        Condition(
            conditions.FAILED,
            not ending.complete,
            other if ending.complete else ending.reason,
            "The job completed." if ending.complete else ending.final_message,
        ),
        _not_suspended(seen),
    ]
