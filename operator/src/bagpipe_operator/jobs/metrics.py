"""Metrics of jobs. None has a label per job: those would grow without end."""

import time
from collections import Counter as Tally
from collections.abc import Callable, Iterator
from datetime import UTC, datetime

from prometheus_client import Counter, Histogram
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from bagpipe_operator.api.names import ROLE_DRIVER, ROLE_EXECUTOR
from bagpipe_operator.jobs import milestones
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.milestones import VERDICTS
from bagpipe_operator.jobs.policies.suspend import rests
from bagpipe_operator.jobs.pools.standing import drivers_of_pools
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.metrics import Metrics
from bagpipe_operator.runtime.queue import WorkQueue

PHASES = ("Pending", "Planning", "Running", "Suspended", "Complete", "Failed")
POD_PHASES = ("Pending", "Running", "Succeeded", "Failed", "Unknown")
CASE_STATES = (
    "planned", "running", "passed", "failed", "invalid", "errored", "crashed", "lost", "regressed",
    "quarantined", "discarded",
)  # fmt: skip
LIFE_BUCKETS = (1, 2, 5, 10, 20, 30, 60, 120, 300, 900, 1800, 3600, 7200, 21600, 86400)


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
            "bagpipe_pool_drivers_waiting",
            "Drivers of pools that wait for another job, each with its executors.",
            value=sum(
                driver.waits
                for namespace in self._view.namespaces_of_pools()
                for driver in drivers_of_pools(self._view, namespace)
            ),
        )
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


class JobMetrics(Metrics):
    """Counters and gauges of one operator's jobs, beside those of its work."""

    def __init__(
        self, view: View, queue: WorkQueue, leads: Callable[[], bool] = lambda: True
    ) -> None:
        super().__init__()
        self._state = _StateCollector(view, queue, leads)
        self.registry.register(self._state)
        self._count_jobs()

    def _count_jobs(self) -> None:
        texts = {
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
            for name, text in texts.items()
        }  # fmt: skip
        self._of_pools = Counter(
            "bagpipe_pool_jobs",
            "Jobs that name a pool, by how they began: Taken over by a driver that waited, or why "
            "each had pods of its own.",
            ["how"],
            registry=self.registry,
        )
        for how in ("Taken", "NoneWaits", "PodsDiffer"):
            self._of_pools.labels(how=how)
        self._ended = Counter(
            "bagpipe_jobs_ended",
            "Jobs that ended, by phase (Complete: all cases ran; Failed) and verdict.",
            ["phase", "verdict"],
            registry=self.registry,
        )
        for verdict in VERDICTS[:3]:
            self._ended.labels(phase="Complete", verdict=verdict)
        self._ended.labels(phase="Failed", verdict="None")

    def reconciled(self, key: str) -> None:
        """A job was looked at and nothing was in the way."""
        super().reconciled(key)
        if key in self._state.visited:
            self._state.visited[key] = time.monotonic()

    def job_written(self, before: JobView, after: JobView) -> None:
        """A job's status was written."""
        for name, seconds in milestones.passed(before, after):
            self._spans[name].observe(seconds)
        if (began := milestones.begun_in_pool(before, after)) is not None:
            self._of_pools.labels(how=began).inc()
        how = milestones.ended(before, after)
        if how is not None:
            self._ended.labels(phase=how.phase, verdict=how.verdict).inc()
