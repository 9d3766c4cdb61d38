"""Metrics of what runs reconcilers: work, watches, calls. None has a label per object."""

from importlib.metadata import version

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    ProcessCollector,
    generate_latest,
)

RELEASE = version("bagpipe-operator")  # it reads files, so not when the loop runs already
CALL_BUCKETS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10)


def of_the_process() -> bytes:
    """What the kernel says of this process, as text. It reads files: not for the loop's thread."""
    registry = CollectorRegistry()
    ProcessCollector(registry=registry)
    return generate_latest(registry)


class Metrics:
    """Counters of one operator, in a registry of their own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        info = Gauge(
            "bagpipe_operator_info", "1; the label is the operator's release.", ["version"],
            registry=self.registry,
        )  # fmt: skip
        info.labels(version=RELEASE).set(1)
        self._count_work()
        self._count_calls()

    def _count_work(self) -> None:
        self.reconciles = Counter(
            "bagpipe_reconciles",
            "Reconciles by result: done, retried after a refusal or timeout, faulted by a bug, "
            "fenced by the loss of leadership.",
            ["result"],
            registry=self.registry,
        )
        for result in ("done", "retried", "faulted", "fenced"):
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
        self.unlisted_namespaces = Gauge(
            "bagpipe_unlisted_namespaces",
            "Watched namespaces of which the last list of all jobs or schedules failed, as where "
            "the operator has no rights: nothing is done for their jobs, and those of others go "
            "on.",
            registry=self.registry,
        )

    def _count_calls(self) -> None:
        self._calls = Counter(
            "bagpipe_api_requests",
            "Calls to the API server by verb and HTTP status: 200 for every success, `none` where "
            "there was no answer in time. The watches are kopf's and are not among them.",
            ["verb", "code"],
            registry=self.registry,
        )
        self._call_seconds = Histogram(
            "bagpipe_api_request_seconds", "Time of one call to the API server.", ["verb"],
            buckets=CALL_BUCKETS, registry=self.registry,
        )  # fmt: skip
        self._throttled = Counter(
            "bagpipe_api_throttled",
            "Calls that the API server refused because there were too many (429).",
            registry=self.registry,
        )
        self.progress_wait = Gauge(
            "bagpipe_status_progress_wait_seconds",
            "For how long counts of a running job wait to be written, so that a busy API server "
            "has time for what is urgent; 0 when it answers quickly.",
            registry=self.registry,
        )
        self._paced = Counter(
            "bagpipe_status_decisions",
            "Changes of jobs' statuses by what was decided: urgent ones and progress were written, "
            "progress that was put off is looked at again at the next visit.",
            ["decision"],
            registry=self.registry,
        )
        for decision in ("urgent", "progress", "put_off"):
            self._paced.labels(decision=decision)
        self._asked = Counter(
            "bagpipe_driver_requests",
            "Questions to drivers for their progress: answered, or silent.",
            ["result"],
            registry=self.registry,
        )
        for result in ("answered", "silent"):
            self._asked.labels(result=result)

    def reconciled(self, key: str) -> None:  # noqa: ARG002
        """An object was looked at and nothing was in the way."""
        self.reconciles.labels(result="done").inc()

    def api_called(self, method: str, status: int, seconds: float) -> None:
        """The API server answered with this status, 0 for not at all, after so many seconds."""
        self._calls.labels(verb=method, code=str(status) if status else "none").inc()
        self._call_seconds.labels(verb=method).observe(seconds)
        if status == 429:
            self._throttled.inc()

    def status_paced(self, decision: str) -> None:
        """A change of a status was written, or put off."""
        self._paced.labels(decision=decision).inc()

    def driver_asked(self, answered: bool) -> None:
        """A driver was asked for its progress."""
        self._asked.labels(result="answered" if answered else "silent").inc()
