"""Why the starts of a case were lost, as Spark knows it: asked when the case is given up."""

import logging
from collections.abc import Callable, Iterable
from typing import Any

from py4j.protocol import Py4JError
from pyspark import SparkContext

from bagpipe.driver.spark_json import as_json, status_store
from bagpipe.run.case_run import Row

# The newest ones: a case that is given up has just lost its last start.
_MOST_TASKS = 1000
_MOST_STARTS = 10
_MOST_CHARACTERS = 1000

Task = dict[str, Any]

log = logging.getLogger(__name__)


def given_up(row: Row, stage: int, index: int) -> Row:
    """The row with the Spark task that made it, which `with_evidence` takes for its question."""
    return row | {"task": [stage, index]}


def with_evidence(rows: Iterable[Row], failed: Callable[[int], list[Task]]) -> list[Row]:
    """The rows; those that were given up have what became of their starts.

    `failed` gives the failed tasks of a stage.
    """
    tasks: dict[int, list[Task]] = {}
    kept: list[Row] = []
    for row in rows:
        if "task" not in row:
            kept.append(row)
            continue
        stage, index = row["task"]
        if stage not in tasks:
            tasks[stage] = sorted(failed(stage), key=lambda task: task["attempt"])
        starts = [_start(task) for task in tasks[stage] if task["index"] == index]
        rest = {key: value for key, value in row.items() if key != "task"}
        kept.append(rest | {"evidence": {"starts": starts[-_MOST_STARTS:]}})
    return kept


def failed_tasks(spark: SparkContext, stage: int) -> list[Task]:
    """The newest failed tasks of a stage; none where Spark does not say."""
    try:
        jvm: Any = spark._jvm  # noqa: SLF001  pyspark offers no public way to it
        failed = jvm.java.util.ArrayList()
        failed.add(jvm.org.apache.spark.status.api.v1.TaskStatus.FAILED)
        nothing = jvm.scala.Option.empty()
        # Of its first attempt, the only one: nothing is shuffled, so no stage is run again.
        listed = status_store(spark).taskList(stage, 0, 0, _MOST_TASKS, nothing, False, failed)
        found: list[Task] = as_json(spark, listed)
    except (Py4JError, AttributeError, OSError) as error:
        log.warning("Spark does not report why starts of a case were lost: %s", error)
        return []
    return found


def _start(task: Task) -> dict[str, Any]:
    milliseconds = task.get("duration")
    return {
        "executor": task["executorId"],
        "host": task["host"],
        "seconds": None if milliseconds is None else milliseconds / 1000,
        "error": str(task.get("errorMessage") or "")[:_MOST_CHARACTERS],
    }
