"""What the last jobs of schedules came to: in metrics of bounded number, and in their statuses."""

from datetime import timedelta
from typing import Any

import pytest
from prometheus_client import CollectorRegistry

from bagpipe_operator.api.objects import Json
from bagpipe_operator.schedules.decide import Decision, Verdict
from bagpipe_operator.schedules.metrics import MOST_SHOWN, ScheduleMetrics
from bagpipe_operator.schedules.status import Outcome, status_of
from bagpipe_operator.schedules.view import ScheduledJob, Schedules, ScheduleView, job_name
from tests.unit.operator.schedules.world import (
    CREATED,
    UID,
    make_job,
    make_schedule,
    minute,
    name_of,
)

NOW = CREATED + timedelta(hours=60)


def ended(
    count: int, end: str = "Complete", verdict: str = "", uid: str = UID, **more: Any
) -> Json:
    job = make_job(name_of(count), end, uid)
    status = {"verdict": verdict} if verdict else {}
    job["status"] |= status | {"startTime": "2026-11-20T04:10:00Z"} | more
    return job


class Shown:
    """The metrics of schedules and jobs as Prometheus reads them."""

    def __init__(self, schedules: list[Json], jobs: list[Json]) -> None:
        view = Schedules()
        for each in schedules:
            view.put_schedule(ScheduleView.from_object(each))
        for each in jobs:
            view.put_job(ScheduledJob.from_object(each))
        self.registry = CollectorRegistry()
        ScheduleMetrics(view, self.registry, lambda: NOW)

    def last(self) -> dict[str, float | None]:
        verdicts = ("Passed", "Failed", "Invalid", "Errored", "None")
        return {v: self._value("schedules_last_job", verdict=v) for v in verdicts}

    def red_seconds(self) -> float | None:
        return self._value("schedules_longest_red_seconds")

    def of_nightly(self, name: str, **labels: str) -> float | None:
        return self._value(name, job_namespace="lanes", schedule="nightly", **labels)

    def series(self) -> int:
        return sum(
            len(family.samples)
            for family in self.registry.collect()
            if family.name.startswith("bagpipe_schedule_job_")
        )

    def _value(self, name: str, **labels: str) -> float | None:
        return self.registry.get_sample_value(f"bagpipe_{name}", labels)


def test_the_last_job_that_ended_is_shown_and_not_one_that_runs() -> None:
    counts = {"planned": 9, "passed": 6, "failed": 2, "errored": 1, "regressed": 1}
    worse = {"variant": "", "verdict": "worse", "regressed": 1, "fixed": 0, "flaky": 3}
    jobs = [
        ended(1, verdict="Passed"),
        ended(2, verdict="Failed", cases=counts, comparisons=[worse, worse]),
        make_job(name_of(3)),
    ]
    shown = Shown([make_schedule()], jobs)
    info = shown.of_nightly("schedule_job_info", job_name=name_of(2), verdict="Failed")
    assert info == 1
    found = {
        state: shown.of_nightly("schedule_job_cases", state=state)
        for state in ("passed", "failed", "invalid", "errored", "regressed", "flaky", "quarantined")
    }
    assert found == {
        "passed": 6, "failed": 2, "invalid": 0, "errored": 1, "regressed": 1, "flaky": 6,
        "quarantined": 0,
    }  # fmt: skip
    assert shown.of_nightly("schedule_job_seconds") == 1200
    assert shown.last() == {"Passed": 0, "Failed": 1, "Invalid": 0, "Errored": 0, "None": 0}


@pytest.mark.parametrize(
    ("job", "verdict"),
    [
        (ended(1, verdict="Passed"), "Passed"),
        (ended(1), "Invalid"),
        (ended(1, verdict="Invalid"), "Invalid"),
        (ended(1, "Failed", verdict="Passed"), "Errored"),
        (make_job(name_of(1)), "None"),
    ],
)
def test_a_verdict_is_one_of_five(job: Json, verdict: str) -> None:
    found = Shown([make_schedule()], [job]).last()
    assert [name for name, count in found.items() if count] == [verdict]


def test_a_schedule_is_red_since_it_last_passed() -> None:
    passed = {"lastPassedTime": (NOW - timedelta(hours=7)).strftime("%Y-%m-%dT%H:%M:%SZ")}
    schedule = make_schedule()
    assert Shown([schedule], [ended(1, verdict="Failed")]).red_seconds() == 60 * 3600
    assert Shown([schedule | {"status": passed}], [ended(1, verdict="Failed")]).red_seconds() == (
        7 * 3600
    )
    assert Shown([schedule], [ended(1, verdict="Passed")]).red_seconds() == 0
    assert Shown([schedule], []).red_seconds() == 0


def test_who_is_suspended_rings_no_alarm() -> None:
    shown = Shown([make_schedule(suspend=True)], [ended(1, verdict="Failed")])
    assert (sum(v or 0 for v in shown.last().values()), shown.red_seconds()) == (0, 0)


def test_of_many_schedules_the_first_hundred_are_shown_and_all_are_counted() -> None:
    schedules, jobs = [], []
    for number in range(250):
        schedule = make_schedule()
        schedule["metadata"] |= {"name": f"s{number:03}", "uid": f"u{number}"}
        schedules.append(schedule)
        job = ended(1, verdict="Failed", uid=f"u{number}")
        job["metadata"]["name"] = job_name(schedule["metadata"]["name"], minute(1))
        jobs.append(job)
    shown = Shown(schedules, jobs)
    assert shown.series() == MOST_SHOWN * 9 == 900
    assert shown.last()["Failed"] == 250


def test_a_job_that_runs_changes_nothing_that_a_schedule_goes_by() -> None:
    view = Schedules()
    job = make_job(name_of(1))
    job["status"] = {"cases": {"passed": 1}}
    assert view.put_job(ScheduledJob.from_object(job))
    job["status"] = {"cases": {"passed": 2}}
    assert not view.put_job(ScheduledJob.from_object(job))


def test_when_it_last_passed_is_kept_when_the_job_is_gone() -> None:
    schedule = ScheduleView.from_object(make_schedule())
    jobs = tuple(
        ScheduledJob.from_object(ended(count, verdict=verdict, completionTime=f"2026-11-20T{at}Z"))
        for count, verdict, at in ((1, "Passed", "04:31:00"), (2, "Failed", "04:32:00"))
    )
    decision = Decision(Verdict.NOTHING_DUE)
    status = status_of(schedule, Outcome(decision, jobs), minute(9))
    assert status["lastPassedTime"] == "2026-11-20T04:31:00Z"
    assert status["lastSuccessfulTime"] == "2026-11-20T04:32:00Z"
    later = ScheduleView.from_object(make_schedule() | {"status": status})
    again = status_of(later, Outcome(decision, jobs[1:]), minute(10))
    assert again["lastPassedTime"] == "2026-11-20T04:31:00Z"
