"""The operator's metrics. None has a label per job: those would grow without end."""

import time
from collections import Counter as Tally
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from importlib.metadata import version

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    ProcessCollector,
    generate_latest,
)
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from bagpipe_operator.api.names import ROLE_DRIVER, ROLE_EXECUTOR
from bagpipe_operator.jobs import milestones
from bagpipe_operator.jobs.milestones import VERDICTS
from bagpipe_operator.jobs.policies.life import rests
from bagpipe_operator.jobs.view import JobView, View
from bagpipe_operator.runtime.queue import WorkQueue

RELEASE = version("bagpipe-operator")  # it reads files, so not when the loop runs already
PHASES = ("Pending", "Planning", "Running", "Suspended", "Complete", "Failed")
POD_PHASES = ("Pending", "Running", "Succeeded", "Failed", "Unknown")
CASE_STATES = (
    "planned", "running", "passed", "failed", "invalid", "errored", "crashed", "lost", "regressed",
    "discarded",
)  # fmt: skip
LIFE_BUCKETS = (1, 2, 5, 10, 20, 30, 60, 120, 300, 900, 1800, 3600, 7200, 21600, 86400)
CALL_BUCKETS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10)


class _StateCollector(Collector):
    """Counts what the view and the queue hold at the moment of the scrape."""

    def __init__(self, view: View, queue: WorkQueue, leads: Callable[[], bool]) -> None:
        self._view = view
        self._queue = queue
        self._leads = leads
        self.visited: dict[str, float] = {}

    def collect(self) -> Iterator[GaugeMetricFamily]:
        """The gauges."""
        found = list(self._view.jobs())
        tally = Tally(job.status.get("phase") or "Pending" for job in found)
        jobs = GaugeMetricFamily("bagpipe_jobs", "SimulationJobs by phase.", labels=["phase"])
        for phase in PHASES:
            jobs.add_metric([phase], tally[phase])
        yield jobs
        yield self._cases([job for job in found if not job.finished])
        yield self._pods()
        yield GaugeMetricFamily(
            "bagpipe_oldest_pending_job_seconds",
            "For how long the oldest job that waits for its first driver has been waiting; 0 when "
            "none does.",
            value=_oldest_pending(found, datetime.now(UTC)),
        )
        yield GaugeMetricFamily(
            "bagpipe_queue_depth", "Jobs that wait to be reconciled.", value=len(self._queue)
        )
        yield GaugeMetricFamily(
            "bagpipe_status_age_seconds",
            "Time since the job that was looked at the longest ago was looked at, of those that "
            "have not ended; 0 in a replica that does not lead.",
            value=self._status_age(found),
        )
        yield GaugeMetricFamily(
            "bagpipe_leader", "1 in the replica that leads, 0 in the others.", value=self._leads()
        )

    @staticmethod
    def _cases(jobs: list[JobView]) -> GaugeMetricFamily:
        sums = Tally[str]()
        for job in jobs:
            sums.update({k: int(v) for k, v in (job.status.get("cases") or {}).items()})
        cases = GaugeMetricFamily(
            "bagpipe_unfinished_cases",
            "Cases of the jobs that have not ended, by state, as their statuses say.",
            labels=["state"],
        )
        for state in CASE_STATES:
            cases.add_metric([state], sums[state])
        return cases

    def _pods(self) -> GaugeMetricFamily:
        tally = Tally((pod.role, pod.phase) for pod in self._view.all_pods())
        pods = GaugeMetricFamily(
            "bagpipe_pods", "Pods of jobs by role and phase.", labels=["role", "phase"]
        )
        for role in (ROLE_DRIVER, ROLE_EXECUTOR):
            for phase in POD_PHASES:
                pods.add_metric([role, phase], tally[role, phase])
        return pods

    def _status_age(self, jobs: list[JobView]) -> float:
        now = time.monotonic()
        waiting = {job.uid for job in jobs if not job.finished and not rests(job)}
        if not self._leads():
            waiting = set()
        self.visited = {uid: self.visited.get(uid, now) for uid in waiting}
        return max((now - seen for seen in self.visited.values()), default=0.0)


def _oldest_pending(jobs: list[JobView], now: datetime) -> float:
    created = [
        datetime.fromisoformat(job.created)
        for job in jobs
        if job.created and (job.status.get("phase") or "Pending") == "Pending"
        if not job.finished and not job.spec.get("suspend")
    ]
    return max(((now - moment).total_seconds() for moment in created), default=0.0)


def of_the_process() -> bytes:
    """What the kernel says of this process, as text. It reads files: not for the loop's thread."""
    registry = CollectorRegistry()
    ProcessCollector(registry=registry)
    return generate_latest(registry)


class Metrics:
    """Counters and gauges of one operator, in a registry of their own."""

    def __init__(
        self, view: View, queue: WorkQueue, leads: Callable[[], bool] = lambda: True
    ) -> None:
        self.registry = CollectorRegistry()
        self._state = _StateCollector(view, queue, leads)
        self.registry.register(self._state)
        info = Gauge(
            "bagpipe_operator_info", "1; the label tells the operator's release.", ["version"],
            registry=self.registry,
        )  # fmt: skip
        info.labels(version=RELEASE).set(1)
        self._count_work()
        self._count_calls()
        self._count_jobs()

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
        self._asked = Counter(
            "bagpipe_driver_requests",
            "Questions to drivers for their progress: answered, or silent.",
            ["result"],
            registry=self.registry,
        )
        for result in ("answered", "silent"):
            self._asked.labels(result=result)

    def _count_jobs(self) -> None:
        told = {
            milestones.ACCEPTED: "From a job's creation (or resumption) to its first driver's pod.",
            milestones.PLANNED: "From the driver's pod to the plan of the cases.",
            milestones.RUNNING: "From the plan (or the driver's start) to the first case's begin.",
            milestones.ENDED: "From the first case's begin to the job's end.",
        }
        self._spans = {
            name: Histogram(
                f"bagpipe_job_{name}_seconds", f"{text} Right to within a second.",
                buckets=LIFE_BUCKETS, registry=self.registry,
            )
            for name, text in told.items()
        }  # fmt: skip
        self._ended = Counter(
            "bagpipe_jobs_ended",
            "Jobs that ended, by phase (Complete: all cases ran; Failed) and verdict.",
            ["phase", "verdict"],
            registry=self.registry,
        )
        for verdict in VERDICTS[:3]:
            self._ended.labels(phase="Complete", verdict=verdict)
        self._ended.labels(phase="Failed", verdict="None")

    def reconciled(self, uid: str) -> None:
        """A job was looked at and nothing was in the way."""
        self.reconciles.labels(result="done").inc()
        if uid in self._state.visited:
            self._state.visited[uid] = time.monotonic()

    def api_called(self, method: str, status: int, seconds: float) -> None:
        """The API server answered with this status, 0 for not at all, after so many seconds."""
        self._calls.labels(verb=method, code=str(status) if status else "none").inc()
        self._call_seconds.labels(verb=method).observe(seconds)
        if status == 429:
            self._throttled.inc()

    def driver_asked(self, answered: bool) -> None:
        """A driver was asked for its progress."""
        self._asked.labels(result="answered" if answered else "silent").inc()

    def job_written(self, before: JobView, after: JobView) -> None:
        """A job's status was written."""
        for name, seconds in milestones.passed(before, after):
            self._spans[name].observe(seconds)
        how = milestones.ended(before, after)
        if how is not None:
            self._ended.labels(phase=how.phase, verdict=how.verdict).inc()
