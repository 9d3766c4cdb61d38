"""Pods of ended jobs that should be gone: their deletion may have fallen between two watches.

A node that is cut off has them for hours, as has whoever keeps them by finalizers: thousands maybe.
So no visit of a job waits for these questions, and all together are as many as fair_share.py has.
"""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime

from bagpipe_operator.cluster.client import ApiError, Objects, get_if_there
from bagpipe_operator.jobs.driver.ending import overdue
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.clock import utc_now
from bagpipe_operator.runtime.fair_share import MOST_LOOKS_PER_SECOND

logger = logging.getLogger(__name__)

PERIOD_SECONDS = 60.0
_MOST_IN_A_ROUND = int(PERIOD_SECONDS * MOST_LOOKS_PER_SECOND)


@dataclass
class OverduePods:
    """One per operator: asks for each once in PERIOD_SECONDS, or for as many as it may.

    Each namespace has the same part of a round, and goes on where its last one has ended.
    """

    api: Objects
    view: View
    leads: Callable[[], bool] = lambda: True
    now: Callable[[], datetime] = utc_now
    _last: dict[str, str] = field(default_factory=dict)  # the last pod's name, by namespace

    async def run(self) -> None:
        """Asks until cancelled."""
        while True:
            await asyncio.sleep(PERIOD_SECONDS)
            try:
                if self.leads():
                    await self._round()
            except Exception:
                # A bug met here must not keep what goes later for ever.
                logger.exception("unexpected fault in looking for pods that should be gone")

    async def _round(self) -> None:
        late = self._late()
        self._last = {namespace: self._last.get(namespace, "") for namespace in late}
        for namespace, pods in late.items():
            in_turn = _from(self._last[namespace], pods)
            for pod in in_turn[: max(1, _MOST_IN_A_ROUND // len(late))]:
                self._last[namespace] = pod.name
                try:
                    await self._look(pod)
                except ApiError as error:
                    logger.warning("%s/%s is looked for later: %s", namespace, pod.name, error)
                    break
                await asyncio.sleep(1 / MOST_LOOKS_PER_SECOND)

    def _late(self) -> dict[str, list[PodView]]:
        """Such pods, by namespace."""
        now, late = self.now(), dict[str, list[PodView]]()
        ended = (job.uid for job in self.view.jobs() if job.finished)
        for pod in (pod for uid in ended for pod in self.view.pods(uid)):
            if overdue(pod, now):
                late.setdefault(pod.namespace, []).append(pod)
        return late

    async def _look(self, pod: PodView) -> None:
        found = await get_if_there(self.api, "pods", pod.namespace, pod.name)
        if found is None or found["metadata"]["uid"] != pod.uid:
            self.view.drop_pod(pod)


def _from(last: str, pods: list[PodView]) -> list[PodView]:
    """By name, those after the last one first."""
    return sorted(pods, key=lambda pod: (pod.name <= last, pod.name))
