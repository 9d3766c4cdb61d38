"""How a driver ends whose cases were not all run: what is kept, and what it says of it."""

import json
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from py4j.protocol import Py4JError, Py4JNetworkError

from bagpipe.driver import job as driver
from bagpipe.driver.cases_on_spark import active_tasks, run_cases
from bagpipe.driver.journal import Journal
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import Results
from bagpipe.plan.case import Case
from bagpipe.plan.fragments import Window
from bagpipe.plan.made import Plan
from bagpipe.run.case_run import Row, RunContext
from bagpipe.spec import JobFile
from bagpipe.storage import Storage
from tests.unit.bagpipe.jobs import make_job, make_row
from tests.unit.bagpipe.places import By, nothing

CASES = [
    Case(name, "pvc://recordings/a.bag", "9-1", Window(10, 20, 30), [], [(0, 9)], 1)
    for name in ("a", "b")
]


class FakeSpark:
    """Hands over the row of the first case; then its call ends with an error."""

    def __init__(self, error: Exception, alive: Callable[[], bool]) -> None:
        self._error = error
        self._rows = SimpleNamespace(value=[])
        self._jsc = SimpleNamespace(sc=lambda: SimpleNamespace(isStopped=lambda: not alive()))

    def accumulator(self, *_arguments: object) -> SimpleNamespace:
        return self._rows

    def broadcast(self, value: object) -> SimpleNamespace:
        return SimpleNamespace(value=value, destroy=lambda: None)

    def parallelize(self, *_arguments: object) -> "FakeSpark":
        return self

    def foreachPartition(self, _run: object) -> None:  # noqa: N802  Spark's name
        self._rows.value.append(make_row("a"))
        raise self._error

    def statusTracker(self) -> object:  # noqa: N802  Spark's name
        raise self._error

    def cancelAllJobs(self) -> None:  # noqa: N802  Spark's name
        raise self._error


class Place(driver.Place):
    """Two cases over such a Spark."""

    def __init__(self, spark: FakeSpark) -> None:
        self._spark: Any = spark

    def planned(self, job: JobFile, storage: Storage) -> Plan:  # noqa: ARG002  the base class's signature
        return Plan(CASES, [])

    def run_cases(self, job: JobFile, cases: list[Case], keeper: Keeper) -> None:
        context = RunContext("lab/drive", job.spec, job.volumes, "pvc://results/r")
        run_cases(self._spark, cases, context, keeper)


def refused() -> bool:
    raise ConnectionRefusedError(111, "Connection refused")


def unanswered() -> bool:
    raise Py4JNetworkError("Answer from Java side is empty")


def ended(tmp_path: Path, place: Place) -> tuple[Progress, list[Row], int | bool]:
    """A job's progress, its journal, and the driver's status or whether it is Complete."""
    job = make_job({"results": str(tmp_path)})
    results = Results(job, Storage(job.volumes))
    progress = Progress(results.folder)
    status: int | bool
    try:
        status = driver.ended(progress, lambda: driver.run(job, progress, place=place))
    except SystemExit as exit_:
        assert isinstance(exit_.code, int)
        status = exit_.code
    assert not results.is_committed()
    return progress, list(Journal(results.storage, results.folder, 1).rows()), status


@pytest.mark.parametrize("alive", [refused, unanswered, lambda: False])
@pytest.mark.parametrize(
    "error",
    [
        Py4JNetworkError("Answer from Java side is empty"),
        Py4JError("An error occurred while calling o42.collectAndServe"),
        ConnectionRefusedError(111, "Connection refused"),
    ],
)
def test_a_driver_whose_jvm_is_gone_journals_its_rows_and_is_no_end_of_the_job(
    tmp_path: Path, error: Exception, alive: Callable[[], bool]
) -> None:
    progress, rows, status = ended(tmp_path, Place(FakeSpark(error, alive)))
    assert [row["case"] for row in rows] == ["a"]
    # Neither 0 nor 1, which are the ends of a job.
    assert status == 75
    snapshot = json.loads(progress.termination_message())
    assert (snapshot["phase"], snapshot["reason"]) == ("Running", "SparkGone")
    assert (snapshot["cases"]["passed"], snapshot["cases"]["running"]) == (1, 0)
    assert "Java process" in snapshot["message"]


def test_an_error_of_a_spark_that_lives_ends_the_job_and_its_rows_are_journaled(
    tmp_path: Path,
) -> None:
    spark = FakeSpark(Py4JError("Job aborted due to stage failure"), lambda: True)
    progress, rows, complete = ended(tmp_path, Place(spark))
    assert [row["case"] for row in rows] == ["a"]
    snapshot = progress.snapshot()
    assert (complete, snapshot["phase"], snapshot["reason"]) == (False, "Failed", "DriverFailed")
    assert snapshot["message"] == "Py4JError: Job aborted due to stage failure"


def test_a_jvm_that_goes_after_sigterm_is_no_trouble(tmp_path: Path) -> None:
    class Interrupted(FakeSpark):
        def parallelize(self, *_arguments: object) -> "FakeSpark":
            keepers[0].interrupt()
            return self

    class InterruptedPlace(Place):
        def run_cases(self, job: JobFile, cases: list[Case], keeper: Keeper) -> None:
            keepers.append(keeper)
            super().run_cases(job, cases, keeper)

    keepers: list[Keeper] = []
    spark = Interrupted(ConnectionRefusedError(111, "Connection refused"), refused)
    progress, rows, status = ended(tmp_path, InterruptedPlace(spark))
    assert [row["case"] for row in rows] == ["a"]
    assert (status, progress.snapshot()["reason"]) == (143, "Interrupted")


def test_a_keeper_that_fails_ends_the_job_with_its_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Cancelled(FakeSpark):
        def foreachPartition(self, run: object) -> None:  # noqa: N802  Spark's name
            assert cancelled.wait(60)
            super().foreachPartition(run)

        def cancelAllJobs(self) -> None:  # noqa: N802  Spark's name
            cancelled.set()

    def fails(_keeper: Keeper) -> None:
        raise KeyError("a fault of ours")

    cancelled = threading.Event()
    monkeypatch.setattr(Keeper, "look", fails)
    spark = Cancelled(Py4JError("Job 0 cancelled"), lambda: True)
    progress, rows, complete = ended(tmp_path, Place(spark))
    assert [row["case"] for row in rows] == ["a"]
    snapshot = progress.snapshot()
    assert (complete, snapshot["reason"]) == (False, "DriverFailed")
    assert snapshot["message"] == "KeyError: 'a fault of ours'"


def test_an_unknown_number_of_running_cases_is_no_trouble() -> None:
    spark: Any = FakeSpark(Py4JError("busy"), lambda: True)
    assert active_tasks(spark) == 0


def test_an_interruption_whose_exception_was_lost_runs_no_case(tmp_path: Path) -> None:
    """SIGTERM came in a callback of an import, which takes for itself what a handler raises."""
    interruption = driver.Interruption()
    with pytest.raises(SystemExit):
        interruption(signal.SIGTERM, None)

    class Planned(By):
        def planned(self, job: JobFile, storage: Storage) -> Plan:  # noqa: ARG002
            return Plan(CASES, [])

    job = make_job({"results": str(tmp_path)})
    with pytest.raises(SystemExit) as ended:
        driver.run(job, Progress("r"), Planned(nothing), interruption)
    assert ended.value.code == 143
