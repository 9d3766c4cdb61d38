"""One moment, and the whole of what a schedule needs then."""

from datetime import datetime, timedelta
from typing import Any

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.schedules.cron import read_zone
from bagpipe_operator.schedules.decide import Decision, Verdict, decide, time_zone_of
from bagpipe_operator.schedules.view import ScheduledJob, ScheduleView
from tests.unit.operator.schedules.world import make_job, make_schedule, minute, name_of

SECOND = timedelta(seconds=1)
HOURLY = "0 * * * *"


def job(count: int, end: str = "", name: str = "", deleting: bool = False) -> ScheduledJob:
    """The job of the run `count` minutes after 04:00."""
    made = make_job(name or name_of(count), end)
    if deleting:
        made["metadata"]["deletionTimestamp"] = "2026-11-20T04:30:00Z"
    return ScheduledJob.from_object(made)


def view_of(written: int | None, spec: dict[str, Any]) -> ScheduleView:
    status: Json = {}
    if written is not None:
        status = {"lastScheduleTime": minute(written).strftime("%Y-%m-%dT%H:%M:%SZ")}
    return ScheduleView.from_object(make_schedule(**spec) | {"status": status})


def decided(
    now: datetime, *jobs: ScheduledJob, written: int | None = None, **spec: Any
) -> Decision:
    """The decision about a schedule whose status names the run `written`."""
    schedule = view_of(written, spec)
    return decide(schedule, jobs, now, read_zone(time_zone_of(schedule)))


def test_before_its_first_run_a_schedule_waits_for_it() -> None:
    assert decided(minute(0) + 40 * SECOND) == Decision(
        Verdict.NOTHING_DUE, next_run=minute(1), wake=minute(1)
    )


def test_a_run_is_due_at_its_very_moment() -> None:
    assert decided(minute(1)) == Decision(
        Verdict.START, run=minute(1), due=1, next_run=minute(2), wake=minute(2)
    )


def test_a_run_that_the_status_names_is_not_due_again() -> None:
    assert decided(minute(5) + 59 * SECOND, written=5) == Decision(
        Verdict.NOTHING_DUE, last_run=minute(5), next_run=minute(6), wake=minute(6)
    )


def test_the_latest_of_the_missed_runs_is_due_and_all_are_counted() -> None:
    found = decided(minute(8), written=5)
    assert (found.verdict, found.run, found.due) == (Verdict.START, minute(8), 3)


@pytest.mark.parametrize(("missed", "due"), [(100, 100), (101, 101), (400, 101)])
def test_missed_runs_are_counted_up_to_one_more_than_a_hundred(missed: int, due: int) -> None:
    assert decided(minute(1 + missed), written=1).due == due


@pytest.mark.parametrize(
    ("jobs", "now", "run", "due"),
    [
        ((3,), 3, None, 2),  # the run of 04:02 was missed
        ((2, 3), 3, None, 1),
        ((3,), 4, 4, 2),
        ((2, 3), 4, 4, 1),
        ((1, 3), 5, 5, 3),  # that of 04:01 is in the status already
    ],
)
def test_runs_that_have_jobs_were_not_missed_though_no_status_names_them(
    jobs: tuple[int, ...], now: int, run: int | None, due: int
) -> None:
    found = decided(minute(now) + 20 * SECOND, *[job(count) for count in jobs], written=1)
    assert found.run == (None if run is None else minute(run))
    assert (found.last_run, found.unwritten, found.due) == (minute(3), True, due)


def test_jobs_of_runs_that_are_written_or_still_to_come_take_nothing_from_the_missed() -> None:
    found = decided(minute(5), job(1), job(2), job(9), written=3)
    assert (found.run, found.due) == (minute(5), 2)


def test_jobs_of_an_earlier_schedule_do_not_make_a_due_run_none() -> None:
    jobs = [job(count) for count in (5, 6, 7)]
    found = decided(minute(60), *jobs, schedule=HOURLY)
    assert (found.verdict, found.run, found.due) == (Verdict.START, minute(60), 1)


def test_a_job_that_has_another_shape_of_name_is_of_no_run() -> None:
    found = decided(minute(1), job(0, name="nightly-by-hand"))
    assert (found.run, found.last_run, found.due) == (minute(1), None, 1)
    assert [each.name for each in found.active] == ["nightly-by-hand"]


def test_the_job_of_a_run_to_come_is_not_the_last_one_s() -> None:
    ahead = decided(minute(5), job(6))
    assert (ahead.last_run, ahead.unwritten, ahead.run) == (None, False, minute(5))
    just = decided(minute(5), job(5))
    assert (just.last_run, just.unwritten, just.run) == (minute(5), True, None)


def test_a_last_run_up_to_ten_minutes_ahead_is_another_replica_s() -> None:
    found = decided(minute(10), written=20)
    assert (found.verdict, found.last_run) == (Verdict.NOTHING_DUE, minute(20))


def test_a_last_run_further_ahead_is_of_a_clock_that_was_set_back() -> None:
    assert decided(minute(10) - SECOND, written=20) == Decision(
        Verdict.NOTHING_DUE, last_run=minute(9), next_run=minute(10), wake=minute(10)
    )


def test_a_suspended_schedule_starts_nothing_and_still_tidies_up() -> None:
    ended = [job(count, "Complete") for count in range(1, 5)]
    found = decided(minute(10), *ended, suspend=True)
    assert (found.verdict, found.run, found.next_run, found.wake) == (
        Verdict.NOTHING_DUE, None, None, None,
    )  # fmt: skip
    assert found.surplus == (ended[0],)


@pytest.mark.parametrize("suspend", [False, True])
@pytest.mark.parametrize(
    ("spec", "reason"),
    [
        ({"schedule": "often"}, "InvalidSchedule"),
        ({"schedule": None}, "InvalidSchedule"),
        ({"schedule": "* * */20 * 1L"}, "InvalidSchedule"),  # no moment in fifty years
        ({"timeZone": "Mars/Base"}, "UnknownTimeZone"),
    ],
)
def test_a_schedule_that_says_no_time_starts_nothing(
    spec: dict[str, Any], reason: str, suspend: bool
) -> None:
    found = decided(minute(10), suspend=suspend, **spec)
    assert found.unusable is not None
    assert found.unusable.reason == reason
    assert (found.verdict, found.run, found.wake) == (Verdict.NOTHING_DUE, None, None)


def test_without_a_time_zone_runs_go_by_utc() -> None:
    assert time_zone_of(view_of(None, {"timeZone": None})) == "Etc/UTC"
    assert time_zone_of(view_of(None, {"timeZone": "Europe/Berlin"})) == "Europe/Berlin"


@pytest.mark.parametrize(("seconds", "verdict"), [(20, Verdict.START), (20.001, Verdict.TOO_LATE)])
def test_a_run_is_started_until_its_deadline(seconds: float, verdict: Verdict) -> None:
    now = minute(60) + timedelta(seconds=seconds)
    found = decided(now, schedule=HOURLY, startingDeadline="20s")
    assert (found.verdict, found.run, found.due) == (verdict, minute(60), 1)


def test_what_becomes_of_active_jobs_when_a_run_is_due() -> None:
    active, ended = job(1), job(2, "Complete")
    allowed = decided(minute(3), active, ended)
    assert (allowed.verdict, allowed.active, allowed.replaced) == (Verdict.START, (active,), ())
    default = decided(minute(3), active, ended, concurrencyPolicy=None)
    assert (default.verdict, default.replaced) == (Verdict.START, ())
    replaced = decided(minute(3), active, ended, concurrencyPolicy="Replace")
    assert (replaced.verdict, replaced.replaced) == (Verdict.START, (active,))
    forbidden = decided(minute(3), active, ended, concurrencyPolicy="Forbid")
    assert (forbidden.verdict, forbidden.run) == (Verdict.WAIT, minute(3))
    free = decided(minute(3), ended, concurrencyPolicy="Forbid")
    assert free.verdict is Verdict.START


@pytest.mark.parametrize(
    ("deadline", "wake"),
    [(None, minute(120)), ("60s", minute(61) + SECOND), ("2h", minute(120))],
)
def test_a_run_that_waits_is_reported_as_missed_a_second_after_its_deadline(
    deadline: str | None, wake: datetime
) -> None:
    found = decided(
        minute(60), job(0), schedule=HOURLY, concurrencyPolicy="Forbid", startingDeadline=deadline
    )
    assert (found.verdict, found.wake) == (Verdict.WAIT, wake)


@pytest.mark.parametrize(
    ("limits", "surplus"),
    [
        ({}, [1, 2, 6, 7]),
        ({"successfulJobsHistoryLimit": 4, "failedJobsHistoryLimit": 2}, [1, 6]),
        ({"successfulJobsHistoryLimit": 0, "failedJobsHistoryLimit": 9}, [1, 2, 3, 4, 5]),
        ({"successfulJobsHistoryLimit": 6, "failedJobsHistoryLimit": 4}, []),
    ],
)
def test_of_ended_jobs_the_latest_are_kept_good_and_failed_ones_apart(
    limits: dict[str, int], surplus: list[int]
) -> None:
    good = [job(count, "Complete") for count in range(1, 6)]
    bad = [job(count, "Failed") for count in range(6, 9)]
    found = decided(minute(9), *good, *bad, job(0, "Complete", deleting=True), job(9), **limits)
    assert [each.name for each in found.surplus] == [name_of(count) for count in surplus]


@pytest.mark.parametrize("end", ["Complete", "Failed"])
@pytest.mark.parametrize(
    ("states", "stays"),
    [(["Pending"], True), (["Delivered", "Pending"], True), (["Delivered", "Failed"], False)],
)
def test_a_job_is_kept_beyond_the_limits_until_all_are_notified_of_it(
    end: str, states: list[str], *, stays: bool
) -> None:
    """An operator that is restarted knows from its status alone who is still to be."""
    made = make_job(name_of(1), end)
    made["status"]["notifications"] = [{"receiver": "team", "state": state} for state in states]
    limits = {"successfulJobsHistoryLimit": 0, "failedJobsHistoryLimit": 0}
    found = decided(minute(1), ScheduledJob.from_object(made), job(2, end), **limits)
    assert [each.name for each in found.surplus] == [name_of(1)] * (not stays) + [name_of(2)]
