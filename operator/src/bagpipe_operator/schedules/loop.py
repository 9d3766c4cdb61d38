"""Schedules' parts, tied together: main starts them beside those of jobs."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from datetime import datetime

import kopf

from bagpipe_operator.runtime.census import Census
from bagpipe_operator.runtime.clock import utc_now
from bagpipe_operator.runtime.metrics import Metrics
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.runtime.work import work
from bagpipe_operator.schedules import watch
from bagpipe_operator.schedules.alarms import Alarms
from bagpipe_operator.schedules.metrics import ScheduleMetrics
from bagpipe_operator.schedules.reconcile import ScheduleApi, ScheduleReconciler
from bagpipe_operator.schedules.view import Schedules

# Each run costs four calls to the API server; thousands of schedules may fall due at midnight.
WORKERS = 4


class ScheduleLoop:
    """A queue of its own, so that jobs never wait for schedules, nor schedules for jobs."""

    def __init__(
        self,
        api: ScheduleApi,
        metrics: Metrics,
        leads: Callable[[], bool] = lambda: True,
        now: Callable[[], datetime] = utc_now,
    ) -> None:
        self._metrics = metrics
        self._leads = leads
        self._view = Schedules()
        self._queue = WorkQueue(tenant_of=self._view.namespace_of, workers=WORKERS)
        self._alarms = Alarms(self._queue, now)
        self._reconciler = ScheduleReconciler(
            api, self._view, self._alarms, ScheduleMetrics(self._view, metrics.registry), now
        )

    def register(self, handlers: kopf.OperatorRegistry) -> kopf.OperatorRegistry:
        """Adds what schedules watch; the same registry again."""
        watch.register(handlers, watch.ScheduleWatch(self._view, self._queue, self._metrics))
        return handlers

    def sweep_all(self) -> None:
        """Asks for every schedule: a new leader knows of no work done, and of no next run."""
        for schedule in self._view.schedules():
            self._queue.add(schedule.uid)

    def census(
        self,
        register: Callable[[str | None], Awaitable[set[str]]],
        namespaces: Sequence[str | None],
    ) -> Census:
        """Who forgets the schedules that went between two watches."""
        return Census(self._view, self._queue, register, namespaces)

    def start(self) -> list[asyncio.Task[None]]:
        """Starts alarms and workers; they end when they are cancelled."""
        reconcile = self._reconciler.reconcile
        tasks = [asyncio.create_task(self._alarms.run())]
        tasks += [
            asyncio.create_task(
                work(
                    self._queue,
                    reconcile,
                    self._metrics,
                    self._leads,
                    self._view.called,
                    "schedule",
                )
            )
            for _ in range(WORKERS)
        ]
        return tasks
