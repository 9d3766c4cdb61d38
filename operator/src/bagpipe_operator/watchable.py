"""Waits at the start for what is to be watched: CRDs and rights may come after the operator."""

import asyncio
import logging
from collections.abc import Mapping

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.kueue.api import KubernetesKueueApi
from bagpipe_operator.settings import Settings

logger = logging.getLogger("bagpipe_operator")

# How long CRD and rights may come after the operator, as when a chart is applied in one go.
WATCHABLE_SECONDS = 120.0
WATCHABLE_POLL_SECONDS = 2.0


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
