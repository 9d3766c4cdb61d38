"""Cases over Spark: only descriptors and rows pass through the JVM, payload never does."""

import gc
import logging
from collections.abc import Iterable
from functools import cache

from py4j.protocol import Py4JError
from pyspark import SparkContext, TaskContext
from pyspark.accumulators import AccumulatorParam

from bagpipe.driver.keep import Keeper, Keeping
from bagpipe.plan.cases import Case
from bagpipe.run.attempts import quarantine_attempt
from bagpipe.run.case_run import Row, RunContext, lost_row, run_case

log = logging.getLogger(__name__)


class _RowsParam(AccumulatorParam[list[Row]]):
    """Rows of finished tasks. Spark adds a task's rows once, when the task has succeeded."""

    def zero(self, value: list[Row]) -> list[Row]:  # noqa: ARG002  the base class's signature
        return []

    def addInPlace(self, value1: list[Row], value2: list[Row]) -> list[Row]:  # noqa: N802
        value1.extend(value2)
        return value1


@cache
def settle_worker() -> None:
    """Take what this worker loaded out of garbage collection, once in its life.

    Spark's daemon collects all garbage after each task (pyspark/daemon.py); to walk through the
    modules that a case needs takes 20 ms of a processor each time.
    """
    gc.collect()
    gc.freeze()


def simulate(spark: SparkContext, cases: list[Case], context: RunContext, keeper: Keeper) -> None:
    """Run all cases, one task each; their rows go to the keeper, which may end the work early.

    Spark merges the rows of every successful task before it calls the job done, each task's once
    whatever was retried or speculated, so nothing has to be collected a second time.
    """
    finished = spark.accumulator([], _RowsParam())
    shared_context = spark.broadcast(context)
    # Spark itself gives up later (spark.task.maxFailures).
    quarantine = quarantine_attempt(context.spec.stack_backoff_limit)

    def run(partition: Iterable[Case]) -> None:
        settle_worker()
        task = TaskContext.get()
        # Spark counts a task's launches from 0, copies of slow ones too.
        before = task.attemptNumber() if task else 0
        for case in partition:
            if before >= quarantine:
                finished.add([lost_row(case, before)])
            else:
                finished.add([run_case(case, shared_context.value, before + 1)])

    def new_rows() -> list[Row]:
        # Spark's thread only appends, so the first rows are ours to take.
        rows = finished.value
        taken = rows[: len(rows)]
        del rows[: len(taken)]
        return taken

    keeping = Keeping(keeper, new_rows, lambda: _active_tasks(spark), spark.cancelAllJobs)
    try:
        with keeping:
            spark.parallelize(cases, len(cases)).foreachPartition(run)
    except Py4JError:
        if keeper.stop is None:
            raise
        log.info("stopped: %s", keeper.stop.message)


def _active_tasks(spark: SparkContext) -> int:
    tracker = spark.statusTracker()
    stages = [tracker.getStageInfo(stage) for stage in tracker.getActiveStageIds()]
    return sum(stage.numActiveTasks for stage in stages if stage is not None)
