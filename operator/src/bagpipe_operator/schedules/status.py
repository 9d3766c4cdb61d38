"""What a schedule's status says after a decision was carried out, and the Events of it. Pure."""

from dataclasses import dataclass
from datetime import datetime

from bagpipe_operator.api import conditions, readings, reasons
from bagpipe_operator.api.conditions import Condition
from bagpipe_operator.api.objects import Json
from bagpipe_operator.api.runs import PassedRun, kept_run
from bagpipe_operator.cluster.events import NORMAL, WARNING, Note
from bagpipe_operator.schedules.decide import MISSED_LIMIT, Decision, Verdict, written_run
from bagpipe_operator.schedules.view import ScheduledJob, ScheduleView, job_name

READY = "Ready"
STALLED = "Stalled"
SUSPENDED = "Suspended"
ON_TIME = "OnTime"

# More jobs than this are counted and not named.
MOST_ACTIVE_NAMES = 10
# What the Event of a run's start is marked by.
_START = "Start"
# A start this much after its time is worth a word.
LATE_SECONDS = 60.0


@dataclass(frozen=True)
class Refused:
    """The API server did not let a run's job be created."""

    reason: str
    message: str


@dataclass(frozen=True)
class Outcome:
    """What came of a decision: at most one of `started` and `refused`."""

    decision: Decision
    jobs: tuple[ScheduledJob, ...]  # afterwards
    started: str = ""  # the job's name
    refused: Refused | None = None
    passed: PassedRun | None = None  # the latest that was seen, its job gone or not


def status_of(schedule: ScheduleView, outcome: Outcome, now: datetime) -> Json:
    """The whole status; what is absent from it is to be removed."""
    decision = outcome.decision
    active = [job.name for job in outcome.jobs if not job.finished]
    last_run = decision.run if outcome.started else decision.last_run
    moments = {
        "lastScheduleTime": last_run,
        "lastSuccessfulTime": _last_success(schedule, outcome.jobs),
        "lastPassedTime": _last_passed(schedule, outcome.jobs),
        "nextScheduleTime": decision.next_run,
    }
    status: Json = {
        "observedGeneration": schedule.generation,
        "activeCount": len(active),
        "active": active[-MOST_ACTIVE_NAMES:],
        "conditions": conditions.merged(
            schedule.status.get("conditions") or [],
            _conditions(schedule, outcome, now),
            schedule.generation,
            now,
        ),
    }
    passed = [run for run in (outcome.passed, kept_run(schedule.status)) if run is not None]
    if passed:
        status["lastPassed"] = max(passed).as_status()
    return status | {k: conditions.timestamp(v) for k, v in moments.items() if v is not None}


def notes_of(before: ScheduleView, outcome: Outcome, now: datetime) -> list[Note]:
    """The Events to write for the change from the status before to that of the outcome."""
    old = before.status.get("conditions") or []
    notes = _of_earlier_starts(before, outcome)
    for condition in _conditions(before, outcome, now):
        known = conditions.find(old, condition.type)
        status = "True" if condition.status else "False"
        same = known is not None and (known["status"], known["reason"]) == (
            status, condition.reason,
        )  # fmt: skip
        begun = condition.type == ON_TIME and (outcome.started or _unwritten(outcome.decision))
        if begun or (not same and _is_reported(condition, known)):
            # A run that was reported as missed may be started all the same, by a longer deadline.
            what = _START if begun else f"{condition.type} {status}"
            mark = f"{what} {_moment(condition, outcome.decision, now)}"
            notes.append(Note(_worth(condition), condition.reason, condition.message, mark))
    return notes


def _of_earlier_starts(before: ScheduleView, outcome: Outcome) -> list[Note]:
    """Of jobs that no status named before another run was due; OnTime reports the latest."""
    decision = outcome.decision
    if decision.last_run is None or not decision.unwritten:
        return []
    written = written_run(before) or before.created
    reported = decision.last_run if decision.run is None else None
    runs = [job.run for job in outcome.jobs if job.run is not None and job.run != reported]
    return [
        Note(
            NORMAL,
            reasons.JOB_STARTED,
            _words_of_start(before, run),
            f"{_START} {conditions.timestamp(run)}",
        )
        for run in runs
        if written < run <= decision.last_run
    ]


def _words_of_start(schedule: ScheduleView, run: datetime) -> str:
    return f"{job_name(schedule.name, run)} was started for the run of {conditions.timestamp(run)}."


def _moment(condition: Condition, decision: Decision, now: datetime) -> str:
    """What a transition is reported once for: a run, or a moment in the schedule's own life."""
    run = decision.run or decision.last_run
    return conditions.timestamp(run if condition.type == ON_TIME and run is not None else now)


def _worth(condition: Condition) -> str:
    if condition.type == STALLED:
        return WARNING
    trouble = condition.type == ON_TIME and not condition.status
    return WARNING if trouble and condition.reason != reasons.JOB_ACTIVE else NORMAL


def _is_reported(condition: Condition, known: Json | None) -> bool:
    match condition.type:
        case "Stalled":
            return bool(condition.status)
        case "Suspended":
            # A schedule that was never suspended needs no word about it.
            return bool(condition.status) or known is not None
        case "OnTime":
            return not condition.status
        case _:
            return False


def _conditions(schedule: ScheduleView, outcome: Outcome, now: datetime) -> list[Condition]:
    unusable = outcome.decision.unusable
    if unusable is not None:
        ready = Condition(READY, False, unusable.reason, str(unusable))
        stalled = Condition(STALLED, True, unusable.reason, str(unusable))
    else:
        words = "The schedule is understood."
        ready = Condition(READY, True, reasons.SCHEDULED, words)
        stalled = Condition(STALLED, False, reasons.SCHEDULED, words)
    if schedule.suspended:
        words = "spec.suspend is true: no run is started."
        suspended = Condition(SUSPENDED, True, reasons.SUSPENDED_BY_SPEC, words)
    else:
        words = "Runs are started when they are due."
        suspended = Condition(SUSPENDED, False, reasons.NOT_SUSPENDED, words)
    return [ready, stalled, suspended, _on_time(schedule, outcome, now)]


def _on_time(schedule: ScheduleView, outcome: Outcome, now: datetime) -> Condition:
    """How the latest run that was due went; the condition holds until the next one is due."""
    decision = outcome.decision
    if decision.run is None:
        return _reported_late(schedule, decision) or _as_before(schedule)
    run = conditions.timestamp(decision.run)
    if outcome.refused is not None:
        words = f"The run of {run} could not be started: {outcome.refused.message}"
        return Condition(ON_TIME, False, outcome.refused.reason, words)
    if decision.verdict is Verdict.WAIT:
        holder = decision.active[0].name
        words = f"The run of {run} waits for {holder} to end, since concurrencyPolicy is Forbid."
        return Condition(ON_TIME, False, reasons.JOB_ACTIVE, words)
    if decision.verdict is Verdict.TOO_LATE:
        allowed = schedule.spec.get("startingDeadline")
        words = f"The run of {run} was not started within startingDeadline ({allowed})."
        return Condition(ON_TIME, False, *_missed(words, decision.due))
    return _started(outcome, decision.run, now)


def _started(outcome: Outcome, run: datetime, now: datetime) -> Condition:
    decision = outcome.decision
    late = (now - run).total_seconds()
    words = f"{outcome.started} was started for the run of {conditions.timestamp(run)}"
    words += f", {late:.0f} s late." if late >= LATE_SECONDS else "."
    if decision.due > 1:
        return Condition(ON_TIME, False, *_missed(words, decision.due - 1))
    if decision.replaced:
        names = ", ".join(job.name for job in decision.replaced[:MOST_ACTIVE_NAMES])
        words += f" It replaces {names}, which was still active."
        return Condition(ON_TIME, True, reasons.JOB_REPLACED, words)
    return Condition(ON_TIME, True, reasons.JOB_STARTED, words)


def _missed(words: str, count: int) -> tuple[str, str]:
    """Reason and message for runs that got no job; `count` of them, as far as was counted."""
    if count >= MISSED_LIMIT:
        return (
            reasons.TOO_MANY_MISSED_STARTS,
            f"{words} At least {MISSED_LIMIT} runs were missed, as after a long suspension.",
        )
    what = "1 run was" if count == 1 else f"{count} runs were"
    return reasons.MISSED_START, f"{words} {what} missed since the last start."


def _unwritten(decision: Decision) -> bool:
    return decision.run is None and decision.unwritten


def _reported_late(schedule: ScheduleView, decision: Decision) -> Condition | None:
    """A job was created, and the status could not be written: this write makes up for it."""
    if not _unwritten(decision) or decision.last_run is None:
        return None
    words = _words_of_start(schedule, decision.last_run)
    if decision.due > 1:
        return Condition(ON_TIME, False, *_missed(words, decision.due - 1))
    return Condition(ON_TIME, True, reasons.JOB_STARTED, words)


def _as_before(schedule: ScheduleView) -> Condition:
    known = conditions.find(schedule.status.get("conditions") or [], ON_TIME)
    if known is None:
        return Condition(ON_TIME, True, reasons.NO_RUN_YET, "No run has been due yet.")
    return Condition(ON_TIME, known["status"] == "True", known["reason"], known["message"])


def _last_success(schedule: ScheduleView, jobs: tuple[ScheduledJob, ...]) -> datetime | None:
    """The latest end of a job that completed; those that are gone are in the old status."""
    ends = [job.completed for job in jobs if job.complete and job.completed is not None]
    written = readings.moment(schedule.status.get("lastSuccessfulTime"))
    if written is not None:
        ends.append(written)
    return max(ends, default=None)


def _last_passed(schedule: ScheduleView, jobs: tuple[ScheduledJob, ...]) -> datetime | None:
    """The same of one whose verdict is Passed."""
    ends = [job.completed for job in jobs if job.passed and job.completed is not None]
    written = readings.moment(schedule.status.get("lastPassedTime"))
    return max(ends if written is None else [*ends, written], default=None)
