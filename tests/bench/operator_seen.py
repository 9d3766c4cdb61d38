"""What the bench sees of jobs and driver pods through watches of its own, and when."""

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field

from bagpipe_operator.api import names
from tests.bench.operator_api import JOBS, Client, Object
from tests.bench.operator_drivers import STEP, FakeDrivers, fault_after
from tests.bench.operator_times import staleness
from tests.bench.operator_world import NAMESPACE

Moments = dict[str, float]


@dataclass
class Seen:
    """Moments of time.monotonic by the name of the job, each the first of its kind."""

    drivers: FakeDrivers
    pod_created: Moments = field(default_factory=dict)
    pod_running: Moments = field(default_factory=dict)
    accepted: Moments = field(default_factory=dict)
    running_reported: Moments = field(default_factory=dict)  # the phase follows the pod
    faulted: Moments = field(default_factory=dict)  # a driver's one case failed
    fault_reported: Moments = field(default_factory=dict)
    passed: dict[str, int] = field(default_factory=dict)  # as the status says now
    stale: list[float] = field(default_factory=list)  # samples, seconds

    def take_pod(self, kind: str, pod: Object) -> None:
        """An event of the watch of pods."""
        labels = pod["metadata"].get("labels") or {}
        if kind == "DELETED" or labels.get(names.LABEL_ROLE) != names.ROLE_DRIVER:
            return
        now, job = time.monotonic(), labels[names.LABEL_JOB]
        self.pod_created.setdefault(job, now)
        status = pod.get("status") or {}
        address = status.get("podIP")
        if status.get("phase") == "Running" and address and job not in self.pod_running:
            self.pod_running[job] = now
            self.drivers.running_since[address] = now
            self.faulted[job] = now + fault_after(address)

    def take_job(self, kind: str, job: Object) -> None:
        """An event of the watch of jobs."""
        if kind == "DELETED":
            return
        now, name, status = time.monotonic(), job["metadata"]["name"], job.get("status") or {}
        for condition in status.get("conditions") or []:
            if condition["type"] == "Accepted" and condition["status"] == "True":
                self.accepted.setdefault(name, now)
        if status.get("phase", "Pending") != "Pending":
            self.running_reported.setdefault(name, now)
        cases = status.get("cases") or {}
        if cases.get("failed"):
            self.fault_reported.setdefault(name, now)
        if (passed := cases.get("passed")) is not None:
            self.passed[name] = passed

    def sample(self) -> None:
        """Notes how stale the status of every running job is at this moment."""
        now = time.monotonic()
        self.stale += [
            staleness(now, since, self.passed.get(job), STEP)
            for job, since in self.pod_running.items()
        ]


@contextlib.asynccontextmanager
async def watching(client: Client, drivers: FakeDrivers) -> AsyncIterator[Seen]:
    """Watches jobs and pods until the block ends; a watch that breaks fails the block's waits."""
    seen = Seen(drivers)
    async with (
        client.watched(JOBS.format(NAMESPACE), seen.take_job),
        client.watched(f"/api/v1/namespaces/{NAMESPACE}/pods", seen.take_pod),
    ):
        yield seen


async def until(what: str, holds: Callable[[], bool], seconds: float) -> None:
    """Waits for something that the watches will report; TimeoutError says what did not come."""
    deadline = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > deadline:
            raise TimeoutError(f"{what} did not happen within {seconds:.0f} s")
        await asyncio.sleep(0.02)
