"""Time as a source of work: visits every job that time may bring forward, or to its removal.

And every job whose last visit failed, whatever it is in: a job that has ended, or that rests, may
have an unwritten Event or an undeleted pod, and nothing else would ever ask for it.
"""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime

from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.large_jobs import LargeJobs
from bagpipe_operator.jobs.policies.places import lingers
from bagpipe_operator.jobs.policies.suspend import is_swept
from bagpipe_operator.jobs.policies.ttl import expired
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import WorkQueue


@dataclass
class Sweeper:
    """Asks every `period_seconds` for the jobs that are due.

    Its pulse shows that the loop is alive.
    """

    view: View
    queue: WorkQueue
    period_seconds: float
    last_sweep: float = float("-inf")
    now: Callable[[], datetime] = lambda: datetime.now(UTC)
    large: LargeJobs | None = None

    def sweep(self) -> int:
        """One visit; how many jobs were asked for."""
        jobs = (job for job in self.view.jobs() if self._is_due(job))
        failed = self.queue.rested() + (self.large.queue.rested() if self.large else [])
        due = {job.uid: None for job in jobs} | dict.fromkeys(failed)
        for uid in due:
            self.queue.add_if_rested(uid)
        return len(due)

    def _is_due(self, job: JobView) -> bool:
        if not job.finished:
            return is_swept(job)
        now, pods = self.now(), self.view.pods(job.uid)
        waits = bool(job.status.get("pool")) and any(not (p.ended or p.deleting) for p in pods)
        removed = expired(job, now) and not job.deleting
        return removed or waits or any(lingers(pod, now) for pod in pods)

    def sweep_all(self) -> None:
        """Asks for every job, also those that have ended: a new leader knows of no work done."""
        for job in self.view.jobs():
            self.queue.add(job.uid)

    async def run(self) -> None:
        """Sweeps until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            self.sweep()
            self.last_sweep = loop.time()
            await asyncio.sleep(self.period_seconds)
