"""Two jobs in one driver, over one real Spark: what isolates them, and when the driver may stay."""

import dataclasses
import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pyspark import SparkConf, SparkContext

from bagpipe.driver import cases_on_spark
from bagpipe.driver import job as driver
from bagpipe.driver.cases_on_spark import active_tasks, run_cases
from bagpipe.driver.in_turn import work_in_turn
from bagpipe.driver.keep import Keeper
from bagpipe.driver.kept_spark import KeptSpark, alike
from bagpipe.driver.metrics import DriverMetrics
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import Results
from bagpipe.driver.seat import Claimed, Seat
from bagpipe.driver.spark_context import QUICK_JVM, DriverPod, spark_settings
from bagpipe.driver.spark_gone import SparkGoneError
from bagpipe.plan.case import Case
from bagpipe.run.case_run import Row, RunContext
from bagpipe.spec import JobFile
from tests.unit.bagpipe.jobs import make_job, make_row, make_spec
from tests.unit.bagpipe.offers import offer_of
from tests.unit.bagpipe.places import By
from tests.unit.bagpipe.test_driver_over_spark import World
from tests.waiting import PATIENCE, wait_until

SETTINGS = {
    "spark.master": "local[2, 9]",
    "spark.app.name": "lab/first",
    "spark.ui.enabled": "false",
    "spark.ui.liveUpdate.period": "0",
    "spark.driver.extraJavaOptions": QUICK_JVM,
    "spark.driver.host": "127.0.0.1",
    "spark.driver.bindAddress": "127.0.0.1",
}


def start(settings: Any) -> SparkContext:
    os.environ["PYSPARK_PYTHON"] = sys.executable
    return SparkContext(conf=SparkConf().setAll(list(settings.items())))


@pytest.fixture(scope="module")
def kept() -> Iterator[KeptSpark]:
    spark = KeptSpark(start)
    yield spark
    spark.end()


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


def passes(case: Case, context: RunContext, _starts: int) -> Row:
    # The command is what a job's own description has come with.
    return make_row(case.id, message=" ".join(context.spec.stack.command))


class SeatOfTurns(Seat):
    """Before it is looked who sits there, the next one comes."""

    def __init__(self, come: Callable[[], None], claims: dict[str, Claimed]) -> None:
        self.now = 0.0
        super().__init__("pod-uid", "lab", 300.0, claims.get, lambda: self.now)
        self._come = come

    def taken(self) -> JobFile | None:
        self._come()
        return super().taken()


class Turns:
    """A driver that stays: jobs sit down by their claims, and each is worked on by `driver.run`."""

    def __init__(self, world: World, kept: KeptSpark, *jobs: JobFile) -> None:
        self.world, self.kept, self.jobs = world, kept, list(jobs)
        self.claims: dict[str, Claimed] = {}
        self.seat = SeatOfTurns(self.come, self.claims)
        self.interruption = driver.Interruption()
        self.answers: list[str] = []
        self.applications: list[str | None] = []
        self.accounts: dict[str, Progress] = {}
        self.metrics: dict[str, DriverMetrics] = {}
        self.keepers: list[Keeper] = []

    def come(self) -> None:
        """The next job is offered; where there is none, time passes."""
        if not self.jobs:
            self.seat.now += 1000.0
            return
        job = self.jobs.pop(0)
        self.claims[job.name] = Claimed(job.uid, job.attempt, "pod-uid", "digest")
        self.answers.append(self.seat.offer(offer_of(job)))

    def go(self) -> None:
        work_in_turn(self.seat, self.work, self.interruption)

    def work(self, job: JobFile) -> bool:
        progress = self.accounts[job.name] = Progress(Results(job, self.world.storage).folder)
        metrics = self.metrics[job.name] = DriverMetrics(progress, job)

        def run(cases: list[Case], keeper: Keeper) -> None:
            self.keepers.append(keeper)
            spark = self.kept.of(SETTINGS | {"spark.app.name": job.name})
            self.applications.append(spark.applicationId)
            context = dataclasses.replace(self.world.context, spec=job.spec)
            run_cases(spark, cases, context, keeper)

        complete = driver.run(job, progress, By(run), self.interruption, metrics.count)
        return complete and self.kept.settles(PATIENCE)


def job_called(world: World, name: str, command: str, **changed: Any) -> JobFile:
    spec = make_spec(stack={"image": "stack:1", "command": [command]}, **changed)
    return world.job.model_copy(update={"name": name, "uid": f"uid-{name}", "spec": spec})


def test_two_jobs_share_spark_and_neither_rows_counts_metrics_nor_description(
    kept: KeptSpark, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cases_on_spark, "run_case", passes)
    bags = {"bags": ["pvc://recordings/a.bag", "pvc://recordings/b.bag"], "topics": ["/scan"]}
    first = job_called(world, "first", "one")
    second = job_called(world, "second", "two", source=bags)
    turns = Turns(world, kept, first, second)
    turns.go()
    assert turns.answers == ["taken", "taken"]
    assert len(turns.applications) == 2
    assert len(set(turns.applications)) == 1  # one Spark, so the same executors
    # Neither's description is kept for the other's time.
    assert list(Path(str(kept.of(SETTINGS)._temp_dir)).iterdir()) == []
    for job, cases, command in ((first, "abcdef", "one"), (second, "ab", "two")):
        results = Results(job, world.storage)
        assert results.folder.endswith(f"/{job.name}/{job.uid}")
        manifest = results.committed()
        assert manifest is not None
        assert (manifest["phase"], len(manifest["cases"])) == ("Complete", len(cases))
        lines = (tmp_of(world, results) / "results.jsonl").read_text().splitlines()
        rows = [json.loads(line) for line in lines]
        assert sorted((row["case"], row["message"], row["attempts"]) for row in rows) == [
            (f"{case}-0000", command, 1) for case in cases
        ]
        snapshot = turns.accounts[job.name].snapshot()
        assert (snapshot["cases"]["passed"], snapshot["results"]) == (len(cases), results.folder)
        value = turns.metrics[job.name].registry.get_sample_value
        assert value("bagpipe_cases_ended_total", {"outcome": "passed"}) == len(cases)


def tmp_of(world: World, results: Results) -> Path:
    return Path(results.folder.replace("pvc://results", world.volumes["results"]))


def test_a_job_that_was_stopped_is_the_driver_s_last(
    kept: KeptSpark, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cases of it may still run, with the slots that another job's would wait for."""

    def fails(case: Case, _context: RunContext, _starts: int) -> Row:
        return make_row(case.id, "errored", "X", recorded=None, result=None)

    monkeypatch.setattr(cases_on_spark, "run_case", fails)
    first = job_called(world, "first", "one", maxFailedCases=0)
    second = job_called(world, "second", "two")
    turns = Turns(world, kept, first, second)
    turns.go()
    assert (turns.accounts["first"].phase, list(turns.accounts)) == ("Failed", ["first"])
    assert turns.answers == ["taken", "refused"]


def test_a_driver_whose_work_fails_takes_no_other_job(world: World, kept: KeptSpark) -> None:
    first, second = job_called(world, "first", "one"), job_called(world, "second", "two")
    turns = Turns(world, kept, first, second)

    def breaks(_job: JobFile) -> bool:
        raise SparkGoneError

    with pytest.raises(SparkGoneError):
        work_in_turn(turns.seat, breaks, turns.interruption)
    turns.come()
    assert turns.answers == ["taken", "refused"]


def test_a_driver_that_waits_ends_at_sigterm_and_not_the_keeper_of_an_ended_job(
    kept: KeptSpark, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cases_on_spark, "run_case", passes)
    turns = Turns(world, kept, job_called(world, "first", "one"))
    come = turns.seat._come

    def come_or_end() -> None:
        if turns.accounts:
            turns.interruption(signal.SIGTERM, None)
        come()

    turns.seat._come = come_or_end
    turns.go()
    assert not turns.keepers[0].interrupted
    turns.jobs = [job_called(world, "second", "two")]
    come()
    assert turns.answers == ["taken", "refused"]


def test_sigterm_while_a_job_is_being_ended_makes_it_the_last(
    kept: KeptSpark, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While it commits there is nothing to interrupt, and the kubelet does not say it twice."""
    monkeypatch.setattr(cases_on_spark, "run_case", passes)
    turns = Turns(world, kept, job_called(world, "first", "one"), job_called(world, "second", "b"))
    left: list[str] = []

    def works(job: JobFile) -> bool:
        stays = turns.work(job)
        turns.interruption(signal.SIGTERM, None)
        return stays

    work_in_turn(turns.seat, works, turns.interruption, lambda: left.append("left"))
    assert (turns.accounts["first"].phase, list(turns.accounts), left) == (
        "Complete",
        ["first"],
        [],
    )
    turns.come()
    assert turns.answers == ["taken", "refused"]


def test_sigterm_once_the_next_job_has_sat_down_begins_it_not(
    kept: KeptSpark, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cases_on_spark, "run_case", passes)
    turns = Turns(world, kept, job_called(world, "first", "one"), job_called(world, "second", "b"))
    come = turns.seat._come

    def come_and_end() -> None:
        come()
        if turns.accounts:
            turns.interruption(signal.SIGTERM, None)

    turns.seat._come = come_and_end
    with pytest.raises(SystemExit) as ended:
        turns.go()
    assert (ended.value.code, list(turns.accounts)) == (143, ["first"])


def test_a_driver_stays_only_once_nothing_runs(kept: KeptSpark, tmp_path: Path) -> None:
    """Spark knows of tasks that no job of it waits for any more."""
    assert KeptSpark(start).settles(0)  # nothing has been started
    spark, mark = kept.of(SETTINGS), tmp_path / "go"

    def waits(_numbers: Any) -> None:
        while not mark.exists():
            threading.Event().wait(0.01)

    running = threading.Thread(
        daemon=True, target=lambda: spark.parallelize([1], 1).foreachPartition(waits)
    )
    running.start()
    wait_until(lambda: active_tasks(spark) == 1, PATIENCE, "a task that runs")
    assert not kept.settles(0.2)
    mark.touch()
    assert kept.settles(PATIENCE)
    running.join(PATIENCE)


def test_a_spark_with_other_settings_or_that_has_ended_does_for_no_job(kept: KeptSpark) -> None:
    first = kept.of(SETTINGS).applicationId
    assert kept.of(SETTINGS | {"spark.app.name": "lab/second"}).applicationId == first
    with pytest.raises(SparkGoneError):
        kept.of(SETTINGS | {"spark.speculation": "true"})
    assert kept.of(SETTINGS).applicationId == first
    kept.of(SETTINGS).stop()
    with pytest.raises(SparkGoneError):
        kept.of(SETTINGS)


def settings(cases: int = 10, **spark: Any) -> dict[str, str]:
    job = make_job({}, spark=spark)
    return spark_settings(job, DriverPod("p", "lab", "10.0.0.1"), cases)


@pytest.mark.parametrize(
    ("others", "same"),
    [
        (settings(cases=3_000), True),
        (settings(cases=3_001), False),  # these earn Java's second compiler
        (settings(slots=2), False),
        (settings(executors=2), False),
        (settings() | {"spark.app.name": "x", "spark.kubernetes.executor.podNamePrefix": "x-1"},
         True),
        ({k: v for k, v in settings().items() if k != "spark.speculation"}, False),
    ],
)  # fmt: skip
def test_which_settings_do_for_a_further_job(others: dict[str, str], same: bool) -> None:
    assert alike(settings(), others) is same
    assert alike(others, settings()) is same


def test_an_elastic_job_s_first_width_is_its_own() -> None:
    elastic = {"executors": {"min": 1, "max": 4}}
    few, many = settings(cases=1, **elastic), settings(cases=100, **elastic)
    assert few != many
    assert alike(few, many)


def test_a_spark_that_stays_is_started_alike_for_few_cases_and_many_and_forgets_them() -> None:
    job, pod = make_job({}), DriverPod("p", "lab", "10.0.0.1")
    few, many = (spark_settings(job, pod, cases, stays=True) for cases in (10, 100_000))
    assert alike(few, many)
    assert (few["spark.ui.retainedJobs"], few["spark.ui.retainedStages"]) == ("2", "2")
    assert not settings().keys() & {"spark.ui.retainedJobs", "spark.ui.retainedStages"}
