"""Deletes the jobs that a schedule replaces, and those that it keeps no longer.

A deletion may be denied, or hang, for as long as a webhook likes: no run waits for that of a job
that has ended.
"""

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Protocol

from bagpipe_operator.api import reasons
from bagpipe_operator.cluster.client import TIMEOUT, ApiError, Objects
from bagpipe_operator.cluster.fence import NotLeadingError
from bagpipe_operator.cluster.lent_pods import may_lend_pods
from bagpipe_operator.runtime.queue import retry_delay
from bagpipe_operator.schedules.decide import Decision
from bagpipe_operator.schedules.status import Refused
from bagpipe_operator.schedules.view import ScheduledJob, Schedules, ScheduleView

logger = logging.getLogger(__name__)

# A visit's calls before that may take as long again, and all have the reconcile's 60 s.
MOST_SECONDS = 15.0
# The others' turn comes at the next visit: a year's jobs may be denied.
MOST_DENIED = 5


class Deleter(Objects, Protocol):
    """What the removal of jobs needs of an API server; every method raises ApiError."""

    async def delete_job(self, namespace: str, name: str, uid: str) -> None:
        """Deletes a job if it still is the one with that UID; gone is no error."""


@dataclass
class JobRemoval:
    """One per operator."""

    api: Deleter
    view: Schedules
    now: Callable[[], datetime]
    _failures: dict[str, int] = field(default_factory=dict)  # in a row, by schedule
    _denied: dict[str, dict[str, None]] = field(default_factory=dict)  # jobs, who failed last last

    async def of_replaced(self, jobs: Sequence[ScheduledJob]) -> Refused | None:
        """Why these can't be replaced by a run now."""
        for job in jobs:
            try:
                await self._delete(job)
            except NotLeadingError:
                raise
            except ApiError as error:
                return Refused(
                    reasons.CREATION_REFUSED,
                    f"{job.name}, which it replaces, can't be deleted: {error.message}",
                )
        return None

    async def of_surplus(
        self, schedule: ScheduleView, decision: Decision, now: datetime
    ) -> datetime | None:
        """Deletes what is beyond the history's limits, until there is something else to do.

        When to try the rest again; None where that depends on other things than time.
        """
        uid, seconds = schedule.uid, MOST_SECONDS
        if decision.wake is not None:
            seconds = min(seconds, (decision.wake - self.now()).total_seconds())
        error = None
        try:
            async with asyncio.timeout(seconds):
                error = await self._some_of(uid, decision.surplus)
        except TimeoutError:
            error = ApiError(0, TIMEOUT, "jobs are still being deleted")
        if error is None:
            self.forget(uid)
            return None
        failures = self._failures[uid] = self._failures.get(uid, 0) + 1
        delay = retry_delay(failures)
        what = f"{schedule.namespace}/{schedule.name}"
        logger.warning("%s: old jobs are deleted in %.1f s: %s", what, delay, error)
        return now + timedelta(seconds=delay)

    async def _some_of(self, uid: str, jobs: Sequence[ScheduledJob]) -> ApiError | None:
        """Deletes what it can, first what was not denied before; the first ApiError."""
        there = {job.uid for job in jobs}
        denied = {job: None for job in self._denied.get(uid, {}) if job in there}
        order = {job: number for number, job in enumerate(denied)}
        errors: list[ApiError] = []
        self._denied[uid] = denied
        for job in sorted(jobs, key=lambda job: order.get(job.uid, -1)):
            denied.pop(job.uid, None)
            denied[job.uid] = None  # also where time is over in the middle of it
            try:
                if not await may_lend_pods(self.api, job.namespace, job.pool_driver, job.uid):
                    await self._delete(job)
            except NotLeadingError:
                raise
            except ApiError as error:
                errors.append(error)
                if len(errors) == MOST_DENIED:
                    break
            else:
                del denied[job.uid]
        return next(iter(errors), None)

    async def _delete(self, job: ScheduledJob) -> None:
        await self.api.delete_job(job.namespace, job.name, job.uid)
        self.view.drop_job(job)

    def forget(self, uid: str) -> None:
        """The schedule is gone, or has no such jobs."""
        self._failures.pop(uid, None)
        self._denied.pop(uid, None)
