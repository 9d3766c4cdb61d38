"""The driver over a real local Spark: rows once each, a successor, a poisonous case, a stop."""

import dataclasses
import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pyspark import SparkConf, SparkContext

from bagpipe.driver import cases_on_spark
from bagpipe.driver import job as driver
from bagpipe.driver.cases_on_spark import run_cases
from bagpipe.driver.journal import Journal
from bagpipe.driver.keep import Keeper
from bagpipe.driver.lost_starts import Task
from bagpipe.driver.metrics import DriverMetrics
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import Results
from bagpipe.driver.row_file import RowFile
from bagpipe.driver.spark_context import QUICK_JVM
from bagpipe.plan.case import Case
from bagpipe.run.case_run import Row, RunContext
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.fake_agent import FakeAgent, make_slot, well_behaved
from tests.unit.bagpipe.jobs import make_job, make_row, make_spec
from tests.unit.bagpipe.places import By, nothing
from tests.waiting import PATIENCE

COMPLETED = "spark_executor_completed_tasks_total"


@pytest.fixture(scope="module")
def spark() -> Iterator[SparkContext]:
    # Spark's Python workers are to be the Python that runs the tests, whatever PATH says.
    os.environ["PYSPARK_PYTHON"] = sys.executable
    conf = SparkConf().setMaster("local[2, 9]").set("spark.ui.enabled", "false")
    conf.set("spark.driver.extraJavaOptions", QUICK_JVM)
    conf.set("spark.driver.host", "127.0.0.1").set("spark.driver.bindAddress", "127.0.0.1")
    conf.set("spark.executor.heartbeatInterval", "500ms")
    conf.set("spark.ui.liveUpdate.period", "0")  # what it has counted can be read at once
    context = SparkContext(conf=conf)
    yield context
    context.stop()


class World:
    """Six bags, a results folder, and a slot for a fake agent."""

    def __init__(self, tmp_path: Path) -> None:
        self.volumes = {name: str(tmp_path / name) for name in ("recordings", "results")}
        (tmp_path / "recordings").mkdir()
        (tmp_path / "results").mkdir()
        for name in "abcdef":
            write_bag(tmp_path / f"recordings/{name}.bag", steady("/scan", 20, 10_000_000))
        self.job = make_job(self.volumes)
        self.storage = Storage(self.volumes)
        self.results = Results(self.job, self.storage)
        self.cases = plan(make_spec(), self.storage).cases
        self.slot = make_slot(tmp_path / "s")
        self.context = RunContext(
            "lab/drive", make_spec(), self.volumes, self.results.folder, str(tmp_path / "s")
        )
        self.rows = RowFile(tmp_path / "rows")
        self.journal = Journal(self.storage, self.results.folder, 1)

    def keeper(self, max_failed: int | None = None) -> Keeper:
        progress = Progress(self.results.folder)
        progress.begin(len(self.cases))
        return Keeper(progress, self.rows, self.journal, max_failed)


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


def test_sparks_executors_are_reported_by_its_own_figures(
    spark: SparkContext, world: World
) -> None:
    metrics = DriverMetrics(Progress(world.results.folder), world.job)
    keeper = dataclasses.replace(world.keeper(), counted=metrics.count)
    value = metrics.registry.get_sample_value

    def completed() -> float:
        spark._jsc.sc().listenerBus().waitUntilEmpty(int(PATIENCE * 1000))
        return value(COMPLETED, {"executor": "driver"}) or 0

    before = completed()
    with FakeAgent(world.slot, *[well_behaved()] * 6):
        run_cases(spark, world.cases, world.context, keeper)
    assert completed() - before == 6
    assert (value("spark_executor_storage_memory_max_bytes", {"executor": "driver"}) or 0) > 1e6
    assert value("spark_executor_tasks_max", {"executor": "driver"}) == 2
    heap = "spark_executor_jvm_heap_peak_bytes"
    deadline = time.monotonic() + 60  # it comes with Spark's heartbeat
    while value(heap, {"executor": "driver"}) is None and time.monotonic() < deadline:
        threading.Event().wait(0.05)
    assert (value(heap, {"executor": "driver"}) or 0) > 1e7
    # All of local Spark is its driver; a job of the default wants one executor.
    assert value("bagpipe_executors", {"state": "registered"}) == 0
    assert value("bagpipe_executors", {"state": "wanted"}) == world.job.spec.spark.executors
    assert value("bagpipe_cases_ended_total", {"outcome": "passed"}) == 6
    read = sum(case.bytes for case in world.cases)
    counted = value("bagpipe_fragment_read_bytes_total")
    assert counted is not None
    assert 0 <= counted - read <= 6 * 100  # the head of each stream is no byte of the bag


def test_cases_over_spark_come_back_once_each(spark: SparkContext, world: World) -> None:
    keeper = world.keeper()
    with FakeAgent(world.slot, *[well_behaved()] * 6):
        run_cases(spark, world.cases, world.context, keeper)
    rows = list(world.rows.rows())
    assert [each["case"] for each in rows] == [f"{name}-0000" for name in "abcdef"]
    assert {each["outcome"] for each in rows} == {"passed"}
    assert keeper.progress.finish()
    assert keeper.progress.snapshot()["cases"]["passed"] == 6


def test_what_a_worker_loaded_is_no_garbage_to_look_for_after_each_case(
    spark: SparkContext, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    def counts(case: Case, _context: RunContext, _starts: int) -> Row:
        return make_row(case.id) | {"attempts": len(gc.get_objects())}

    monkeypatch.setattr(cases_on_spark, "run_case", counts)
    run_cases(spark, world.cases, world.context, world.keeper())
    # More than 200,000 objects of modules are there, unless they are frozen.
    assert max(row["attempts"] for row in world.rows.rows()) < 20_000


def test_every_round_is_run_counted_and_recorded_as_a_case_of_its_own(
    spark: SparkContext, world: World
) -> None:
    spec = make_spec(playback={"rounds": 3})
    planned = plan(spec, world.storage).cases[:3]
    context = dataclasses.replace(world.context, spec=spec)
    keeper = world.keeper()
    with FakeAgent(world.slot, *[well_behaved()] * 3):
        run_cases(spark, planned, context, keeper)
    rows = list(world.rows.rows())
    assert [each["case"] for each in rows] == ["a-0000-r0", "a-0000-r1", "a-0000-r2"]
    assert len({each["recorded"] for each in rows}) == 3
    assert keeper.progress.snapshot()["cases"]["passed"] == 3


def test_a_job_is_stopped_before_its_other_cases_run(
    spark: SparkContext, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(case: Case, _context: RunContext, _starts: int) -> Row:
        # Long, and only of a job that is not stopped: how soon it is depends on the machine.
        if case.id != "case-0":
            threading.Event().wait(PATIENCE)
        return {"case": case.id, "outcome": "errored", "reason": "X", "message": "", "attempts": 1,
                "recorded": None, "result": None}  # fmt: skip

    monkeypatch.setattr(cases_on_spark, "run_case", fails)
    keeper = world.keeper(max_failed=0)
    many = [dataclasses.replace(world.cases[0], id=f"case-{n}") for n in range(6)]
    run_cases(spark, many, world.context, keeper)
    assert keeper.stop is not None
    assert keeper.stop.reason == "TooManyFailedCases"
    assert 1 <= len(world.rows) < len(many)


def test_an_interruption_journals_and_leaves_the_rest_to_a_successor(
    spark: SparkContext, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SIGTERM in the middle: status 143, no manifest, an account that is no end of the job."""

    def passes(case: Case, _context: RunContext, _starts: int) -> Row:
        # As in the test above.
        if case.id != "case-0":
            threading.Event().wait(PATIENCE)
        return make_row(case.id)

    def shares(cases: list[Case], keeper: Keeper) -> None:
        def interrupt() -> None:
            deadline = time.monotonic() + PATIENCE
            while not keeper.progress.snapshot()["cases"]["passed"] and time.monotonic() < deadline:
                threading.Event().wait(0.05)
            os.kill(os.getpid(), signal.SIGTERM)

        many = [dataclasses.replace(cases[0], id=f"case-{n}") for n in range(6)]
        threading.Thread(target=interrupt, daemon=True).start()
        run_cases(spark, many, world.context, keeper)

    monkeypatch.setattr(cases_on_spark, "run_case", passes)
    interruption, progress = driver.Interruption(), Progress(world.results.folder)
    before = signal.signal(signal.SIGTERM, interruption)
    try:
        with pytest.raises(SystemExit) as ended:
            driver.run(world.job, progress, By(shares), interruption)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert ended.value.code == 143
    rows = list(world.journal.rows())
    assert 1 <= len(rows) < 6
    assert len(rows) == progress.snapshot()["cases"]["passed"]
    assert not world.results.is_committed()
    progress.interrupt()
    assert (progress.phase, progress.snapshot()["cases"]["running"]) == ("Running", 0)


def test_an_interruption_before_there_are_rows_ends_at_once() -> None:
    with pytest.raises(SystemExit) as ended:
        driver.Interruption()(signal.SIGTERM, None)
    assert ended.value.code == 143


def test_a_case_that_takes_its_executors_with_it_is_quarantined(
    spark: SparkContext, world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Ends the Python worker as the kernel's OOM killer would: Spark sees no exception and no row.
    marks = tmp_path / "marks"
    marks.mkdir()

    def dies(case: Case, _context: RunContext, _starts: int) -> None:
        (marks / f"{case.id}.{len(list(marks.iterdir()))}").touch()
        os._exit(137)

    monkeypatch.setattr(cases_on_spark, "run_case", dies)
    keeper = world.keeper()
    run_cases(spark, world.cases[:1], world.context, keeper)
    (row,) = world.rows.rows()
    assert (row["outcome"], row["reason"]) == ("errored", "ExecutorLost")
    # It was started as often as the row says, and no start of it ended.
    assert (row["starts"], row["attempts"], row["discarded"]) == (4, 0, [])
    assert len(list(marks.iterdir())) == 4
    assert row["message"].startswith(
        "this case was started 4 times and no executor brought it to an end, at least 3 of them"
    )
    assert keeper.progress.snapshot()["cases"]["discarded"] == 3
    assert "task" not in row
    lost = row["evidence"]["starts"]
    assert len(lost) >= 3
    # All of local Spark is its driver.
    assert {start["executor"] for start in lost} == {"driver"}
    assert all(start["error"] for start in lost)


def test_a_row_says_how_often_its_case_was_started_before_it_ended(
    spark: SparkContext, world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    marks = tmp_path / "marks"
    marks.mkdir()

    def dies_twice(case: Case, _context: RunContext, starts: int) -> Row:
        (marks / str(starts)).touch()
        if starts < 3:
            os._exit(137)
        discarded = [{"reason": "MachineBusy", "message": "busy", "seconds": 1.0}]
        return make_row(case.id, attempts=2, discarded=discarded, starts=starts)

    monkeypatch.setattr(cases_on_spark, "run_case", dies_twice)
    keeper = world.keeper()
    run_cases(spark, world.cases[:1], world.context, keeper)
    (row,) = world.rows.rows()
    assert (row["starts"], row["attempts"]) == (3, 2)
    assert [run["reason"] for run in row["discarded"]] == ["MachineBusy"]
    assert sorted(path.name for path in marks.iterdir()) == ["1", "2", "3"]
    # Two starts that were lost and one try that was lossy do not count.
    assert keeper.progress.snapshot()["cases"]["discarded"] == 3


def test_a_case_whose_executors_were_taken_away_runs_again_and_counts_once(
    spark: SparkContext, world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    marks = tmp_path / "marks"
    marks.mkdir()

    def taken_away(_spark: SparkContext, _stage: int) -> list[Task]:
        # As Spark words it of Kubernetes' executors; local Spark has none that could go.
        error = "ExecutorLostFailure (executor 1 exited unrelated to the running tasks)"
        lost = {"index": 0, "executorId": "1", "host": "10.0.0.1", "errorMessage": error}
        return [lost | {"attempt": number} for number in range(4)]

    def passes_at_last(case: Case, _context: RunContext, starts: int) -> Row:
        (marks / f"{case.id}.{starts}").touch()
        if case.id == "a-0000" and starts < 6:
            os._exit(137)
        return make_row(case.id, starts=starts)

    monkeypatch.setattr(cases_on_spark, "failed_tasks", taken_away)
    monkeypatch.setattr(cases_on_spark, "run_case", passes_at_last)
    keeper = world.keeper()
    run_cases(spark, world.cases[:2], world.context, keeper)
    rows = {row["case"]: row for row in world.rows.rows()}
    assert {name: (row["outcome"], row["attempts"]) for name, row in rows.items()} == {
        "a-0000": ("passed", 1), "b-0000": ("passed", 1),
    }  # fmt: skip
    assert (rows["a-0000"]["starts"], rows["b-0000"]["starts"]) == (6, 1)
    assert sorted(path.name for path in marks.glob("a-*")) == [f"a-0000.{n}" for n in range(1, 7)]
    assert keeper.progress.snapshot()["cases"]["passed"] == 2
    assert keeper.progress.snapshot()["cases"]["errored"] == 0


def test_a_driver_after_a_commit_runs_nothing(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    for case in world.cases:
        world.rows.add(make_row(case.id))
    keeper = world.keeper()
    for row in world.rows.rows():
        keeper.progress.add(row)
    world.journal.append(list(world.rows.rows()))
    world.results.commit(world.rows, keeper.progress, "the first driver")
    monkeypatch.setattr(driver, "plan", None)
    progress = Progress(world.results.folder)
    assert driver.run(world.job, progress, By(nothing))
    snapshot = progress.snapshot()
    assert (snapshot["phase"], snapshot["verdict"], snapshot["cases"]["passed"]) == (
        "Complete",
        "Passed",
        6,
    )
    assert world.results.is_published(world.journal)
    assert world.storage.names(f"{world.results.folder}/journal") == []


def test_a_successor_runs_only_what_is_left(spark: SparkContext, world: World) -> None:
    def shares(cases: list[Case], keeper: Keeper) -> None:
        ran.append([case.id for case in cases])
        run_cases(spark, cases, world.context, keeper)

    ran: list[list[str]] = []
    done = world.cases[:4]
    world.journal.append(
        [
            make_row(
                case.id,
                fragment=case.fragment,
                bag=case.bag,
                bag_version=case.bag_version,
                window=[case.window.lead_in_start, case.window.start, case.window.end],
            )
            for case in done
        ]
    )
    progress = Progress(world.results.folder)
    with FakeAgent(world.slot, *[well_behaved()] * 2):
        assert driver.run(world.job, progress, By(shares))
    assert ran == [sorted(case.id for case in world.cases[4:])]
    assert progress.snapshot()["cases"]["passed"] == 6
    manifest = world.results.committed()
    assert manifest is not None
    assert [entry["case"] for entry in manifest["cases"]] == sorted(c.id for c in world.cases)
