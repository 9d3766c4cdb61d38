"""Deletes the pods that a job has no use for any more."""

import asyncio
from collections.abc import Callable, Iterable
from datetime import datetime

from bagpipe_operator.api import names
from bagpipe_operator.cluster.client import TIMEOUT, Api, ApiError
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.policies.places import living, needs_stop
from bagpipe_operator.jobs.view import View

# For an executor whose driver has ended or was replaced: whatever it runs counts for nothing. Its
# own grace period is for a case that ends, and a kubelet that can't stop the main container keeps
# the sidecars for all of it.
EXECUTOR_GRACE_SECONDS = 10
# A visit deletes twice at most, of earlier attempts and of this one, and has 60 s for all it does.
MOST_SECONDS = 15.0


class PodRemoval:
    """One per operator; every method raises ApiError."""

    def __init__(self, api: Api, view: View, now: Callable[[], datetime]) -> None:
        self._api = api
        self._view = view
        self._now = now

    async def delete(self, pod: PodView) -> None:
        """Deletes a pod; if it went while the watch was being restarted, no event reports it."""
        grace = None if pod.role == names.ROLE_DRIVER else EXECUTOR_GRACE_SECONDS
        if not await self._api.delete_pod(pod.namespace, pod.name, pod.uid, grace):
            self._view.drop_pod(pod)

    async def of_earlier_attempts(self, job: JobView) -> None:
        """Deletes the executors of drivers that were replaced: their places are needed."""
        attempt = int(job.status.get("attempt") or 1)
        pods = self._view.pods(job.uid)
        earlier = [pod for pod in pods if pod.attempt < attempt]
        await self._delete(pod for pod in earlier if not pod.ended and not pod.deleting)

    def left_of(self, job: JobView) -> list[PodView]:
        """The pods of an ended job that have not ended themselves."""
        return [pod for pod in self._view.pods(job.uid) if not pod.ended and not pod.deleting]

    async def of_leftovers(self, left: list[PodView]) -> None:
        """Deletes what is left of an ended job.

        The driver first: it owns the executors and would replace them. Pods that have ended stay
        for their logs until the job is deleted.
        """
        in_order = sorted(left, key=lambda pod: pod.role != names.ROLE_DRIVER)
        await self._delete(pod for pod in in_order if needs_stop(pod, self._now()))

    async def gracefully(self, job: JobView) -> bool:
        """Deletes the driver, which journals what is done; then what it has left of executors.
        Whether none of them lives any more."""
        alive = living(self._view.pods(job.uid), self._now())
        working = [pod for pod in alive if needs_stop(pod, self._now())]
        drivers = [pod for pod in working if pod.role == names.ROLE_DRIVER]
        await self._delete(pod for pod in drivers or working if not pod.deleting)
        return not alive

    async def _delete(self, pods: Iterable[PodView]) -> None:
        """As many as there is time for: hundreds may take seconds each, and the visit's other work
        must not end with them."""
        try:
            async with asyncio.timeout(MOST_SECONDS):
                for pod in pods:
                    await self.delete(pod)
        except TimeoutError:
            raise ApiError(0, TIMEOUT, "pods are still being deleted") from None
