"""Cases over Spark: only descriptors and rows pass through the JVM, payload never does."""

import gc
import logging
from collections.abc import Iterable
from functools import cache

from py4j.protocol import Py4JError
from pyspark import Broadcast, SparkContext, TaskContext
from pyspark.accumulators import AccumulatorParam

from bagpipe.driver.given_back import GivenBack, Tried
from bagpipe.driver.keep import Keeper, Keeping
from bagpipe.driver.lost_starts import failed_tasks, given_up, with_evidence
from bagpipe.driver.spark_gone import SparkGoneError
from bagpipe.plan.case import Case
from bagpipe.run.case_run import Row, RunContext, lost_row, run_case
from bagpipe.run.ran_on import ran_on

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


def run_cases(spark: SparkContext, cases: list[Case], context: RunContext, keeper: Keeper) -> None:
    """Run all cases, one task each; their rows go to the keeper, which may end the work early.

    Raises SparkGoneError where nothing of the job is at fault, so that another driver may go on.
    """
    try:
        _run_all(spark, cases, context, keeper)
    except Exception as error:
        gone = is_gone(spark)
        if keeper.stop is not None and (gone or isinstance(error, Py4JError)):
            log.info("stopped: %s", keeper.stop.message)
            return
        if gone:
            raise SparkGoneError from error
        raise


def is_gone(spark: SparkContext) -> bool:
    """Whether Spark can run no further case.

    The error that its end raises doesn't show it: a call that is cut off is a plain Py4JError,
    and a later one is refused the connection.
    """
    try:
        # pyspark offers no public way to its JVM.
        return bool(spark._jsc.sc().isStopped())  # noqa: SLF001
    except (Py4JError, OSError, AttributeError) as error:
        log.info("Spark does not answer: %s", error)
        return True


def _run_all(spark: SparkContext, cases: list[Case], context: RunContext, keeper: Keeper) -> None:
    """Run all cases over Spark, and again those whose executors were only taken away."""
    shared_context, given_back = spark.broadcast(context), GivenBack()
    _run_round(spark, cases, shared_context, keeper, given_back)
    while given_back.again and keeper.stop is None:
        again = [case for case in cases if case.id in given_back.again]
        given_back.again.clear()
        log.info("%d cases run again: their executors were taken away", len(again))
        _run_round(spark, again, shared_context, keeper, given_back)
    _forget(shared_context)


def _forget(shared_context: Broadcast[RunContext]) -> None:
    """Where Spark stays, the job's description does not."""
    try:
        shared_context.destroy()
    except (Py4JError, OSError) as error:
        # All rows are there: what is left behind is no reason to end the job.
        log.warning("Spark keeps what the cases shared: %s", error)


def _run_round(
    spark: SparkContext,
    cases: list[Case],
    shared_context: Broadcast[RunContext],
    keeper: Keeper,
    given_back: GivenBack,
) -> None:
    """Run cases, one task each.

    Spark merges the rows of every successful task before it calls the job done, each task's once
    whatever was retried or speculated, so nothing has to be collected a second time.
    """
    finished = spark.accumulator([], _RowsParam())
    tried = {case.id: given_back.tried[case.id] for case in cases if case.id in given_back.tried}

    def run(partition: Iterable[Case]) -> None:
        settle_worker()
        task = TaskContext.get()
        # Spark counts a task's launches from 0, copies of slow ones too.
        launches = task.attemptNumber() if task else 0
        for case in partition:
            before = tried.get(case.id, Tried())
            if task and before.is_enough(launches):
                lost = lost_row(case, before.starts + launches)
                finished.add([given_up(lost, task.stageId(), task.partitionId(), launches)])
            else:
                row = run_case(case, shared_context.value, before.starts + launches + 1)
                finished.add([row | {"ran_on": ran_on()}])

    def new_rows() -> list[Row]:
        # Spark's thread only appends, so the first rows are ours to take.
        rows = finished.value
        taken = rows[: len(rows)]
        del rows[: len(taken)]
        known = with_evidence(taken, lambda stage: failed_tasks(spark, stage))
        return given_back.sift(known)

    keeping = Keeping(keeper, new_rows, lambda: active_tasks(spark), spark.cancelAllJobs)
    with keeping:
        spark.parallelize(cases, len(cases)).foreachPartition(run)


def active_tasks(spark: SparkContext) -> int:
    """How many tasks run; 0 where Spark does not say, since a figure is not worth a job."""
    try:
        tracker = spark.statusTracker()
        stages = [tracker.getStageInfo(stage) for stage in tracker.getActiveStageIds()]
    except (Py4JError, OSError) as error:
        log.debug("Spark does not report what runs: %s", error)
        return 0
    return sum(stage.numActiveTasks for stage in stages if stage is not None)
