"""Why the starts of a case were lost, as Spark knows it: asked when the case is given up."""

import logging
import re
from collections.abc import Callable, Iterable
from typing import Any

from py4j.protocol import Py4JError, Py4JJavaError
from pyspark import SparkContext

from bagpipe.driver.spark_json import as_json, status_store
from bagpipe.run.case_run import Row

# Failed tasks of one stage that are looked at, the newest first, and how many at a time.
_MOST_TASKS = 20_000
_PAGE = 1000
_MOST_STARTS = 10
_MOST_CHARACTERS = 1000
_EVENTS_MILLISECONDS = 5_000

# Spark's words for an executor that was deleted, drained or scaled down. It takes what ended by
# itself for its tasks' fault. Nothing that a user wrote stands before them.
_TAKEN_AWAY = re.compile(
    r"ExecutorLostFailure \(executor \S+ exited unrelated to the running tasks\)"
)

Task = dict[str, Any]

log = logging.getLogger(__name__)


def given_up(row: Row, stage: int, index: int, launches: int) -> Row:
    """The row with the Spark task that made it, and how often that was launched before, which
    `with_evidence` takes for its question."""
    return row | {"task": [stage, index, launches]}


def with_evidence(rows: Iterable[Row], failed: Callable[[int], list[Task]]) -> list[Row]:
    """The rows; those that were given up have what became of their starts, and by `taken_away` how
    many of these ended with an executor that left for no fault of its cases, or did not fail at
    all: the launch that gives a case up may be the copy of one that runs.

    `failed` gives the failed tasks of a stage; where it knows none of a case's, each start counts
    against the case.
    """
    tasks: dict[int, list[Task]] = {}
    kept: list[Row] = []
    for row in rows:
        if "task" not in row:
            kept.append(row)
            continue
        stage, index, launches = row["task"]
        if stage not in tasks:
            tasks[stage] = sorted(failed(stage), key=lambda task: task["attempt"])
        starts = [_start(task) for task in tasks[stage] if task["index"] == index]
        rest = {key: value for key, value in row.items() if key != "task"}
        evidence = {"evidence": {"starts": starts[-_MOST_STARTS:]}}
        taken_away = sum(_TAKEN_AWAY.match(start["error"]) is not None for start in starts)
        taken_away += max(0, launches - len(starts)) if starts else 0
        kept.append(rest | evidence | {"taken_away": taken_away})
    return kept


def failed_tasks(spark: SparkContext, stage: int) -> list[Task]:
    """The newest failed tasks of a stage, of all its cases; none where Spark does not say.

    Where many executors go at once, those of one case lie far apart.
    """
    try:
        _await_what_spark_knows(spark)
        jvm: Any = spark._jvm  # noqa: SLF001  pyspark offers no public way to it
        failed = jvm.java.util.ArrayList()
        failed.add(jvm.org.apache.spark.status.api.v1.TaskStatus.FAILED)
        nothing = jvm.scala.Option.empty()
        # Of its first attempt, the only one: nothing is shuffled, so no stage is run again.
        store, found = status_store(spark), list[Task]()
        for first in range(0, _MOST_TASKS, _PAGE):
            listed = store.taskList(stage, 0, first, _PAGE, nothing, False, failed)
            page: list[Task] = as_json(spark, listed)
            found += page
            if len(page) < _PAGE:
                break
        # Where tasks fail meanwhile, a page begins with the end of the one before.
        found = list({(task["index"], task["attempt"]): task for task in found}.values())
    except (Py4JError, AttributeError, OSError) as error:
        log.warning("Spark does not report why starts of a case were lost: %s", error)
        return []
    return found


def _await_what_spark_knows(spark: SparkContext) -> None:
    """Its store learns of a task's end by an event, which a busy driver handles later."""
    try:
        spark._jsc.sc().listenerBus().waitUntilEmpty(_EVENTS_MILLISECONDS)  # noqa: SLF001
    except Py4JJavaError as error:
        log.warning("Spark has events that wait: %s", error.java_exception)


def _start(task: Task) -> dict[str, Any]:
    milliseconds = task.get("duration")
    return {
        "executor": task["executorId"],
        "host": task["host"],
        "seconds": None if milliseconds is None else milliseconds / 1000,
        "error": str(task.get("errorMessage") or "")[:_MOST_CHARACTERS],
    }
