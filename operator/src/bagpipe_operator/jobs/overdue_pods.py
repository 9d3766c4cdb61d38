"""Pods of ended jobs that should be gone: their deletion may have fallen between two watches."""

from collections.abc import Callable

from bagpipe_operator.jobs.driver.lookup import DriverLookup
from bagpipe_operator.jobs.pod_removal import PodRemoval
from bagpipe_operator.jobs.view import JobView

# Less than the sweeper's minute: whatever else asks for a visit asks for no more calls than that.
LOOK_EVERY_SECONDS = 50.0


class OverduePods:
    """One per operator. A node that is cut off has them for hours, thousands maybe."""

    def __init__(
        self, lookup: DriverLookup, removal: PodRemoval, monotonic: Callable[[], float]
    ) -> None:
        self._lookup = lookup
        self._removal = removal
        self._monotonic = monotonic
        self._looked: dict[str, float] = {}  # when, by the job

    async def look(self, job: JobView) -> None:
        """Asks for those of an ended job, if that is not just over. Raises ApiError."""
        pods = self._removal.overdue_of(job)
        if not pods:
            self.forget(job.uid)
            return
        now = self._monotonic()
        if abs(now - self._looked.get(job.uid, float("-inf"))) < LOOK_EVERY_SECONDS:
            return
        self._looked[job.uid] = now
        for pod in pods:
            await self._lookup.refreshed(pod)

    def forget(self, uid: str) -> None:
        """The job has none, or is gone."""
        self._looked.pop(uid, None)
