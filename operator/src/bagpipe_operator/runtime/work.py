"""The workers between the queue and the reconciler: deadlines, retries, and counting."""

import asyncio
import logging
from collections.abc import Awaitable, Callable

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.fence import NotLeadingError
from bagpipe_operator.runtime.log import about
from bagpipe_operator.runtime.metrics import Metrics
from bagpipe_operator.runtime.queue import WorkQueue

logger = logging.getLogger(__name__)

# A reconcile is a handful of calls with a deadline each; this one is for what nobody thought of.
RECONCILE_SECONDS = 60.0


async def work(
    queue: WorkQueue,
    reconcile: Callable[[str], Awaitable[None]],
    metrics: Metrics,
    leads: Callable[[], bool] = lambda: True,
    called: Callable[[str], tuple[str, str]] = lambda _: ("", ""),
    kind: str = "job",
    passed_on: Callable[[str], bool] = lambda _: False,
) -> None:
    """Reconciles keys until cancelled. A fault costs its own key a delay and no other anything.

    `called` gives the namespace and name of a key, which is a UID, for the log; `passed_on` says
    that another queue has taken a key.

    Without leadership keys are dropped: a new leader asks for all jobs again. A write that the
    fence stopped although the lead has been renewed since is a fault like any other.
    """
    while True:
        key = await queue.get()
        if not leads() or passed_on(key):
            queue.done(key)
            continue
        namespace, name = called(key)
        with about(kind, namespace, name):
            what = f"{kind} {namespace}/{name}" if name else f"{kind} {key}"
            await _work_on(key, queue, reconcile, metrics, leads, what)


async def _work_on(
    key: str,
    queue: WorkQueue,
    reconcile: Callable[[str], Awaitable[None]],
    metrics: Metrics,
    leads: Callable[[], bool],
    what: str,
) -> None:
    try:
        with metrics.reconcile_seconds.time():
            async with asyncio.timeout(RECONCILE_SECONDS):
                await reconcile(key)
    except asyncio.CancelledError:
        queue.done(key)
        raise
    except (ApiError, TimeoutError) as error:
        if isinstance(error, NotLeadingError) and not leads():
            queue.done(key)
            metrics.reconciles.labels(result="fenced").inc()
            return
        delay = queue.retry(key)
        metrics.reconciles.labels(result="retried").inc()
        logger.warning("%s: %s; tried again in %.1f s", what, error, delay)
    except Exception:
        # A bug met with one job must not stop the others; it is logged with its traceback.
        delay = queue.retry(key)
        metrics.reconciles.labels(result="faulted").inc()
        logger.exception("%s: unexpected fault; tried again in %.1f s", what, delay)
    else:
        queue.done(key)
        metrics.reconciled(key)
