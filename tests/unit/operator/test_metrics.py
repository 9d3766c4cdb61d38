"""Milestones by what two statuses say, and the figures that a scrape shows of them."""

import contextlib
import itertools
from typing import Any

import pytest
from prometheus_client import generate_latest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs import milestones
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import WorkQueue
from tests.unit.operator.builders import make_driver, make_executor, make_job
from tests.unit.operator.world import World

DAY = "2026-11-20T04:"


def at(minutes_seconds: str) -> str:
    return f"{DAY}{minutes_seconds}Z"


def condition(type_: str, since: str, status: str = "True", reason: str = "X") -> dict[str, str]:
    return {"type": type_, "status": status, "reason": reason, "lastTransitionTime": at(since)}


def job(*conditions: dict[str, str], **status: Any) -> JobView:
    built = make_job("x").with_status(conditions=list(conditions), **status)
    built.object["metadata"]["creationTimestamp"] = at("00:00")
    return built.view()


ACCEPTED, PLANNED = condition("Accepted", "00:03"), condition("Planned", "00:10")
COMPLETE = condition("Complete", "09:12")


def test_each_transition_of_a_job_is_reported_once() -> None:
    story = [
        job(),
        job(ACCEPTED, attempt=1),
        job(ACCEPTED, PLANNED, attempt=1),
        job(ACCEPTED, PLANNED, attempt=1, firstCaseTime=at("00:30")),
        job(ACCEPTED, PLANNED, attempt=1, firstCaseTime=at("00:30")),
        job(ACCEPTED, PLANNED, COMPLETE, phase="Complete", verdict="Failed", attempt=1,
            firstCaseTime=at("00:30"), completionTime=at("09:12")),
    ]  # fmt: skip
    reported = [list(milestones.passed(*pair)) for pair in itertools.pairwise(story)]
    assert reported == [
        [("created_to_accepted", 3.0)],
        [("accepted_to_planned", 7.0)],
        [("planned_to_running", 20.0)],
        [],
        [("running_to_ended", 522.0)],
    ]
    assert milestones.ended(story[-2], story[-1]) == milestones.Ended("Complete", "Failed")
    assert milestones.ended(story[-1], story[-1]) is None
    assert list(milestones.passed(story[-1], story[-1])) == []


def test_a_second_driver_is_accepted_without_a_second_creation() -> None:
    lost = job(condition("Accepted", "05:00", "False"), PLANNED, attempt=2)
    again = job(condition("Accepted", "05:10"), PLANNED, attempt=2)
    assert list(milestones.passed(lost, again)) == []


def test_the_time_of_a_suspension_is_nobodys_delay() -> None:
    resumed = condition("Suspended", "50:00", "False", "JobResumed")
    before, after = job(resumed), job(condition("Accepted", "50:02"), resumed, attempt=1)
    assert list(milestones.passed(before, after)) == [("created_to_accepted", 2.0)]
    # Its first driver is suspended after the plan; the next one's start begins the next clock.
    going_on = job(ACCEPTED, PLANNED, startTime=at("51:00"), attempt=2)
    running = job(ACCEPTED, PLANNED, startTime=at("51:00"), firstCaseTime=at("51:09"), attempt=2)
    assert list(milestones.passed(going_on, running)) == [("planned_to_running", 9.0)]


def test_a_job_that_was_never_suspended_is_accepted_since_its_creation() -> None:
    never = condition("Suspended", "00:02", "False", "NotSuspended")
    assert list(milestones.passed(job(), job(never, ACCEPTED))) == [("created_to_accepted", 3.0)]


def test_clocks_that_differ_make_no_time_less_than_none() -> None:
    before, after = job(ACCEPTED), job(ACCEPTED, condition("Planned", "00:02"))
    assert list(milestones.passed(before, after)) == [("accepted_to_planned", 0.0)]


def test_what_never_ran_took_no_time_to_run() -> None:
    failed = job(condition("Failed", "00:40"), phase="Failed", completionTime=at("00:40"))
    assert list(milestones.passed(job(), failed)) == []
    assert milestones.ended(job(), failed) == milestones.Ended("Failed", "None")


async def test_a_status_that_somebody_else_writes_again_and_again_adds_no_series() -> None:
    """Its words would be labels, and each of them would stay in the operator's memory."""
    world, series = World(), list[int]()
    metrics = JobMetrics(world.view, WorkQueue())
    world.restart(counted=metrics.job_written)
    await world.reconcile()
    for number in range(20):
        # Between the operator's look and its write, which is refused: it may be the operator's own.
        odd = number % 2
        ends = condition("Failed" if number % 4 == 1 else "Complete", "00:00", str(bool(odd)))
        written = world.api.objects["jobs", "x"]
        written["metadata"]["resourceVersion"] = str(1000 + number)
        written["status"] = {
            "phase": f"p{number}", "verdict": f"v{number}", "conditions": [ends],
            "pool": {"state": "Cold" if odd else "", "reason": f"r{number}"},
        }  # fmt: skip
        with contextlib.suppress(ApiError):
            await world.reconcile(after=3)
        series.append(len(generate_latest(metrics.registry).splitlines()))
    assert series[-1] == series[4]
    counts = [value(metrics, "bagpipe_jobs_ended_total", phase=phase, verdict="None")
              for phase in ("Complete", "Failed")]  # fmt: skip
    assert all(counts)


def value(metrics: JobMetrics, name: str, **labels: str) -> float | None:
    return metrics.registry.get_sample_value(name, labels)


def test_a_scrape_has_transitions_ends_calls_and_questions() -> None:
    metrics = JobMetrics(View(), WorkQueue())
    done = job(ACCEPTED, COMPLETE, phase="Complete", verdict="Passed", attempt=1,
               firstCaseTime=at("00:30"), completionTime=at("00:50"))  # fmt: skip
    metrics.job_written(job(ACCEPTED, attempt=1), done)
    assert value(metrics, "bagpipe_job_running_to_ended_seconds_sum") == 20.0
    assert value(metrics, "bagpipe_jobs_ended_total", phase="Complete", verdict="Passed") == 1
    assert value(metrics, "bagpipe_jobs_ended_total", phase="Failed", verdict="None") == 0
    for status in (200, 429, 0):
        metrics.api_called("PATCH", status, 0.3)
    codes = [value(metrics, "bagpipe_api_requests_total", verb="PATCH", code=code)
             for code in ("200", "429", "none")]  # fmt: skip
    assert codes == [1, 1, 1]
    assert value(metrics, "bagpipe_api_throttled_total") == 1
    assert value(metrics, "bagpipe_api_request_seconds_sum", verb="PATCH") == pytest.approx(0.9)
    metrics.status_paced("put_off")
    assert value(metrics, "bagpipe_status_decisions_total", decision="put_off") == 1
    metrics.driver_asked(answered=False)
    assert value(metrics, "bagpipe_driver_requests_total", result="silent") == 1


def test_a_scrape_counts_the_pods_and_cases_of_the_fleet() -> None:
    view = View()
    view.put_job(make_job("a").with_status(phase="Running", cases={"passed": 3}).view())
    over = [{"type": "Complete", "status": "True"}]
    view.put_job(make_job("b").with_status(conditions=over, cases={"passed": 50}).view())
    view.put_pod(make_driver("a").running().view())
    view.put_pod(make_executor("a").view())
    metrics = JobMetrics(view, WorkQueue())
    assert value(metrics, "bagpipe_unfinished_cases", state="passed") == 3
    assert value(metrics, "bagpipe_pods", role="driver", phase="Running") == 1
    assert value(metrics, "bagpipe_pods", role="executor", phase="Pending") == 1
    assert value(metrics, "bagpipe_oldest_pending_job_seconds") == 0
    view.put_job(job())
    assert (value(metrics, "bagpipe_oldest_pending_job_seconds") or 0) > 0


@pytest.mark.parametrize(("leads", "least"), [(True, 600.0), (False, 0.0)])
def test_a_status_that_nobody_looks_at_gets_older(
    leads: bool, least: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [1000.0]
    monkeypatch.setattr("bagpipe_operator.jobs.metrics.time.monotonic", lambda: clock[0])
    view = View()
    view.put_job(make_job("a").view())
    metrics = JobMetrics(view, WorkQueue(), leads=lambda: leads)
    assert value(metrics, "bagpipe_status_age_seconds") == 0
    clock[0] += 600
    assert value(metrics, "bagpipe_status_age_seconds") == least
    metrics.reconciled("uid-of-a")
    assert value(metrics, "bagpipe_status_age_seconds") == 0


def test_no_metric_names_a_job() -> None:
    view = View()
    view.put_job(make_job("alpha").with_status(phase="Running").view())
    view.put_pod(make_driver("alpha").running().view())
    metrics = JobMetrics(view, WorkQueue())
    metrics.reconciled("uid-of-alpha")
    assert "alpha" not in generate_latest(metrics.registry).decode()
