"""Forgets the jobs whose deletion no watch has told, such as those that went between two watches.

A job that ended or rests is visited by nothing else, and would stay in memory and in the gauges.
"""

import asyncio
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from bagpipe_operator.api import ApiError
from bagpipe_operator.queue import WorkQueue
from bagpipe_operator.view import View

logger = logging.getLogger(__name__)

PERIOD_SECONDS = 600.0


class Register(Protocol):
    """Who knows all jobs."""

    async def job_uids(self, namespace: str | None) -> set[str]:
        """Of a namespace, or of all; raises ApiError."""


@dataclass
class Census:
    """Compares what is known with what there is, every `period_seconds`."""

    view: View
    queue: WorkQueue
    register: Register
    namespaces: Sequence[str | None]
    period_seconds: float = PERIOD_SECONDS

    async def count(self) -> int:
        """One comparison; how many jobs were forgotten. Raises ApiError."""
        # Known before the list begins, so that what is created meanwhile is not missed in it.
        known = [job.uid for job in self.view.jobs()]
        there: set[str] = set()
        for namespace in self.namespaces:
            there |= await self.register.job_uids(namespace)
        gone = [uid for uid in known if uid not in there]
        for uid in gone:
            self.view.drop_job(uid)
            self.view.drop_pods(uid)
            self.queue.forget(uid)
            # A visit of what is not there forgets all else that is known of it.
            self.queue.add(uid)
        return len(gone)

    async def run(self) -> None:
        """Compares until cancelled."""
        while True:
            await asyncio.sleep(self.period_seconds)
            try:
                gone = await self.count()
            except ApiError as error:
                logger.warning("jobs that are gone are looked for later: %s", error)
                continue
            if gone:
                logger.info("%d jobs went without a word of the watch", gone)
