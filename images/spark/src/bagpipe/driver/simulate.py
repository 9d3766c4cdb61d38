"""Cases over Spark: only descriptors and rows pass through the JVM, payload never does."""

import threading
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from pyspark import SparkContext
from pyspark.accumulators import AccumulatorParam

from bagpipe.driver.progress import Progress
from bagpipe.plan.cases import Case
from bagpipe.run.case_run import Row, RunContext, run_case

_TELL_SECONDS = 0.5


class _RowsParam(AccumulatorParam[list[Row]]):
    """Rows of finished tasks. Spark adds a task's rows once, when the task has succeeded."""

    def zero(self, value: list[Row]) -> list[Row]:  # noqa: ARG002  the base class's signature
        return []

    def addInPlace(self, value1: list[Row], value2: list[Row]) -> list[Row]:  # noqa: N802
        value1.extend(value2)
        return value1


def simulate(
    spark: SparkContext, cases: list[Case], context: RunContext, progress: Progress
) -> list[Row]:
    """Run all cases, one task each, and give their rows; progress is told as tasks end."""
    finished = spark.accumulator([], _RowsParam())
    shared_context = spark.broadcast(context)

    def run(partition: Iterable[Case]) -> Iterator[Row]:
        for case in partition:
            row = run_case(case, shared_context.value)
            finished.add([row])
            yield row

    teller = _Teller(progress, lambda: finished.value, lambda: _active_tasks(spark))
    with teller:
        rows: list[Row] = spark.parallelize(cases, len(cases)).mapPartitions(run).collect()
    return rows


def _active_tasks(spark: SparkContext) -> int:
    tracker = spark.statusTracker()
    stages = [tracker.getStageInfo(stage) for stage in tracker.getActiveStageIds()]
    return sum(stage.numActiveTasks for stage in stages if stage is not None)


class _Teller:
    """Moves new rows into the progress while Spark works, and the last ones when it has ended."""

    def __init__(
        self, progress: Progress, rows: Callable[[], list[Row]], running: Callable[[], int]
    ) -> None:
        self._progress = progress
        self._rows = rows
        self._running = running
        self._told = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._tell_until_ended, name="teller", daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_error: Any) -> None:
        self._ended.set()
        self._thread.join()
        self._tell_new_rows()

    def _tell_until_ended(self) -> None:
        while not self._ended.wait(_TELL_SECONDS):
            self._tell_new_rows()
            self._progress.set_running(self._running())

    def _tell_new_rows(self) -> None:
        rows = self._rows()
        for row in rows[self._told :]:
            self._progress.add(row)
        self._told = len(rows)
