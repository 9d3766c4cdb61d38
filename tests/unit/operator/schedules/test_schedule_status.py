"""One outcome, and the whole of what a schedule's status and Events say of it."""

from datetime import datetime, timedelta
from typing import Any

import pytest

from bagpipe_operator.api.conditions import timestamp
from bagpipe_operator.api.objects import Json
from bagpipe_operator.api.runs import PassedRun
from bagpipe_operator.schedules.cron import UnusableScheduleError
from bagpipe_operator.schedules.decide import Decision, Verdict
from bagpipe_operator.schedules.status import Outcome, Refused, notes_of, status_of
from bagpipe_operator.schedules.view import ScheduledJob, ScheduleView
from tests.unit.operator.schedules.world import make_job, make_schedule, minute, name_of

NOW = minute(5) + timedelta(seconds=10)


def job(count: int, end: str = "", at: str = "2026-11-20T04:30:00Z") -> ScheduledJob:
    """The job of the run `count` minutes after 04:00."""
    return ScheduledJob.from_object(make_job(name_of(count), end, at=at))


def schedule(
    *conditions: tuple[str, str, str], status: Json | None = None, **spec: Any
) -> ScheduleView:
    """One whose status has conditions, each (type, status, reason), and other fields."""
    reported = [
        {"type": type_, "status": true, "reason": reason, "message": "As it was.",
         "lastTransitionTime": timestamp(minute(0))}
        for type_, true, reason in conditions
    ]  # fmt: skip
    made = make_schedule(**spec) | {"status": {"conditions": reported} | (status or {})}
    return ScheduleView.from_object(made)


def outcome(
    *jobs: ScheduledJob,
    verdict: Verdict = Verdict.NOTHING_DUE,
    started: str = "",
    refused: Refused | None = None,
    **decision: Any,
) -> Outcome:
    return Outcome(Decision(verdict, **decision), jobs, started, refused)


def started(count: int, **decision: Any) -> Outcome:
    """The run's job was made."""
    due: dict[str, Any] = {"verdict": Verdict.START, "run": minute(count), "due": 1}
    return outcome(started=name_of(count), **due | decision)


def on_time(
    result: Outcome, now: datetime = NOW, before: ScheduleView | None = None
) -> tuple[str, str, str]:
    status = status_of(before or schedule(), result, now)
    found = next(c for c in status["conditions"] if c["type"] == "OnTime")
    return found["status"], found["reason"], found["message"]


def notes(before: ScheduleView, result: Outcome) -> list[tuple[str, str, str]]:
    """Type, reason and mark of what is reported."""
    return [(n.type, n.reason, n.mark) for n in notes_of(before, result, NOW)]


def words(count: int) -> str:
    return f"{name_of(count)} was started for the run of {timestamp(minute(count))}"


def test_a_started_run_is_the_last_one() -> None:
    jobs = [job(3, "Complete"), job(4, "Failed"), job(5)]
    result = started(5, last_run=minute(4), next_run=minute(6))
    status = status_of(schedule(), Outcome(result.decision, tuple(jobs), result.started), NOW)
    del status["conditions"]
    assert status == {
        "observedGeneration": 1,
        "activeCount": 1,
        "active": [name_of(5)],
        "lastScheduleTime": "2026-11-20T04:05:00Z",
        "lastSuccessfulTime": "2026-11-20T04:30:00Z",
        "nextScheduleTime": "2026-11-20T04:06:00Z",
    }
    assert on_time(result) == ("True", "JobStarted", f"{words(5)}.")


def test_a_run_that_was_not_started_is_not_the_last_one() -> None:
    result = outcome(verdict=Verdict.WAIT, run=minute(5), last_run=minute(4), active=(job(4),))
    status = status_of(schedule(), result, NOW)
    assert status["lastScheduleTime"] == "2026-11-20T04:04:00Z"
    assert not {"nextScheduleTime", "lastSuccessfulTime"} & set(status)


def test_of_many_active_jobs_the_latest_ten_are_named() -> None:
    status = status_of(schedule(), outcome(*[job(count) for count in range(12)]), NOW)
    assert (status["activeCount"], status["active"]) == (
        12, [name_of(count) for count in range(2, 12)],
    )  # fmt: skip


def test_the_last_success_is_the_latest_end_of_a_job_that_completed() -> None:
    jobs = [
        job(1, "Complete", at="2026-11-20T04:03:00Z"),
        job(2, "Complete", at="2026-11-20T04:02:30Z"),
        job(3, "Failed", at="2026-11-20T04:04:00Z"),
        job(4, "Complete", at=""),
    ]
    for written, last in (("04:01:00", "04:03:00"), ("04:04:30", "04:04:30")):
        before = schedule(status={"lastSuccessfulTime": f"2026-11-20T{written}Z"})
        status = status_of(before, outcome(*jobs), NOW)
        assert status["lastSuccessfulTime"] == f"2026-11-20T{last}Z"


@pytest.mark.parametrize(
    ("seconds", "end"), [(59, "."), (60, ", 60 s late."), (90, ", 90 s late.")]
)
def test_a_start_that_is_a_minute_late_says_so(seconds: float, end: str) -> None:
    now = minute(5) + timedelta(seconds=seconds)
    assert on_time(started(5), now) == ("True", "JobStarted", f"{words(5)}{end}")


@pytest.mark.parametrize(
    ("due", "reason", "missed"),
    [
        (2, "MissedStart", "1 run was missed since the last start."),
        (3, "MissedStart", "2 runs were missed since the last start."),
        (100, "MissedStart", "99 runs were missed since the last start."),
        (101, "TooManyMissedStarts",
         "At least 100 runs were missed, as after a long suspension."),
    ],
)  # fmt: skip
def test_a_start_reports_the_runs_that_were_missed_before_it(
    due: int, reason: str, missed: str
) -> None:
    reported = ("False", reason, f"{words(5)}. {missed}")
    assert on_time(started(5, due=due)) == reported
    late = outcome(job(5), last_run=minute(5), unwritten=True, due=due)
    assert on_time(late) == reported


def test_a_start_names_ten_of_the_jobs_that_it_replaces() -> None:
    replaced = tuple(job(100 + count) for count in range(11))
    names = ", ".join(each.name for each in replaced[:10])
    assert on_time(started(5, replaced=replaced)) == (
        "True", "JobReplaced", f"{words(5)}. It replaces {names}, which was still active.",
    )  # fmt: skip


def test_what_kept_a_run_from_its_start_is_reported() -> None:
    run = timestamp(minute(5))
    refused = outcome(
        verdict=Verdict.START, run=minute(5), due=1,
        refused=Refused("QuotaExceeded", "the quota is full"),
    )  # fmt: skip
    assert on_time(refused) == (
        "False", "QuotaExceeded", f"The run of {run} could not be started: the quota is full",
    )  # fmt: skip
    waits = outcome(verdict=Verdict.WAIT, run=minute(5), active=(job(3), job(4)))
    assert on_time(waits) == (
        "False", "JobActive",
        f"The run of {run} waits for {name_of(3)} to end, since concurrencyPolicy is Forbid.",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("due", "missed"),
    [
        (1, "1 run was missed since the last start."),
        (99, "99 runs were missed since the last start."),
        (100, "At least 100 runs were missed, as after a long suspension."),
        (101, "At least 100 runs were missed, as after a long suspension."),
    ],
)
def test_a_run_after_its_deadline_is_missed_itself(due: int, missed: str) -> None:
    late = outcome(verdict=Verdict.TOO_LATE, run=minute(5), due=due)
    run = f"The run of {timestamp(minute(5))} was not started within startingDeadline (20s)."
    assert on_time(late, before=schedule(startingDeadline="20s"))[2] == f"{run} {missed}"


def test_until_another_run_is_due_the_condition_of_the_last_one_stays() -> None:
    assert on_time(outcome()) == ("True", "NoRunYet", "No run has been due yet.")
    for status, reason in (("True", "JobReplaced"), ("False", "MissedStart")):
        before = schedule(("OnTime", status, reason))
        found = on_time(outcome(last_run=minute(4)), before=before)
        assert found == (status, reason, "As it was.")


def test_a_start_that_no_status_names_is_reported_afterwards() -> None:
    result = outcome(job(4), last_run=minute(4), unwritten=True, due=1)
    before = schedule(("OnTime", "True", "JobStarted"))
    assert on_time(result, before=before) == ("True", "JobStarted", f"{words(4)}.")
    mark = f"Start {timestamp(minute(4))}"
    assert notes(before, result) == [("Normal", "JobStarted", mark)]


def test_a_fresh_schedule_has_nothing_to_report() -> None:
    assert notes(schedule(), outcome()) == []


def test_every_start_is_reported_and_each_once() -> None:
    before = schedule(("OnTime", "True", "JobStarted"))
    mark = f"Start {timestamp(minute(5))}"
    assert notes(before, started(5)) == [("Normal", "JobStarted", mark)]
    assert notes(before, started(5, due=2)) == [("Warning", "MissedStart", mark)]
    assert notes(before, outcome(job(5), last_run=minute(5))) == []


def test_suspending_is_reported_and_so_is_going_on() -> None:
    suspended, mark = schedule(suspend=True), timestamp(NOW)
    reported = [("Normal", "SuspendedBySpec", f"Suspended True {mark}")]
    assert notes(suspended, outcome()) == reported
    again = schedule(("Suspended", "True", "SuspendedBySpec"), suspend=True)
    assert notes(again, outcome()) == []
    assert notes(schedule(("Suspended", "True", "SuspendedBySpec")), started(5)) == [
        ("Normal", "NotSuspended", f"Suspended False {mark}"),
        ("Normal", "JobStarted", f"Start {timestamp(minute(5))}"),
    ]


def test_a_schedule_that_is_understood_is_ready_since_it_was() -> None:
    before = schedule(("Ready", "True", "Scheduled"), ("Stalled", "True", "InvalidSchedule"))
    since = {
        c["type"]: (c["status"], c["reason"], c["lastTransitionTime"])
        for c in status_of(before, outcome(), NOW)["conditions"]
    }
    assert since["Ready"] == ("True", "Scheduled", timestamp(minute(0)))
    assert since["Stalled"] == ("False", "Scheduled", timestamp(NOW))


def test_a_schedule_that_is_not_understood_is_reported_once_and_its_correction_is_not() -> None:
    unusable = outcome(unusable=UnusableScheduleError("InvalidSchedule", "It says no time."))
    conditions = {
        c["type"]: (c["status"], c["reason"], c["message"])
        for c in status_of(schedule(), unusable, NOW)["conditions"]
    }
    assert conditions["Ready"] == ("False", "InvalidSchedule", "It says no time.")
    assert conditions["Stalled"] == ("True", "InvalidSchedule", "It says no time.")
    mark = f"Stalled True {timestamp(NOW)}"
    assert notes(schedule(), unusable) == [("Warning", "InvalidSchedule", mark)]
    before = schedule(("Ready", "False", "InvalidSchedule"), ("Stalled", "True", "InvalidSchedule"))
    assert notes(before, unusable) == []
    assert notes(before, outcome()) == []


def test_what_keeps_a_run_is_reported_when_it_begins_and_marked_by_the_run() -> None:
    waits = outcome(verdict=Verdict.WAIT, run=minute(5), active=(job(4),))
    mark = f"OnTime False {timestamp(minute(5))}"
    assert notes(schedule(), waits) == [("Normal", "JobActive", mark)]
    assert notes(schedule(("OnTime", "False", "JobActive")), waits) == []
    late = outcome(verdict=Verdict.TOO_LATE, run=minute(5), due=1)
    assert notes(schedule(("OnTime", "False", "JobActive")), late) == [
        ("Warning", "MissedStart", mark)
    ]


def test_starts_that_no_status_names_are_reported_before_the_latest() -> None:
    before = schedule(status={"lastScheduleTime": timestamp(minute(1))})
    by_hand = ScheduledJob.from_object(make_job("nightly-by-hand"))
    jobs = [job(count) for count in (1, 2, 3, 4, 9)]
    marks = [f"Start {timestamp(minute(count))}" for count in (2, 3, 4, 5)]
    found = outcome(by_hand, *jobs, last_run=minute(4), unwritten=True, due=1)
    assert notes(before, found) == [("Normal", "JobStarted", mark) for mark in marks[:3]]
    assert notes_of(before, found, NOW)[0].message == f"{words(2)}."
    next_one = Outcome(
        Decision(Verdict.START, run=minute(5), last_run=minute(4), unwritten=True, due=1),
        tuple(jobs), name_of(5),
    )  # fmt: skip
    assert notes(before, next_one) == [("Normal", "JobStarted", mark) for mark in marks]
    known = outcome(*jobs, last_run=minute(4))
    assert notes(before, known) == []


def test_a_schedule_without_a_last_run_reports_no_job_from_before_it() -> None:
    jobs = [job(count) for count in (0, 1, 2)]
    found = outcome(*jobs, last_run=minute(2), unwritten=True, due=1)
    assert [mark for _, _, mark in notes(schedule(), found)] == [
        f"Start {timestamp(minute(count))}" for count in (1, 2)
    ]


def passed(count: int) -> PassedRun:
    return PassedRun(minute(count), name_of(count), f"pvc://results/{name_of(count)}")


def kept(status: Json) -> str:
    return str((status_of(schedule(status=status), outcome(), NOW).get("lastPassed") or {})["job"])


def test_the_latest_run_that_passed_is_kept_when_its_job_is_gone() -> None:
    seen = Outcome(Decision(Verdict.NOTHING_DUE), (), passed=passed(3))
    status = status_of(schedule(), seen, NOW)
    assert status["lastPassed"] == {
        "job": name_of(3), "results": f"pvc://results/{name_of(3)}",
        "scheduleTime": "2026-11-20T04:03:00Z",
    }  # fmt: skip
    assert kept({"lastPassed": status["lastPassed"]}) == name_of(3)
    earlier = Outcome(Decision(Verdict.NOTHING_DUE), (), passed=passed(2))
    again = status_of(schedule(status={"lastPassed": status["lastPassed"]}), earlier, NOW)
    assert again["lastPassed"]["job"] == name_of(3)
    later = Outcome(Decision(Verdict.NOTHING_DUE), (), passed=passed(4))
    again = status_of(schedule(status={"lastPassed": status["lastPassed"]}), later, NOW)
    assert again["lastPassed"]["job"] == name_of(4)
    assert "lastPassed" not in status_of(schedule(), outcome(), NOW)
