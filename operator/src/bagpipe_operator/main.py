"""`bagpipe-operator`: reads the settings, starts the parts, runs until a signal."""

import asyncio
import gc
import logging
import os
import sys
from collections.abc import Coroutine, Sequence
from contextlib import AsyncExitStack

import kopf

from bagpipe.installed import InstallationError
from bagpipe.spec import load_installed
from bagpipe_operator.assembly import Jobs, Operator, connections
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.runtime import log, serve
from bagpipe_operator.settings import SettingError, Settings
from bagpipe_operator.watchable import wait_until_watchable

logger = logging.getLogger("bagpipe_operator")

# Python's 700 would look for garbage every few jobs of a cold start, in what is no garbage.
COLLECT_AFTER_ALLOCATIONS = 10_000


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
    jobs = Jobs(settings)
    async with AsyncExitStack() as stack:
        connected = await stack.enter_async_context(connections(settings, jobs))
        operator = Operator(settings, jobs, connected)
        where = (settings.listen_host, settings.listen_port)
        runner = await serve.start(operator.answers(), *where)
        stack.push_async_callback(runner.cleanup)
        operator.note_unlisted(await wait_until_watchable(connected.api, settings))
        watches = _watch(operator.handlers(), settings)
        tasks = operator.start()
        operator.health.watching = True
        logger.info("watching %s", ", ".join(settings.watch_namespaces) or "all namespaces")
        try:
            await run_together(watches, tasks)
        finally:
            await operator.election.release()  # only now: what was under way has ended


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
