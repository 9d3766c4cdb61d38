"""`bagpipe-operator`: reads the settings, wires the parts, runs until a signal."""

import asyncio
import gc
import logging
import os
import sys
from collections.abc import AsyncIterator, Coroutine, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import Any

import aiohttp
import kopf
from kubernetes.aio import config
from kubernetes.aio.client import ApiClient, Configuration

from bagpipe.installed import InstallationError
from bagpipe.spec import load_installed
from bagpipe_operator.cluster.client import ApiError
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
from bagpipe_operator.notify.deliveries import deliveries
from bagpipe_operator.receivers import Receivers
from bagpipe_operator.runtime import log, serve
from bagpipe_operator.runtime.census import Census
from bagpipe_operator.runtime.clock import utc_now
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.runtime.work import work
from bagpipe_operator.schedules.fenced import FencedScheduleApi
from bagpipe_operator.schedules.loop import ScheduleLoop
from bagpipe_operator.settings import SettingError, Settings

logger = logging.getLogger("bagpipe_operator")

# How long CRD and rights may come after the operator, as when a chart is applied in one go.
WATCHABLE_SECONDS = 120.0
WATCHABLE_POLL_SECONDS = 2.0

# Python's 700 would look for garbage every few jobs of a cold start, in what is no garbage.
COLLECT_AFTER_ALLOCATIONS = 10_000

PROXY_VARIABLES = ("HTTPS_PROXY", "https_proxy", "HTTP_PROXY", "http_proxy")


def main() -> None:
    """The console script."""
    spare_the_collector()
    try:
        level = os.environ.get("BAGPIPE_LOG_LEVEL", "INFO")
        log.set_up(level, os.environ.get("BAGPIPE_LOG_FORMAT", "text"), sys.stderr)
        settings = Settings.from_environment(os.environ)
        load_installed()
        asyncio.run(run(settings))
    except (SettingError, InstallationError) as error:
        sys.exit(f"bagpipe-operator: {error}")
    except ApiError as error:
        sys.exit(f"bagpipe-operator: the API server can't be used: {error}")


def spare_the_collector() -> None:
    """What was imported stays, and thousands of jobs stay: the collector walks them less often."""
    gc.freeze()
    gc.set_threshold(COLLECT_AFTER_ALLOCATIONS)


async def run(settings: Settings) -> None:
    """Runs the operator until SIGTERM or SIGINT."""
    view, fence = View(), Fence()
    queue = WorkQueue(tenant_of=view.namespace_of, workers=settings.workers)
    metrics = JobMetrics(view, queue, fence.leads)
    large = LargeJobs(view)
    sweeper = Sweeper(view, queue, settings.sweep_seconds, large=large)
    async with AsyncExitStack() as stack:
        client = await stack.enter_async_context(_client())
        api = KubernetesKueueApi(
            client, settings.request_seconds, metrics.api_called, fence.remaining
        )
        session = await stack.enter_async_context(aiohttp.ClientSession())
        drivers = ProgressReader(session, settings.progress_seconds, counted=metrics.driver_asked)
        fenced, workloads = FencedKueueApi(api, fence), Workloads()
        courier = await stack.enter_async_context(
            deliveries(settings, metrics.registry, fence.leads, queue.add, uses_proxy(os.environ))
        )
        monotonic = asyncio.get_running_loop().time
        queueing = Queueing(fenced, workloads, settings, utc_now, monotonic)
        reconciler = Reconciler(
            fenced, view, drivers, settings, utc_now, monotonic, metrics.job_written,
            metrics.status_paced, queueing if settings.kueue else None,
            DriverOffers(session, settings.progress_seconds),
            Announcer(Receivers(settings.receivers), courier),
        )  # fmt: skip
        metrics.progress_wait.set_function(reconciler.progress_wait)
        schedules = ScheduleLoop(FencedScheduleApi(api, fence), metrics, fence.leads)

        def take_up() -> None:
            reconciler.begin_to_lead()
            sweeper.sweep_all()
            schedules.sweep_all()

        terms, where = Terms(new_identity(), settings.lease_seconds), settings.lease_namespace
        election = Election(api, fence, terms, where, settings.lease_name, on_lead=take_up)
        namespaces = settings.watch_namespaces or (None,)
        census = Census(view, queue, api.job_uids, namespaces)
        of_schedules = schedules.census(api.schedule_uids, namespaces)
        metrics.unlisted_namespaces.set_function(
            lambda: len(census.unlisted | of_schedules.unlisted)
        )
        health = serve.Health(sweeper, lease_trouble=election.trouble, list_trouble=census.trouble)
        answers = serve.answers(health, metrics)
        runner = await serve.start(answers, settings.listen_host, settings.listen_port)
        stack.push_async_callback(runner.cleanup)
        census.unlisted = of_schedules.unlisted = await wait_until_watchable(api, settings)

        def look_for_what_went() -> None:
            census.hasten()
            of_schedules.hasten()

        at_work = partial(
            work, reconcile=reconciler.reconcile, metrics=metrics, leads=fence.leads,
            called=view.called,
        )  # fmt: skip
        inquiry = Inquiry(
            drivers, settings.sweep_seconds, view.namespace_of, queue.add, fence.leads
        )
        running = (
            sweeper.run(),
            election.run(),
            census.run(),
            of_schedules.run(),
            inquiry.run(),
            OverduePods(api, view, fence.leads).run(),
            *(at_work(queue, passed_on=large.take) for _ in range(settings.workers)),
            at_work(large.queue),
        )
        handlers = watch.registry(
            watch.Watch(view, queue, metrics), settings.watch_namespaces,
            Relists(look_for_what_went).answered,
        )  # fmt: skip
        if settings.kueue:
            register_workloads(handlers, WorkloadWatch(workloads, queue, metrics))
        tasks = [*map(asyncio.create_task, running), *schedules.start(), *courier.tasks()]
        health.watching = True
        logger.info("watching %s", ", ".join(settings.watch_namespaces) or "all namespaces")
        try:
            await run_together(_watch(schedules.register(handlers), settings), tasks)
        finally:
            await election.release()  # only now: what was under way has ended


async def run_together(
    watches: Coroutine[None, None, None], beside: Sequence[asyncio.Task[None]]
) -> None:
    """Runs until the watches end by a signal; raises what ended them, or a task beside them.

    None of those ends by itself. Without one the operator would look alive and leave out a part.
    """
    tasks = [*beside, asyncio.create_task(watches)]
    try:
        ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in ended:
            task.result()
    finally:
        await _end(tasks)


async def _end(tasks: Sequence[asyncio.Task[None]]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _watch(handlers: kopf.OperatorRegistry, settings: Settings) -> None:
    """Ends by a signal, or raises when the watches can't go on; the pod is then restarted."""
    await kopf.operator(
        registry=handlers,
        clusterwide=not settings.watch_namespaces,
        namespaces=settings.watch_namespaces,
        standalone=True,
    )


@asynccontextmanager
async def _client() -> AsyncIterator[ApiClient]:
    """A client for the pod's own cluster, or for KUBECONFIG outside of one."""
    configuration = Configuration(client_session_kwargs=session_settings(os.environ))
    load: Any = config  # its functions carry no types
    if watch.in_cluster(os.environ):
        load.load_incluster_config(client_configuration=configuration)
    else:
        await load.load_kube_config(client_configuration=configuration)
    async with ApiClient(configuration=configuration) as client:
        yield client


def session_settings(environment: Mapping[str, str]) -> dict[str, Any]:
    """Settings of the HTTP session with the API server.

    aiohttp looks into the environment for a proxy, and into ~/.netrc for a password, in a thread
    of its own and for each request: two thirds of a call's processor time.
    """
    return {"trust_env": uses_proxy(environment)}


def uses_proxy(environment: Mapping[str, str]) -> bool:
    """Whether the environment names a proxy."""
    return any(environment.get(name) for name in PROXY_VARIABLES)


async def wait_until_watchable(
    api: KubernetesKueueApi, settings: Settings
) -> frozenset[str | None]:
    """Returns once jobs, schedules and pods can be listed; raises the last ApiError in the end.

    kopf looks for the resource once, at its start, and would then watch nothing for ever. One
    namespace where it may list is enough to begin: those without rights are returned, and are
    watched as soon as there are some.
    """
    deadline = asyncio.get_running_loop().time() + WATCHABLE_SECONDS
    while True:
        try:
            forbidden = await _forbidden(api, settings)
        except ApiError as error:
            if asyncio.get_running_loop().time() > deadline:
                raise
            logger.warning("what the operator watches can't be watched yet: %s", error)
        else:
            for namespace, refusal in forbidden.items():
                logger.error("namespace %s can't be watched: %s", namespace, refusal)
            return frozenset(forbidden)
        await asyncio.sleep(WATCHABLE_POLL_SECONDS)


async def _forbidden(api: KubernetesKueueApi, settings: Settings) -> Mapping[str | None, ApiError]:
    """The namespaces that the operator has no rights in; raises ApiError where it has none in any,
    or any call fails for another reason."""
    namespaces, refused = settings.watch_namespaces or (None,), dict[str | None, ApiError]()
    for namespace in namespaces:
        try:
            await api.check_watchable(namespace)
            if settings.kueue:
                await api.check_queues(namespace)
        except ApiError as error:
            refused[namespace] = error
            if error.status != 403 or len(refused) == len(namespaces):
                raise
    return refused
