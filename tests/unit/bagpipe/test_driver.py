"""The driver's parts: what it reports, what it commits, and the cases over a real local Spark."""

import json
import urllib.request
from typing import Any

import pytest

from bagpipe.driver.metrics import DriverMetrics
from bagpipe.driver.progress import Progress
from bagpipe.driver.progress_server import Account, serve_progress
from bagpipe.driver.spark_context import (
    DriverPod,
    local_settings,
    memory_split,
    spark_settings,
)
from bagpipe.plan.made import Unplanned
from bagpipe.run.case_run import Row, unplanned_row
from bagpipe.spec import Images, PodResources
from tests.unit.bagpipe.jobs import make_job
from tests.unit.bagpipe.jobs import make_row as row

MISSING = Unplanned("lost", "pvc://recordings/lost.bag", "BagMissing", "no file at lost.bag")


def finished(planned: int, rows: list[Row], unplanned: list[Unplanned]) -> dict[str, Any]:
    progress = Progress("pvc://results/r")
    progress.begin(planned + len(unplanned))
    for each in [*map(unplanned_row, unplanned), *rows]:
        progress.add(each)
    progress.finish()
    return progress.snapshot()


def test_a_job_whose_cases_all_passed_is_complete() -> None:
    snapshot = finished(2, [row("a", attempts=3, starts=2), row("b", attempts=2)], [])
    assert (snapshot["phase"], snapshot["verdict"], snapshot["reason"]) == (
        "Complete",
        "Passed",
        "AllCasesRan",
    )
    assert snapshot["cases"] == {
        "planned": 2, "running": 0, "passed": 2, "failed": 0, "invalid": 0, "errored": 0,
        "crashed": 0, "lost": 0, "regressed": 0, "discarded": 4, "quarantined": 0,
    }  # fmt: skip
    assert snapshot["ledger"] == {"sent": 6, "received": 6, "dropped": 0, "leadIn": 2}


# Promise: verdict-of-the-job
@pytest.mark.parametrize(
    ("outcome", "verdict"), [("failed", "Failed"), ("invalid", "Invalid"), ("passed", "Passed")]
)
def test_the_verdict_is_the_worst_case(outcome: str, verdict: str) -> None:
    snapshot = finished(2, [row("a"), row("b", outcome)], [])
    assert (snapshot["phase"], snapshot["verdict"]) == ("Complete", verdict)


def test_one_reason_for_all_errors_is_the_jobs_reason() -> None:
    snapshot = finished(1, [row("a")], [MISSING])
    assert (snapshot["phase"], snapshot["reason"], snapshot["verdict"]) == (
        "Failed",
        "BagMissing",
        "",
    )
    assert snapshot["message"] == "1 of 2 cases errored; lost: BagMissing: no file at lost.bag"


def test_several_reasons_are_reported_as_such() -> None:
    snapshot = finished(1, [row("a", "errored", "StackExited")], [MISSING])
    assert snapshot["reason"] == "CasesErrored"
    assert [failure["reason"] for failure in snapshot["failures"]] == ["BagMissing", "StackExited"]


def test_a_case_without_a_row_fails_the_job() -> None:
    snapshot = finished(2, [row("a")], [])
    assert (snapshot["phase"], snapshot["reason"]) == ("Failed", "CasesMissing")


def test_the_termination_message_stays_whole_json_below_four_kibibytes() -> None:
    progress = Progress("pvc://results/r")
    progress.begin(100)
    for number in range(100):
        progress.add(row(f"case-{number}" * 9, "errored", "X", message='"\n' * 4000))
    progress.finish()
    message = progress.termination_message()
    assert len(message) <= 4096
    assert json.loads(message)["cases"]["errored"] == 100


def test_a_job_that_was_stopped_says_why() -> None:
    progress = Progress("pvc://results/r")
    progress.begin(9)
    progress.add(row("a", "errored", "StackExited"))
    assert progress.failed() == 1
    progress.stop("TooManyFailedCases", "enough")
    assert not progress.finish()
    snapshot = progress.snapshot()
    assert (snapshot["phase"], snapshot["reason"], snapshot["message"]) == (
        "Failed", "TooManyFailedCases", "enough",
    )  # fmt: skip


def test_a_warning_is_reported_until_it_has_passed() -> None:
    progress = Progress("pvc://results/r")
    progress.begin(9)
    progress.warn("the volume is full")
    assert progress.snapshot()["warning"] == "the volume is full"
    progress.warn("")
    assert progress.snapshot()["warning"] == ""


def test_no_more_cases_run_than_there_are_slots_or_cases_left() -> None:
    progress = Progress("pvc://results/r", slots=2)
    progress.begin(3)
    progress.set_running(3)
    assert progress.snapshot()["cases"]["running"] == 2
    progress.add(row("a"))
    progress.add(row("b"))
    progress.set_running(3)
    assert progress.snapshot()["cases"]["running"] == 1


def test_progress_and_metrics_are_served() -> None:
    progress = Progress("pvc://results/r")
    progress.begin(3)
    progress.add(row("a"))
    registry = DriverMetrics(progress, make_job({})).registry
    server = serve_progress(Account(progress, registry), "127.0.0.1", 0)
    try:
        address = f"http://127.0.0.1:{server.server_address[1]}"
        with urllib.request.urlopen(f"{address}/progress", timeout=30) as answer:  # noqa: S310
            assert json.load(answer)["cases"]["passed"] == 1
        with urllib.request.urlopen(f"{address}/metrics", timeout=30) as answer:  # noqa: S310
            metrics = answer.read().decode()
        assert 'bagpipe_cases{state="planned"} 3.0' in metrics
        assert 'bagpipe_ledger_messages{counted="received"} 3.0' in metrics
    finally:
        server.shutdown()
        server.server_close()


def test_executor_memory_is_heap_and_overhead_of_what_was_asked_for() -> None:
    assert memory_split(PodResources(memory="4Gi")) == (2048, 2048)
    assert memory_split(PodResources(memory="1Gi")) == (512, 512)


def test_spark_settings_that_decide() -> None:
    spark = {"executors": 3, "slots": 4, "executor": {"resources": {"cpu": "1500m"}}}
    settings = spark_settings(make_job({}, spark=spark), DriverPod("pod", "lab", "198.18.0.9"), 1)
    chosen = {
        "spark.executor.instances": "3",
        "spark.executor.cores": "4",
        "spark.kubernetes.executor.request.cores": "1500m",
        "spark.driver.bindAddress": "198.18.0.9",
        "spark.kubernetes.driver.pod.name": "pod",
        "spark.kubernetes.resource.type": "python",
        "spark.kubernetes.executor.podNamePrefix": "drive-1",
        "spark.authenticate": "true",
        "spark.network.crypto.enabled": "true",
        "spark.executor.maxNumFailures": "2147483647",
    }
    assert {key: settings[key] for key in chosen} == chosen


ALLOCATION = "spark.dynamicAllocation."


@pytest.mark.parametrize(
    ("cases", "slots", "begins_with"), [(1, 2, 2), (5, 2, 3), (6, 2, 3), (1000, 2, 8), (8, 1, 8)]
)
def test_executors_that_come_and_go_begin_as_many_as_have_cases(
    cases: int, slots: int, begins_with: int
) -> None:
    job = make_job({}, spark={"executors": {"min": 2, "max": 8}, "slots": slots})
    settings = spark_settings(job, DriverPod("pod", "lab", "198.18.0.9"), cases)
    assert {k: v for k, v in settings.items() if k.startswith(ALLOCATION)} == {
        f"{ALLOCATION}enabled": "true",
        f"{ALLOCATION}minExecutors": "2",
        f"{ALLOCATION}maxExecutors": "8",
        f"{ALLOCATION}initialExecutors": str(begins_with),
        f"{ALLOCATION}executorIdleTimeout": "15s",
        f"{ALLOCATION}shuffleTracking.enabled": "true",
    }
    # It would be another number to begin with, the larger of which Spark takes.
    assert "spark.executor.instances" not in settings


def test_a_number_of_executors_stays_the_same() -> None:
    settings = spark_settings(make_job({}), DriverPod("pod", "lab", "198.18.0.9"), 9)
    assert [name for name in settings if name.startswith(ALLOCATION)] == []
    elastic = make_job({}, spark={"executors": {"min": 2, "max": 8}})
    assert [name for name in local_settings(elastic, 2) if name.startswith(ALLOCATION)] == []


def test_the_executors_that_metrics_call_wanted_are_those_that_cases_keep_busy() -> None:
    progress = Progress("pvc://results/r")
    job = make_job({}, spark={"executors": {"min": 1, "max": 3}, "slots": 2})
    registry = DriverMetrics(progress, job).registry
    seen = []
    progress.begin(9)
    for name in "abcdefghi":
        seen.append(registry.get_sample_value("bagpipe_executors", {"state": "wanted"}))
        progress.add(row(name))
    assert seen == [3, 3, 3, 3, 3, 2, 2, 1, 1]
    assert registry.get_sample_value("bagpipe_executors", {"state": "wanted"}) == 1


@pytest.mark.parametrize(("timeout", "grace"), [("10m", "600s"), ("9m", "600s"), ("90s", "150s")])
def test_an_executor_that_must_go_has_time_for_its_case(timeout: str, grace: str) -> None:
    job = make_job({}, playback={"caseTimeout": timeout})
    settings = spark_settings(job, DriverPod("pod", "lab", "198.18.0.9"), 1)
    chosen = {
        "spark.decommission.enabled": "true",
        "spark.executor.decommission.signal": "TERM",
        "spark.kubernetes.decommission.script": "/bin/true",
        "spark.kubernetes.executor.terminationGracePeriodSeconds": grace,
    }
    assert {key: settings[key] for key in chosen} == chosen


OWN, ARCHIVED, QUICK = (
    "-XX:+ExitOnOutOfMemoryError",
    "-XX:SharedArchiveFile=/opt/bagpipe/spark.jsa",
    "-XX:TieredStopAtLevel=1",
)


@pytest.mark.parametrize(
    ("cases", "has_archive", "memory", "driver", "executor"),
    [
        (1, True, "4Gi", [OWN, ARCHIVED, QUICK], [ARCHIVED, QUICK]),
        (3000, True, "4Gi", [OWN, ARCHIVED, QUICK], [ARCHIVED, QUICK]),
        (3001, True, "4Gi", [OWN, ARCHIVED], [ARCHIVED]),
        (3001, False, "4Gi", [OWN], None),
        (1, False, "4Gi", [OWN, QUICK], [QUICK]),
        # Half of it is the heap.
        (1, True, "65534Mi", [OWN, ARCHIVED, QUICK], [ARCHIVED, QUICK]),
        (1, True, "64Gi", [OWN, ARCHIVED, QUICK], [QUICK]),
    ],
)
def test_jvms_start_in_the_way_that_their_image_and_work_allow(
    cases: int, has_archive: bool, memory: str, driver: list[str], executor: list[str] | None
) -> None:
    job = make_job({}, spark={"executor": {"resources": {"memory": memory}}})
    pod = DriverPod("pod", "lab", "198.18.0.9", has_archive)
    settings = spark_settings(job, pod, cases)
    assert settings["spark.driver.extraJavaOptions"].split() == driver
    assert settings.get("spark.executor.extraJavaOptions", "").split() == (executor or [])
    assert ("spark.executor.extraJavaOptions" in settings) == (executor is not None)


def test_spark_on_one_machine_starts_quickly_and_ends_when_its_heap_is_full() -> None:
    options = local_settings(make_job({}), 2)["spark.driver.extraJavaOptions"]
    assert options == "-XX:+ExitOnOutOfMemoryError -XX:TieredStopAtLevel=1"


@pytest.mark.parametrize(
    ("given", "policy"), [({}, "IfNotPresent"), ({"pullPolicy": "Always"}, "Always")]
)
def test_executors_are_pulled_as_the_release_says(given: dict[str, str], policy: str) -> None:
    job = make_job({})
    images = Images.model_validate(job.images.model_dump(by_alias=True) | given)
    pod = DriverPod("pod", "lab", "198.18.0.9")
    settings = spark_settings(job.model_copy(update={"images": images}), pod, 1)
    assert settings["spark.kubernetes.container.image.pullPolicy"] == policy


@pytest.mark.parametrize(("timeout", "threshold"), [("10m", "300s"), ("61s", "60s"), ("3m", "90s")])
def test_a_case_with_none_to_compare_with_is_slow_after_half_of_its_timeout(
    timeout: str, threshold: str
) -> None:
    job = make_job({}, playback={"caseTimeout": timeout})
    settings = spark_settings(job, DriverPod("pod", "lab", "198.18.0.9"), 1)
    assert settings["spark.speculation.task.duration.threshold"] == threshold
    assert settings["spark.speculation.minTaskRuntime"] == "60s"
