"""Spark with its executors, kept for a further job whose settings are the same."""

import logging
import threading
import time
from collections.abc import Callable, Mapping

from py4j.protocol import Py4JError
from pyspark import SparkContext

from bagpipe.driver.cases_on_spark import is_gone
from bagpipe.driver.spark_gone import SparkGoneError
from bagpipe.driver.spark_json import as_json, status_store

Settings = Mapping[str, str]

# How the job is called, and how many executors Spark begins with: it asks for more by itself.
_OF_ONE_JOB = frozenset(
    {
        "spark.app.name",
        "spark.kubernetes.executor.podNamePrefix",
        "spark.dynamicAllocation.initialExecutors",
    }
)
_LOOK_SECONDS = 0.1

log = logging.getLogger(__name__)


def alike(settings: Settings, others: Settings) -> bool:
    """Whether a Spark that was started with one of them does for a job that wants the other."""
    return _lasting(settings) == _lasting(others)


def _lasting(settings: Settings) -> dict[str, str]:
    return {key: value for key, value in settings.items() if key not in _OF_ONE_JOB}


class KeptSpark:
    """At most one SparkContext, which is all that a process may have. For one thread."""

    def __init__(
        self,
        start: Callable[[Settings], SparkContext],
        stop: Callable[[SparkContext], None] = SparkContext.stop,
    ) -> None:
        self._start, self._stop = start, stop
        self._spark: SparkContext | None = None
        self._settings: Settings = {}

    def of(self, settings: Settings) -> SparkContext:
        """The Spark of the job before, or one that is started.

        Raises SparkGoneError where the one before has ended, or has other settings: a further
        driver does what this one can't, with a JVM of its own.
        """
        if self._spark is None:
            self._spark, self._settings = self._start(settings), settings
        elif not alike(self._settings, settings) or is_gone(self._spark):
            raise SparkGoneError
        return self._spark

    def settles(self, seconds: float) -> bool:
        """Whether within this time no executor runs anything.

        Spark calls a job done while copies of its cases still run, or cases that were cancelled:
        they hold slots, and the next job's cases would wait for these and be given up.
        """
        deadline = time.monotonic() + seconds
        while (busy := self._busy()) and time.monotonic() < deadline:
            threading.Event().wait(_LOOK_SECONDS)
        return not busy

    def end(self) -> None:
        """Spark and its executors are gone when this returns."""
        spark, self._spark = self._spark, None
        if spark is not None:
            self._stop(spark)

    def _busy(self) -> bool:
        """Whether anything runs; also where Spark does not say."""
        if self._spark is None:
            return False
        try:
            listed = as_json(self._spark, status_store(self._spark).executorList(True))
        except (Py4JError, OSError, AttributeError) as error:
            log.warning("Spark does not report what runs: %s", error)
            return True
        return any(executor["activeTasks"] for executor in listed)
