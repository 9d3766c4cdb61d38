"""Puts the operator's parts together. Nothing runs yet, and nobody is asked."""

import asyncio
import os
from collections.abc import AsyncIterator, Coroutine, Set
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import aiohttp
import kopf

from bagpipe_operator.cluster.connection import connected, uses_proxy
from bagpipe_operator.cluster.election import Election, new_identity
from bagpipe_operator.cluster.fence import Fence
from bagpipe_operator.cluster.lease import Terms
from bagpipe_operator.cluster.relists import Relists
from bagpipe_operator.jobs import watch
from bagpipe_operator.jobs.announcer import Announcer
from bagpipe_operator.jobs.driver.offer import DriverOffers
from bagpipe_operator.jobs.driver.progress import ProgressReader
from bagpipe_operator.jobs.inquiry import Inquiry
from bagpipe_operator.jobs.kueue.api import FencedKueueApi, KubernetesKueueApi
from bagpipe_operator.jobs.kueue.queueing import Queueing
from bagpipe_operator.jobs.kueue.watch import WorkloadWatch, register_workloads
from bagpipe_operator.jobs.kueue.workload_view import Workloads
from bagpipe_operator.jobs.large_jobs import LargeJobs
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.overdue_pods import OverduePods
from bagpipe_operator.jobs.reconcile import Reconciler
from bagpipe_operator.jobs.sweep import Sweeper
from bagpipe_operator.jobs.view import View
from bagpipe_operator.notify.courier import Courier
from bagpipe_operator.notify.deliveries import deliveries
from bagpipe_operator.receivers import Receivers
from bagpipe_operator.runtime import serve
from bagpipe_operator.runtime.census import Census
from bagpipe_operator.runtime.clock import utc_now
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.runtime.work import work
from bagpipe_operator.schedules.fenced import FencedScheduleApi
from bagpipe_operator.schedules.loop import ScheduleLoop
from bagpipe_operator.settings import Settings


class Jobs:
    """What is known of jobs, who leads, and which of them wait for a visit."""

    def __init__(self, settings: Settings) -> None:
        self.view, self.fence, self.workloads = View(), Fence(), Workloads()
        self.queue = WorkQueue(tenant_of=self.view.namespace_of, workers=settings.workers)
        self.metrics = JobMetrics(self.view, self.queue, self.fence.leads)
        self.large = LargeJobs(self.view)
        self.sweeper = Sweeper(self.view, self.queue, settings.sweep_seconds, large=self.large)


@dataclass(frozen=True)
class Connections:
    """Whom the operator talks with: the API server, drivers, and receivers of notifications."""

    api: KubernetesKueueApi
    session: aiohttp.ClientSession
    courier: Courier


@asynccontextmanager
async def connections(settings: Settings, jobs: Jobs) -> AsyncIterator[Connections]:
    """They are closed in the end."""
    metrics, fence = jobs.metrics, jobs.fence
    proxied = uses_proxy(os.environ)
    mail = deliveries(settings, metrics.registry, fence.leads, jobs.queue.add, proxied)
    async with connected() as client, aiohttp.ClientSession() as session, mail as courier:
        called, remaining = metrics.api_called, fence.remaining
        api = KubernetesKueueApi(client, settings.request_seconds, called, remaining)
        yield Connections(api, session, courier)


class Operator:
    """The parts; needs a running event loop, whose clock they go by."""

    def __init__(self, settings: Settings, jobs: Jobs, connections: Connections) -> None:
        self._settings, self._jobs, self._connections = settings, jobs, connections
        api, metrics, leads = connections.api, jobs.metrics, jobs.fence.leads
        self._drivers = ProgressReader(
            connections.session, settings.progress_seconds, counted=metrics.driver_asked
        )
        self._reconciler = self._make_reconciler()
        metrics.progress_wait.set_function(self._reconciler.progress_wait)
        self._schedules = ScheduleLoop(FencedScheduleApi(api, jobs.fence), metrics, leads)
        terms, where = Terms(new_identity(), settings.lease_seconds), settings.lease_namespace
        self.election = Election(
            api, jobs.fence, terms, where, settings.lease_name, on_lead=self._take_up
        )
        namespaces = settings.watch_namespaces or (None,)
        self._censuses = (
            Census(jobs.view, jobs.queue, api.job_uids, namespaces),
            self._schedules.census(api.schedule_uids, namespaces),
        )
        metrics.unlisted_namespaces.set_function(
            lambda: len(frozenset().union(*(each.unlisted for each in self._censuses)))
        )
        self.health = serve.Health(
            jobs.sweeper,
            lease_trouble=self.election.trouble,
            list_trouble=self._censuses[0].trouble,
        )

    def _make_reconciler(self) -> Reconciler:
        settings, jobs, metrics = self._settings, self._jobs, self._jobs.metrics
        api, session = FencedKueueApi(self._connections.api, jobs.fence), self._connections.session
        monotonic = asyncio.get_running_loop().time
        queueing = Queueing(api, jobs.workloads, settings, utc_now, monotonic)
        return Reconciler(
            api, jobs.view, self._drivers, settings, utc_now, monotonic, metrics.job_written,
            metrics.status_paced, queueing if settings.kueue else None,
            DriverOffers(session, settings.progress_seconds),
            Announcer(Receivers(settings.receivers), self._connections.courier),
        )  # fmt: skip

    def _take_up(self) -> None:
        self._reconciler.begin_to_lead()
        self._jobs.sweeper.sweep_all()
        self._schedules.sweep_all()

    def note_unlisted(self, namespaces: Set[str | None]) -> None:
        """Takes in where nothing could be listed at the start."""
        for census in self._censuses:
            census.unlisted = namespaces

    def _look_for_what_went(self) -> None:
        for census in self._censuses:
            census.hasten()

    def answers(self) -> serve.Answers:
        """What its port answers."""
        return serve.answers(self.health, self._jobs.metrics)

    def handlers(self) -> kopf.OperatorRegistry:
        """What it watches."""
        settings, jobs = self._settings, self._jobs
        handlers = watch.registry(
            watch.Watch(jobs.view, jobs.queue, jobs.metrics), settings.watch_namespaces,
            Relists(self._look_for_what_went).answered,
        )  # fmt: skip
        if settings.kueue:
            register_workloads(handlers, WorkloadWatch(jobs.workloads, jobs.queue, jobs.metrics))
        return self._schedules.register(handlers)

    def start(self) -> list[asyncio.Task[None]]:
        """Starts all that runs beside the watches, until it is cancelled."""
        tasks = [asyncio.create_task(each) for each in self._running()]
        return [*tasks, *self._schedules.start(), *self._connections.courier.tasks()]

    def _running(self) -> tuple[Coroutine[Any, Any, None], ...]:
        settings, jobs, leads = self._settings, self._jobs, self._jobs.fence.leads
        inquiry = Inquiry(
            self._drivers, settings.sweep_seconds, jobs.view.namespace_of, jobs.queue.add, leads
        )
        at_work = partial(
            work, reconcile=self._reconciler.reconcile, metrics=jobs.metrics, leads=leads,
            called=jobs.view.called,
        )  # fmt: skip
        return (
            jobs.sweeper.run(),
            self.election.run(),
            *(census.run() for census in self._censuses),
            inquiry.run(),
            OverduePods(self._connections.api, jobs.view, leads).run(),
            *(at_work(jobs.queue, passed_on=jobs.large.take) for _ in range(settings.workers)),
            at_work(jobs.large.queue),
        )
