"""`bagpipe-operator`: reads the settings, wires the parts, runs until a signal."""

import asyncio
import logging
import os
import sys
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

import aiohttp
import kopf
from kubernetes.aio import config
from kubernetes.aio.client import ApiClient, Configuration

from bagpipe_operator import serve, watch
from bagpipe_operator.api import ApiError, KubernetesApi
from bagpipe_operator.metrics import Metrics
from bagpipe_operator.progress import ProgressReader
from bagpipe_operator.queue import WorkQueue
from bagpipe_operator.reconcile import Reconciler
from bagpipe_operator.settings import SettingError, Settings
from bagpipe_operator.sweep import Sweeper
from bagpipe_operator.view import View
from bagpipe_operator.work import work

logger = logging.getLogger("bagpipe_operator")

# How long CRD and rights may come after the operator, as when a chart is applied in one go.
WATCHABLE_SECONDS = 120.0
WATCHABLE_POLL_SECONDS = 2.0


def main() -> None:
    """The console script."""
    logging.basicConfig(
        level=os.environ.get("BAGPIPE_LOG_LEVEL", "INFO").upper(),
        format="%(asctime)s %(levelname)s %(name)s: %(message)s",
        stream=sys.stderr,
    )
    logging.getLogger("kopf").setLevel(logging.WARNING)
    try:
        settings = Settings.from_environment(os.environ)
        asyncio.run(run(settings))
    except SettingError as error:
        sys.exit(f"bagpipe-operator: {error}")
    except ApiError as error:
        sys.exit(f"bagpipe-operator: the API server can't be used: {error}")


async def run(settings: Settings) -> None:
    """Runs the operator until SIGTERM or SIGINT."""
    view, queue = View(), WorkQueue()
    metrics = Metrics(view, queue)
    sweeper = Sweeper(view, queue, settings.sweep_seconds)
    health = serve.Health(sweeper)
    async with AsyncExitStack() as stack:
        api = KubernetesApi(await stack.enter_async_context(_client()), settings.request_seconds)
        session = await stack.enter_async_context(aiohttp.ClientSession())
        application = serve.application(health, metrics)
        runner = await serve.start(application, settings.listen_host, settings.listen_port)
        stack.push_async_callback(runner.cleanup)
        await wait_until_watchable(api, settings)

        drivers = ProgressReader(session, settings.progress_seconds)
        reconciler = Reconciler(api, view, drivers, settings)
        tasks = [asyncio.create_task(sweeper.run(), name="sweeper")]
        tasks += [
            asyncio.create_task(work(queue, reconciler.reconcile, metrics), name=f"worker-{n}")
            for n in range(settings.workers)
        ]
        health.watching = True
        logger.info("watching %s", ", ".join(settings.watch_namespaces) or "all namespaces")
        try:
            # Ends by a signal, or raises when the watches can't go on; the pod is then restarted.
            await kopf.operator(
                registry=watch.registry(watch.Watch(view, queue, metrics)),
                clusterwide=not settings.watch_namespaces,
                namespaces=settings.watch_namespaces,
                standalone=True,
            )
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)


@asynccontextmanager
async def _client() -> AsyncIterator[ApiClient]:
    """A client for the pod's own cluster, or for KUBECONFIG outside of one."""
    configuration = Configuration()
    load: Any = config  # its functions carry no types
    if watch.in_cluster(os.environ):
        load.load_incluster_config(client_configuration=configuration)
    else:
        await load.load_kube_config(client_configuration=configuration)
    async with ApiClient(configuration=configuration) as client:
        yield client


async def wait_until_watchable(api: KubernetesApi, settings: Settings) -> None:
    """Returns once SimulationJobs and pods can be listed; raises the last ApiError in the end.

    kopf looks for the resource once, at its start, and would then watch nothing for ever; and it
    goes on without a word where it lacks the right to watch.
    """
    deadline = asyncio.get_running_loop().time() + WATCHABLE_SECONDS
    while True:
        try:
            for namespace in settings.watch_namespaces or (None,):
                await api.check_watchable(namespace)
        except ApiError as error:
            if asyncio.get_running_loop().time() > deadline:
                raise
            logger.warning("SimulationJobs can't be watched yet: %s", error)
        else:
            return
        await asyncio.sleep(WATCHABLE_POLL_SECONDS)
