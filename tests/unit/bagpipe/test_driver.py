"""The driver's parts: what it tells, what it commits, and the cases over a real local Spark."""

import json
import os
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pyspark import SparkConf, SparkContext

from bagpipe.driver.progress import Progress
from bagpipe.driver.progress_server import serve_progress
from bagpipe.driver.results import commit, first_rows, results_uri
from bagpipe.driver.simulate import simulate
from bagpipe.driver.spark_context import DriverPod, memory_split, quantity, spark_settings
from bagpipe.plan.cases import Unplanned, plan
from bagpipe.run.case_run import Row, RunContext
from bagpipe.spec import PodResources
from bagpipe.storage import Storage
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.fake_agent import RESULT, FakeAgent, make_slot, well_behaved
from tests.unit.bagpipe.jobs import make_job, make_spec


def row(case: str, outcome: str = "passed", reason: str = "", **changed: Any) -> Row:
    made: Row = {
        "case": case,
        "bag": "pvc://recordings/a.bag",
        "outcome": outcome,
        "reason": reason,
        "message": f"why {case}" if reason else "",
        "recorded": f"cases/{case}.bag" if outcome == "passed" else None,
        "result": RESULT if outcome == "passed" else None,
        "attempts": 1,
    }
    return made | changed


MISSING = Unplanned("lost", "pvc://recordings/lost.bag", "BagMissing", "no file at lost.bag")


def finished(planned: int, rows: list[Row], unplanned: list[Unplanned]) -> dict[str, Any]:
    progress = Progress("pvc://results/r")
    progress.begin(planned, unplanned)
    for each in rows:
        progress.add(each)
    progress.finish()
    return progress.snapshot()


def test_a_job_whose_cases_all_passed_is_complete() -> None:
    told = finished(2, [row("a"), row("b", attempts=2)], [])
    assert (told["phase"], told["verdict"], told["reason"]) == ("Complete", "Passed", "AllCasesRan")
    assert told["cases"] == {
        "planned": 2, "running": 0, "passed": 2, "failed": 0, "invalid": 0, "errored": 0,
        "retried": 1,
    }  # fmt: skip
    assert told["ledger"] == {"sent": 6, "received": 6, "dropped": 0, "leadIn": 2}


@pytest.mark.parametrize(
    ("outcome", "verdict"), [("failed", "Failed"), ("invalid", "Invalid"), ("passed", "Passed")]
)
def test_the_verdict_is_the_worst_case(outcome: str, verdict: str) -> None:
    told = finished(2, [row("a"), row("b", outcome)], [])
    assert (told["phase"], told["verdict"]) == ("Complete", verdict)


def test_one_reason_for_all_errors_is_the_jobs_reason() -> None:
    told = finished(1, [row("a")], [MISSING])
    assert (told["phase"], told["reason"], told["verdict"]) == ("Failed", "BagMissing", "")
    assert told["message"] == "1 of 2 cases errored; lost: BagMissing: no file at lost.bag"


def test_several_reasons_are_told_as_such() -> None:
    told = finished(1, [row("a", "errored", "StackExited")], [MISSING])
    assert told["reason"] == "CasesErrored"
    assert [failure["reason"] for failure in told["failures"]] == ["BagMissing", "StackExited"]


def test_a_case_without_a_row_fails_the_job() -> None:
    told = finished(2, [row("a")], [])
    assert (told["phase"], told["reason"]) == ("Failed", "CasesMissing")


def test_the_termination_message_stays_whole_json_below_four_kibibytes() -> None:
    progress = Progress("pvc://results/r")
    progress.begin(100, [])
    for number in range(100):
        progress.add(row(f"case-{number}" * 9, "errored", "X", message='"\n' * 4000))
    progress.finish()
    message = progress.termination_message()
    assert len(message) <= 4096
    assert json.loads(message)["cases"]["errored"] == 100


def test_no_more_cases_run_than_there_are_slots_or_cases_left() -> None:
    progress = Progress("pvc://results/r", slots=2)
    progress.begin(3, [])
    progress.set_running(3)
    assert progress.snapshot()["cases"]["running"] == 2
    progress.add(row("a"))
    progress.add(row("b"))
    progress.set_running(3)
    assert progress.snapshot()["cases"]["running"] == 1


def test_progress_and_metrics_are_served() -> None:
    progress = Progress("pvc://results/r")
    progress.begin(3, [])
    progress.add(row("a"))
    server = serve_progress(progress, "127.0.0.1", 0)
    try:
        address = f"http://127.0.0.1:{server.server_address[1]}"
        with urllib.request.urlopen(f"{address}/progress", timeout=5) as answer:  # noqa: S310
            assert json.load(answer)["cases"]["passed"] == 1
        with urllib.request.urlopen(f"{address}/metrics", timeout=5) as answer:  # noqa: S310
            metrics = answer.read().decode()
        assert 'bagpipe_cases{state="planned"} 3.0' in metrics
        assert 'bagpipe_ledger_messages{counted="received"} 3.0' in metrics
    finally:
        server.shutdown()
        server.server_close()


def test_the_manifest_names_what_counts_and_the_rest_is_removed(tmp_path: Path) -> None:
    job = make_job({"results": str(tmp_path)})
    storage = Storage(job.volumes)
    folder = tmp_path / "out/drive/uid-1"
    for name in ("a.bag", "b.bag", "stale.bag"):
        with storage.create(f"{results_uri(job)}/cases/{name}") as file:
            file.write(b"bag")
    rows = first_rows([row("b"), row("a"), row("a", recorded="cases/stale.bag")])
    progress = Progress(results_uri(job))
    progress.begin(2, [MISSING])
    commit(job, rows, [MISSING], progress, storage)
    assert sorted(p.name for p in (folder / "cases").iterdir()) == ["a.bag", "b.bag"]
    manifest = json.loads((folder / "manifest.json").read_text())
    assert [(c["case"], c["outcome"], c["recorded"]) for c in manifest["cases"]] == [
        ("a", "passed", "cases/a.bag"),
        ("b", "passed", "cases/b.bag"),
        ("lost", "errored", None),
    ]
    lines = (folder / "results.jsonl").read_text().splitlines()
    assert [json.loads(line)["case"] for line in lines] == ["a", "b", "lost"]


@pytest.mark.parametrize(
    ("text", "value"), [("500m", 0.5), ("2", 2), ("1Gi", 2**30), ("1.5G", 1.5e9), ("64Mi", 2**26)]
)
def test_quantities(text: str, value: float) -> None:
    assert quantity(text) == value


def test_executor_memory_is_heap_and_overhead_of_what_was_asked_for() -> None:
    assert memory_split(PodResources(memory="4Gi")) == (2048, 2048)
    assert memory_split(PodResources(memory="1Gi")) == (512, 512)


def test_spark_settings_that_decide() -> None:
    spark = {"executors": 3, "slots": 4, "executor": {"resources": {"cpu": "1500m"}}}
    settings = spark_settings(make_job({}, spark=spark), DriverPod("pod", "lab", "198.18.0.9"))
    chosen = {
        "spark.executor.instances": "3",
        "spark.executor.cores": "4",
        "spark.kubernetes.executor.request.cores": "1500m",
        "spark.driver.bindAddress": "198.18.0.9",
        "spark.kubernetes.driver.pod.name": "pod",
        "spark.kubernetes.resource.type": "python",
        "spark.kubernetes.executor.podNamePrefix": "drive-1",
    }
    assert {key: settings[key] for key in chosen} == chosen


@pytest.fixture(scope="module")
def spark() -> Iterator[SparkContext]:
    # Spark's Python workers are to be the Python that runs the tests, whatever PATH says.
    os.environ["PYSPARK_PYTHON"] = sys.executable
    conf = SparkConf().setMaster("local[2]").set("spark.ui.enabled", "false")
    conf.set("spark.driver.host", "127.0.0.1").set("spark.driver.bindAddress", "127.0.0.1")
    context = SparkContext(conf=conf)
    yield context
    context.stop()


def test_cases_over_spark_come_back_once_each(spark: SparkContext, tmp_path: Path) -> None:
    volumes = {name: str(tmp_path / name) for name in ("recordings", "results")}
    (tmp_path / "recordings").mkdir()
    for name in "abcdef":
        write_bag(tmp_path / f"recordings/{name}.bag", steady("/scan", 20, 10_000_000))
    planned = plan(make_spec(), Storage(volumes)).cases
    context = RunContext("lab/drive", make_spec(), volumes, "pvc://results/r", str(tmp_path / "s"))
    progress = Progress("pvc://results/r")
    progress.begin(6, [])
    with FakeAgent(make_slot(tmp_path / "s"), *[well_behaved()] * 6):
        rows = simulate(spark, planned, context, progress)
    assert sorted(each["case"] for each in rows) == [f"{name}-0000" for name in "abcdef"]
    assert {each["outcome"] for each in rows} == {"passed"}
    assert progress.finish()
    assert progress.snapshot()["cases"]["passed"] == 6
