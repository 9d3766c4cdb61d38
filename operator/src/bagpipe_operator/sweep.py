"""Time as a source of work: visits every job that has not ended, for progress and deadlines."""

import asyncio
from dataclasses import dataclass

from bagpipe_operator.queue import WorkQueue
from bagpipe_operator.view import View


@dataclass
class Sweeper:
    """Asks for all unfinished jobs every `period_seconds`; its pulse tells that the loop lives."""

    view: View
    queue: WorkQueue
    period_seconds: float
    last_sweep: float = float("-inf")

    def sweep(self) -> int:
        """One visit; how many jobs were asked for."""
        unfinished = [job for job in self.view.jobs() if not job.finished and not job.deleting]
        for job in unfinished:
            self.queue.add_if_rested(job.uid)
        return len(unfinished)

    async def run(self) -> None:
        """Sweeps until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            self.sweep()
            self.last_sweep = loop.time()
            await asyncio.sleep(self.period_seconds)
