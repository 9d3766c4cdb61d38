"""The operator's metrics. Few, and none with a label per job: those would grow without end."""

from collections import Counter as Tally
from collections.abc import Iterator

from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from bagpipe_operator.queue import WorkQueue
from bagpipe_operator.view import View

PHASES = ("Pending", "Planning", "Running", "Complete", "Failed")


class _StateCollector(Collector):
    """Counts what the view and the queue hold at the moment of the scrape."""

    def __init__(self, view: View, queue: WorkQueue) -> None:
        self._view = view
        self._queue = queue

    def collect(self) -> Iterator[GaugeMetricFamily]:
        """The gauges."""
        tally = Tally(job.status.get("phase") or "Pending" for job in self._view.jobs())
        jobs = GaugeMetricFamily("bagpipe_jobs", "SimulationJobs by phase.", labels=["phase"])
        for phase in PHASES:
            jobs.add_metric([phase], tally[phase])
        yield jobs
        yield GaugeMetricFamily(
            "bagpipe_queue_depth", "Jobs that wait to be reconciled.", value=len(self._queue)
        )


class Metrics:
    """Counters and gauges of one operator, in a registry of their own."""

    def __init__(self, view: View, queue: WorkQueue) -> None:
        self.registry = CollectorRegistry()
        self.registry.register(_StateCollector(view, queue))
        self.reconciles = Counter(
            "bagpipe_reconciles",
            "Reconciles by result: done, retried after a refusal or timeout, faulted by a bug.",
            ["result"],
            registry=self.registry,
        )
        for result in ("done", "retried", "faulted"):
            self.reconciles.labels(result=result)
        self.reconcile_seconds = Histogram(
            "bagpipe_reconcile_seconds",
            "Time of one reconcile, with its calls to the API server and the driver.",
            buckets=(0.001, 0.005, 0.02, 0.1, 0.5, 2, 10, 60),
            registry=self.registry,
        )
        self.watch_events = Counter(
            "bagpipe_watch_events",
            "Objects that the watches delivered.",
            ["kind"],
            registry=self.registry,
        )
