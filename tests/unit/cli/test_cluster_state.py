"""What a job's object says: the sentence that matters, the pace, and how both look."""

from datetime import UTC, datetime
from typing import Any

import pytest
from rich.console import Console

from bagpipe.cli.cluster.pace import Pace, rate_words, time_words
from bagpipe.cli.cluster.screen import Seen, block, line
from bagpipe.cli.cluster.state import Counts, JobState
from tests.unit.cli.cluster_objects import a_job, condition, ended, running


@pytest.mark.parametrize(
    ("conditions", "reason"),
    [
        ([], "NotSeen"),
        ([condition("Accepted", False, "NameTaken")], "NameTaken"),
        (
            [
                condition("Accepted", True, "DriverCreated"),
                condition("Running", False, "Unschedulable"),
                condition("Failed", False, "InProgress"),
            ],
            "Unschedulable",
        ),
        (
            [
                condition("Suspended", True, "JobSuspended"),
                condition("Running", False, "JobFinished"),
            ],
            "JobSuspended",
        ),
        (
            [
                condition("Running", False, "JobFinished"),
                condition("Failed", True, "StackImageUnavailable"),
            ],
            "StackImageUnavailable",
        ),
    ],
)
def test_the_condition_that_matters_now(conditions: list[dict[str, Any]], reason: str) -> None:
    state = JobState.of(a_job(phase="Pending", conditions=conditions))
    assert state.reason == reason


def uncommitted() -> dict[str, Any]:
    """A job whose driver had decided when its storage failed, as operators once wrote it."""
    job = ended("", "StorageFailed")
    job["status"]["verdict"] = "Passed"
    return job


@pytest.mark.parametrize(
    ("job", "status"),
    [
        (ended("Passed"), 0),
        (ended("Failed"), 1),
        (ended("Invalid"), 1),
        (ended("", "StackImageUnavailable"), 2),
        (uncommitted(), 2),
        (running(passed=4), 2),
        (running() | {"status": running()["status"] | {"verdict": "Passed"}}, 2),
        (a_job(), 2),
    ],
)
def test_the_exit_status_is_the_verdict_s(job: dict[str, Any], status: int) -> None:
    assert JobState.of(job).exit_status == status


def test_a_state_as_data() -> None:
    shown = JobState.of(ended("Failed", completionTime="2026-11-20T04:00:00Z")).as_json()
    assert (shown["phase"], shown["verdict"], shown["cases"]["passed"]) == ("Complete", "Failed", 4)
    assert shown["completionTime"] == "2026-11-20T04:00:00+00:00"
    assert "first_case" not in shown


def test_a_failed_job_is_not_shown_as_passed() -> None:
    state = JobState.of(uncommitted())
    assert (state.phase, state.verdict, state.reason) == ("Failed", "", "StorageFailed")


def test_a_rate_is_that_of_the_last_minutes() -> None:
    pace = Pace()
    pace.look(0, 0)
    pace.look(1, 10)
    assert pace.per_second(1) is None  # a second says nothing
    for second in range(10, 1000, 10):
        pace.look(second, 10 + second // 10)  # one in ten seconds from here on
    assert pace.per_second(990) == pytest.approx(0.1, rel=0.05)
    left = pace.seconds_left(990, Counts(planned=209, passed=109))
    assert left == pytest.approx(1000, rel=0.05)


def test_a_job_that_is_seen_late_has_the_rate_since_its_first_case() -> None:
    pace = Pace()
    pace.began(-100)
    pace.look(0, 50)
    assert pace.per_second(0) == pytest.approx(0.5)


def test_a_driver_that_counts_again_starts_a_new_rate() -> None:
    pace = Pace()
    pace.look(0, 0)
    pace.look(10, 20)
    pace.look(20, 5)
    assert pace.per_second(20) is None
    pace.look(30, 10)
    assert pace.per_second(30) == pytest.approx(0.5)


def test_a_job_that_stands_still_gets_slower() -> None:
    pace = Pace()
    pace.look(0, 0)
    pace.look(10, 10)
    assert pace.per_second(10) == pytest.approx(1)
    assert pace.per_second(100) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("per_second", "words"),
    [(None, ""), (2.5, "2.5 cases/s"), (0.5, "30.0 cases/min"), (0.01, "36.0 cases/h")],
)
def test_rates_in_words(per_second: float | None, words: str) -> None:
    assert rate_words(per_second) == words


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(None, ""), (0.4, "0 s"), (59, "59 s"), (60, "1 min"), (125, "2 min 5 s"),
     (12_000, "3 h 20 min"), (180_000, "2 d 2 h")],
)  # fmt: skip
def test_times_in_words(seconds: float | None, words: str) -> None:
    assert time_words(seconds) == words


def seen(job: dict[str, Any], done: int = 0) -> Seen:
    pace = Pace()
    pace.look(0, 0)
    pace.look(60, done)
    return Seen(JobState.of(job), pace, 0.0, 60.0)


def test_a_line_of_a_running_job_has_counts_rate_and_time_left() -> None:
    shown = line(seen(running(10, passed=3, failed=1, running=2), done=4), "12:00:00")
    assert shown == (
        "12:00:00 Running; 4 of 10 cases: 3 passed, 1 failed, 2 running; 4.0 cases/min,"
        " about 1 min 30 s left"
    )


def test_a_line_of_a_stuck_job_has_the_sentence() -> None:
    stuck = condition("Running", False, "VolumeMissing", "Claim x does not exist: create it.")
    shown = line(seen(a_job(phase="Pending", conditions=[stuck])), "12:00:00")
    assert shown == "12:00:00 Pending; VolumeMissing: Claim x does not exist: create it."


def drawn(what: Seen, now: float) -> str:
    console = Console(width=100, record=True, file=None, force_terminal=False)
    with console.capture() as capture:
        console.print(block(what, now))
    return capture.get()


def test_a_block_has_all_that_is_known() -> None:
    job = running(10, passed=3, failed=1, running=2)
    job["status"]["failures"] = [{"case": "a-1", "reason": "Slow", "message": "[b]9 Hz[/b]"}]
    text = drawn(seen(job, done=4), 66)
    assert "nightly  Running  in namespace robots, watched for 1 min 6 s" in text
    assert "40 % 4 of 10 cases" in text
    assert "passed 3  failed 1  invalid 0  errored 0  running 2" in text
    assert "3.6 cases/min, about 1 min 39 s left" in text
    assert "a-1: Slow: [b]9 Hz[/b]" in text
    assert "CasesRunning: Cases are running." in text


def test_what_a_stack_wrote_is_nothing_that_a_terminal_obeys() -> None:
    wrote = "no\x1b[2J\r\nnightly  Complete"
    job = a_job(phase="Pending", conditions=[condition("Running", False, "Late", wrote)])
    shown = line(seen(job), "12:00:00")
    assert shown == "12:00:00 Pending; Late: no [2J  nightly  Complete"
    job["status"]["failures"] = [{"case": "a-1", "reason": "Slow", "message": wrote}]
    text = drawn(seen(job), 66)
    assert text.count("no [2J  nightly  Complete") == 2
    assert [letter for letter in text if not letter.isprintable() and letter != "\n"] == []


def test_times_are_read_with_their_zone() -> None:
    job = running()
    job["status"]["firstCaseTime"] = "2026-11-20T04:00:00Z"
    assert JobState.of(job).first_case == datetime(2026, 11, 20, 4, tzinfo=UTC)
