"""What Spark itself knows of its executors, for /metrics.

Spark's own endpoint is a part of its web UI, which is off: anybody who reaches it sees the job's
settings and can end its stages. The same figures are asked of Spark's status store, in one call.
"""

import logging
import threading
from collections.abc import Callable, Iterator
from typing import Any

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from py4j.protocol import Py4JError
from pyspark import SparkContext

from bagpipe.driver.spark_json import as_json, status_store

# A JVM that is busy must not cost the scrape all the other figures: it gets the last answer then.
_PATIENCE_SECONDS = 1.0

log = logging.getLogger(__name__)

# name, help, kind, Spark's field, factor to seconds or bytes
_FIELDS: list[tuple[str, str, type[GaugeMetricFamily] | type[CounterMetricFamily], str, float]] = [
    ("spark_executor_active_tasks", "Tasks (cases) that run on the executor.",
     GaugeMetricFamily, "activeTasks", 1),
    ("spark_executor_completed_tasks", "Tasks that ended well.",
     CounterMetricFamily, "completedTasks", 1),
    ("spark_executor_failed_tasks", "Tasks that Spark counts as failed.",
     CounterMetricFamily, "failedTasks", 1),
    ("spark_executor_task_seconds", "Time that the executor spent in tasks.",
     CounterMetricFamily, "totalDuration", 1e-3),
    ("spark_executor_gc_seconds", "Time that the executor's JVM spent collecting garbage.",
     CounterMetricFamily, "totalGCTime", 1e-3),
    ("spark_executor_storage_memory_used_bytes", "Memory in use for Spark's blocks.",
     GaugeMetricFamily, "memoryUsed", 1),
    ("spark_executor_storage_memory_max_bytes", "Memory that Spark may use for its blocks.",
     GaugeMetricFamily, "maxMemory", 1),
    ("spark_executor_tasks_max", "Tasks that the executor can run at once.",
     GaugeMetricFamily, "maxTasks", 1),
    ("spark_executor_disk_used_bytes", "Disk in use for Spark's blocks.",
     GaugeMetricFamily, "diskUsed", 1),
]  # fmt: skip

# name, help, Spark's name among the peaks that an executor reports with its heartbeats
_PEAKS = [
    ("spark_executor_jvm_heap_peak_bytes", "The most heap that the executor's JVM has used.",
     "JVMHeapMemory"),
    ("spark_executor_jvm_off_heap_peak_bytes",
     "The most memory beside its heap that the executor's JVM has used.", "JVMOffHeapMemory"),
]  # fmt: skip


class SparkExecutors(Collector):
    """Spark's executors of the job; nothing before Spark has started and after it has ended."""

    def __init__(self, wanted: Callable[[], int]) -> None:
        self._wanted = wanted

    def collect(self) -> Iterator[Metric]:
        """The executors that the job asked for and has, and what each of these says."""
        known = _ASKING.known()
        states = GaugeMetricFamily(
            "bagpipe_executors",
            "Executors: wanted by the job for the cases that have not ended, and registered with "
            "its driver.",
            labels=["state"],
        )
        # Spark counts its driver among its executors.
        registered = [e for e in known if e["isActive"] and e["id"] != "driver"]
        states.add_metric(["wanted"], self._wanted())
        states.add_metric(["registered"], len(registered))
        yield states
        for name, text, kind, field, factor in _FIELDS:
            family: Any = kind(name, f"{text} Spark's own figure.", labels=["executor"])
            for executor in known:
                family.add_metric([executor["id"]], executor[field] * factor)
            yield family
        for name, text, peak in _PEAKS:
            family = GaugeMetricFamily(name, f"{text} Spark's own figure.", labels=["executor"])
            for executor in known:
                # There is none before an executor's first heartbeat.
                if peak in (peaks := executor.get("peakMemoryMetrics") or {}):
                    family.add_metric([executor["id"]], peaks[peak])
            yield family


class _Asking:
    """Asks from one thread, whichever job the driver has: for each thread that asks it the JVM
    keeps one of its own."""

    def __init__(self) -> None:
        self._last: list[dict[str, Any]] = []
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._asked, self._answered = threading.Event(), threading.Event()

    def known(self) -> list[dict[str, Any]]:
        """The executors, its driver among them; the last answer where there is none in time."""
        # pyspark offers no public way to the context of the process, nor to its JVM.
        if SparkContext._active_spark_context is None:  # noqa: SLF001
            return []
        with self._lock:
            if self._thread is None or not self._thread.is_alive():
                self._thread = threading.Thread(target=self._serve, name="executors", daemon=True)
                self._thread.start()
        self._answered.clear()
        self._asked.set()
        self._answered.wait(_PATIENCE_SECONDS)
        return self._last

    def _serve(self) -> None:
        while True:
            self._asked.wait()
            self._asked.clear()
            self._last = _asked_of_spark()
            self._answered.set()


# A process has one Spark.
_ASKING = _Asking()


def _asked_of_spark() -> list[dict[str, Any]]:
    spark: Any = SparkContext._active_spark_context  # noqa: SLF001
    try:
        found: list[dict[str, Any]] = as_json(spark, status_store(spark).executorList(True))
    except (Py4JError, AttributeError, OSError) as error:
        # Spark is being started or stopped: a scrape of that moment goes without its figures.
        log.debug("Spark reports nothing of its executors: %s", error)
        return []
    return found
