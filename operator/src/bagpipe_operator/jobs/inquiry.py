"""Asks the drivers whose jobs are not visited in time, and asks for a visit where one has news.

A visit asks its driver itself. But in a burst nearly every visit also writes, and those of new
jobs write several times, each time behind other writes: then a round of all jobs takes as long as
the API server takes for them, and what a driver says of its first fault would wait for its turn. A
question costs the API server nothing, so it waits for none.
"""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, field

from bagpipe_operator.jobs.driver.progress import ProgressReader
from bagpipe_operator.jobs.policies.urgency import is_news
from bagpipe_operator.runtime.queue import WorkQueue

logger = logging.getLogger(__name__)

# Where visits are in time, each driver was asked by its own, and none is asked here.
PERIODS = 1.25
LOOK_SECONDS = 0.25
# A driver that hangs holds a question for its whole deadline: it holds up its own namespace's.
AT_ONCE = 32


@dataclass
class Inquiry:
    """One per operator. `news` is called with the UID of a job; a driver is asked once in
    PERIODS * `sweep_seconds`, by a visit or here."""

    drivers: ProgressReader
    sweep_seconds: float
    namespace_of: Callable[[str], str]
    news: Callable[[str], None]
    leads: Callable[[], bool] = lambda: True
    _due: WorkQueue = field(init=False)

    def __post_init__(self) -> None:
        self._due = WorkQueue(
            tenant_of=lambda driver: self.namespace_of(self.drivers.job_of(driver)),
            workers=AT_ONCE,
        )

    async def run(self) -> None:
        """Asks until cancelled."""
        async with asyncio.TaskGroup() as group:
            for _ in range(AT_ONCE):
                group.create_task(self._ask_in_turn())
            while True:
                if self.leads():
                    for driver in self.drivers.unasked_for(PERIODS * self.sweep_seconds):
                        self._due.add(driver)
                await asyncio.sleep(LOOK_SECONDS)

    async def _ask_in_turn(self) -> None:
        while True:
            driver = await self._due.get()
            try:
                await self._ask(driver)
            except Exception:
                # A bug met with one driver must not keep the others from being asked.
                logger.exception("the driver with the pod %s: unexpected fault", driver)
            finally:
                self._due.done(driver)

    async def _ask(self, driver: str) -> None:
        job = self.drivers.job_of(driver)
        taken, account = await self.drivers.ask(driver)
        if job and is_news(taken, account):
            self.news(job)
