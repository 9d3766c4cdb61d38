"""Asks the API server why a pod waits, where the watched objects do not say it.

Bounded: a pod must have waited for LOOK_AFTER_SECONDS, a job is looked into once in
LOOK_EVERY_SECONDS (more seldom when many jobs of its namespace wait: see fair_share.py), and of its
pods the first MOST_PODS, for MOST_SECONDS in all; many pods of one job wait for one cause.
"""

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from bagpipe.executor_range import wanted
from bagpipe_operator.api import names, readings
from bagpipe_operator.cluster.client import Api, ApiError, get_if_there
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.pods.executor_template import executor_trial
from bagpipe_operator.jobs.pods.job_config import UnusableSpecError, read_spec
from bagpipe_operator.jobs.troubles import pending
from bagpipe_operator.jobs.troubles.trouble import Trouble
from bagpipe_operator.jobs.whole_job import whole
from bagpipe_operator.runtime.fair_share import FairShare
from bagpipe_operator.runtime.patience import Patience
from bagpipe_operator.settings import Settings

logger = logging.getLogger(__name__)

LOOK_AFTER_SECONDS = 2.0
LOOK_EVERY_SECONDS = 4.0
# A visit has 60 s for all it does, and anybody may write hundreds of Events about each claim.
MOST_SECONDS = 15.0
MOST_PODS = 3
# Spark needs some seconds from the first case planned to the first executor asked for.
EXECUTORS_AFTER_SECONDS = 4.0

_EXECUTORS = "executors"


@dataclass
class _Found:
    at: float
    troubles: tuple[Trouble, ...]


@dataclass
class Lookout:
    """Its last finding holds until it looks again, or until no pod waits any more."""

    api: Api
    settings: Settings
    monotonic: Callable[[], float]
    _waiting: Patience = field(default_factory=Patience)
    _found: dict[str, _Found] = field(default_factory=dict)
    _share: FairShare = field(default_factory=lambda: FairShare(LOOK_EVERY_SECONDS))

    async def look(
        self, job: JobView, attempt: int, pods: Sequence[PodView], cases_left: int | None
    ) -> tuple[Trouble, ...]:
        """Troubles of one job's pods; while its driver wants executors, for so many cases.

        A call that fails is logged and finds nothing: the job's status does not depend on it.
        """
        suspects = [p for p in pods if pending.awaits_a_claim(p) or pending.awaits_its_node(p)]
        missing = cases_left is not None and _executors_missing(job, pods, cases_left)
        keys = [p.uid for p in suspects] + ([_EXECUTORS] if missing else [])
        now = self.monotonic()
        waited = self._waiting.observe(job.uid, keys, now)
        suspects = [p for p in suspects if waited[p.uid] >= LOOK_AFTER_SECONDS][:MOST_PODS]
        missing = missing and waited[_EXECUTORS] >= EXECUTORS_AFTER_SECONDS
        if not suspects and not missing:
            self._drop(job.uid)
            return ()
        known = self._found.get(job.uid)
        if known and now - known.at < self._share.seconds(job.namespace):
            return known.troubles
        found: list[Trouble] = []
        try:
            async with asyncio.timeout(MOST_SECONDS):
                for pod in suspects:
                    found += await self._of_pod(pod)
                if missing:
                    found += await self._of_executors(job, attempt, pods)
        except TimeoutError:
            logger.warning("%s/%s: not looked into to the end", job.namespace, job.name)
        self._found[job.uid] = _Found(now, tuple(found))
        self._share.add(job.uid, job.namespace)
        return tuple(found)

    def forget(self, uid: str) -> None:
        """The job is over."""
        self._waiting.forget(uid)
        self._drop(uid)

    def _drop(self, uid: str) -> None:
        self._found.pop(uid, None)
        self._share.remove(uid)

    async def _of_pod(self, pod: PodView) -> list[Trouble]:
        try:
            if pending.awaits_its_node(pod):
                found = pending.of_events(pod, await self.api.events_of(pod.namespace, pod.uid))
                return [found] if found else []
            return [t for claim in pod.claims if (t := await self._of_claim(pod, claim))]
        except ApiError as error:
            logger.warning("%s/%s: not looked into: %s", pod.namespace, pod.name, error)
            return []

    async def _of_claim(self, pod: PodView, claim: str) -> Trouble | None:
        found = await get_if_there(self.api, "persistentvolumeclaims", pod.namespace, claim)
        if found is None:
            return pending.of_claim(pod, claim, None, ())
        if (found.get("status") or {}).get("phase") == "Bound":
            return None
        events = await self.api.events_of(pod.namespace, found["metadata"]["uid"])
        return pending.of_claim(pod, claim, found, events)

    async def _of_executors(
        self, job: JobView, attempt: int, pods: Sequence[PodView]
    ) -> list[Trouble]:
        try:
            job = await whole(self.api, job)
        except ApiError as error:
            logger.warning("%s/%s: not looked into: %s", job.namespace, job.name, error)
            return []
        try:
            spec = read_spec(job)
            await self.api.try_create("pods", executor_trial(job, spec, attempt, self.settings))
        except UnusableSpecError:
            return []  # it is reported where the driver is created
        except ApiError as error:
            if error.webhook_is_awaited:
                return [pending.unanswered_executor(job.name, job.namespace, error.message)]
            alone = not any(p.role == names.ROLE_EXECUTOR for p in pods)
            found = pending.refused_executor(
                job.name, job.namespace, error.status, error.message, alone
            )
            return [found] if found else []
        return []


def _executors_missing(job: JobView, pods: Sequence[PodView], cases_left: int) -> bool:
    """Whether there are fewer than the job wants now: one that went for lack of cases is not."""
    spark = readings.mapping(job.spec.get("spark"))
    bounds = readings.mapping(spark.get("executors"))
    number = readings.whole(spark.get("executors"))
    least = readings.whole(bounds.get("min")) or number or 1
    most = readings.whole(bounds.get("max")) or number or 1
    slots = max(1, readings.whole(spark.get("slots")) or 1)
    alive = [p for p in pods if p.role == names.ROLE_EXECUTOR and not (p.ended or p.deleting)]
    return len(alive) < wanted(least, most, slots, cases_left)
