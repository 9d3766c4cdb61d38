"""What a driver's /metrics makes of the rows of its cases."""

import copy
from typing import Any

import pytest
from prometheus_client import generate_latest

from bagpipe.driver.metrics import DriverMetrics
from bagpipe.driver.progress import Progress
from tests.unit.bagpipe.fake_agent import RESULT
from tests.unit.bagpipe.jobs import make_job, make_row

STEPS: list[dict[str, Any]] = [
    {"triggers": ["/scan"], "answer": "/out", "by": "count", "released": 5, "answered": 3,
     "no_output": 1, "skipped": 1, "waited_seconds": 0.6, "slowest_seconds": 0.4}
]  # fmt: skip


class Bench:
    def __init__(self, mode: str = "realtime", **playback: Any) -> None:
        job = make_job({}, playback={"mode": mode, **playback})
        self.progress = Progress("pvc://results/r", slots=4)
        self.metrics = DriverMetrics(self.progress, job)

    def value(self, name: str, **labels: str) -> float | None:
        return self.metrics.registry.get_sample_value(f"bagpipe_{name}", labels)


def result(**changed: Any) -> dict[str, Any]:
    made = copy.deepcopy(RESULT) | {"pipe_bytes": 262144, "input_bytes": 4_000_000}
    made["timings"] = {"assemble": 0.02, "play": 5.0}
    made["playback"] |= {"achieved_rate": 0.9, "played_seconds": 5.0, "late_max_seconds": 0.02}
    for part, values in changed.items():
        made[part] |= values
    return made


def test_a_case_is_counted_by_what_it_did() -> None:
    bench = Bench()
    bench.metrics.count(make_row("a", result=result(), seconds=7.5))
    assert bench.value("cases_ended_total", outcome="passed") == 1
    assert bench.value("case_seconds_sum") == 7.5
    assert bench.value("case_part_seconds_sum", part="play") == 5.0
    assert bench.value("case_part_seconds_count", part="run") == 0
    assert bench.value("fragment_read_bytes_total") == 4_000_000
    assert bench.value("pipe_throughput_bytes_per_second_sum") == pytest.approx(2e8)
    assert bench.value("pipe_size_bytes_bucket", le="131072.0") == 0
    assert bench.value("pipe_size_bytes_bucket", le="262144.0") == 1
    assert bench.value("recorder_high_water_bytes_sum") == 5
    assert bench.value("recorded_bytes_total") == 5
    assert bench.value("recorded_messages_total") == 2
    assert bench.value("replay_rate_ratio_sum") == pytest.approx(0.9)
    assert bench.value("replay_late_seconds_sum") == pytest.approx(0.02)
    assert bench.value("replay_bag_seconds_total") == pytest.approx(4.5)
    assert bench.value("replay_played_seconds_total") == 5.0


def test_lock_step_reports_its_waits_and_asks_for_no_rate() -> None:
    step = {"trigger": "/scan", "answer": "/out", "deadline": "2s"}
    bench = Bench("lockstep", steps=[step])
    bench.metrics.count(make_row("a", result=result(playback={"steps": STEPS})))
    assert bench.value("lockstep_wait_seconds_total") == pytest.approx(0.6)
    assert bench.value("lockstep_slowest_answer_seconds_sum") == pytest.approx(0.4)
    results = ("answered", "no_output", "skipped")
    assert [bench.value("lockstep_answers_total", result=r) for r in results] == [3, 1, 1]
    assert bench.value("replay_rate_ratio_count") == 0


def test_every_run_that_does_not_pass_has_its_reason_and_a_users_own_has_none() -> None:
    bench = Bench()
    # As they are now, and as releases before wrote them.
    lossy = [{"reason": "MachineBusy", "message": "", "seconds": 1.0}, "MachineBusy"]
    bench.metrics.count(make_row("a", result=result(), discarded=lossy))
    bench.metrics.count(make_row("b", "errored", "StackExited"))
    bench.metrics.count(make_row("c", "failed", "MyOwnReason8151"))
    assert bench.value("case_faults_total", reason="MachineBusy") == 2
    assert bench.value("case_faults_total", reason="StackExited") == 1
    assert bench.value("case_faults_total", reason="Other") == 1
    assert "MyOwnReason" not in generate_latest(bench.metrics.registry).decode()


def test_what_another_job_has_run_is_not_this_drivers_work() -> None:
    bench = Bench()
    bench.metrics.count(make_row("a", ran_in="an-earlier-job"))
    assert bench.value("cases_ended_total", outcome="passed") == 0


def test_only_the_info_names_the_job() -> None:
    bench = Bench()
    bench.progress.warn("The results can't be kept at the moment")
    lines = generate_latest(bench.metrics.registry).decode().splitlines()
    assert [line.split("{")[0] for line in lines if '"drive"' in line] == ["bagpipe_job_info"]
    named = {"job_namespace": "lab", "job_name": "drive", "job_uid": "uid-1", "attempt": "1"}
    assert bench.value("job_info", engine="ros1", mode="realtime", **named) == 1
    assert (bench.value("slots"), bench.value("results_waiting")) == (4, 1)


def test_a_program_has_no_recording_and_no_rate() -> None:
    bench = Bench()
    program = {"engine": "exec", "timings": {"stack": 0.1, "run": 4.0, "stop": 0.2},
               "bytes_in": 70, "pipe_bytes": 65536, "input_bytes": 90}  # fmt: skip
    bench.metrics.count(make_row("a", result=program))
    assert bench.value("case_part_seconds_sum", part="run") == 4.0
    assert bench.value("fragment_read_bytes_total") == 90
    names = ("recorder_high_water_bytes", "replay_rate_ratio", "pipe_throughput_bytes_per_second")
    assert [bench.value(f"{name}_count") for name in names] == [0, 0, 0]


def test_a_result_that_can_not_be_counted_ends_no_job(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench()
    bench.metrics.count(make_row("a", result={"playback": {"played_seconds": 1.0}}))
    assert bench.value("cases_ended_total", outcome="passed") == 1
    assert "case a: its result can't be counted" in caplog.text


def test_findings_of_criteria_are_counted_and_no_other_names() -> None:
    job = make_job({}, evaluate=[{"name": "rate", "rate": {"topic": "/out", "min": 5}}])
    metrics = DriverMetrics(Progress("pvc://results/r", slots=4), job)
    found = [
        {"name": "rate", "outcome": "failed"},
        {"name": "rate", "outcome": "unknown"},
        {"name": "of nobody", "outcome": "failed"},
    ]
    metrics.count(make_row("a", result=result()) | {"criteria": found})
    metrics.count(make_row("b", result=result()) | {"criteria": None})
    judged = {
        (sample.labels["criterion"], sample.labels["outcome"]): sample.value
        for family in metrics.registry.collect()
        for sample in family.samples
        if sample.name == "bagpipe_criteria_judged_total"
    }
    assert judged == {("rate", "passed"): 0, ("rate", "failed"): 1, ("rate", "invalid"): 0}
