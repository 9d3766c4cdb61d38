"""Starts a job's driver: its ConfigMap and its pod, or why there are none."""

from collections.abc import Callable
from dataclasses import dataclass, field

from bagpipe.spec import SimulationJobSpec
from bagpipe_operator.api import names, reasons
from bagpipe_operator.cluster.client import Api, ApiError
from bagpipe_operator.jobs.driver.ending import Ending, refused
from bagpipe_operator.jobs.driver.lookup import DriverLookup
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.kueue.queueing import Queueing
from bagpipe_operator.jobs.pod_removal import PodRemoval
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.pods.children import create_children
from bagpipe_operator.jobs.pods.job_config import JobTooLargeError, UnusableSpecError
from bagpipe_operator.jobs.pods.refusal import Refusal
from bagpipe_operator.jobs.specs import Specs
from bagpipe_operator.jobs.status_writer import StatusWriter
from bagpipe_operator.jobs.troubles.refusals import Refusals
from bagpipe_operator.jobs.view import View
from bagpipe_operator.jobs.warm_start import WarmStarts
from bagpipe_operator.settings import Settings


@dataclass
class DriverStart:
    """One per operator; every method that asks raises ApiError."""

    api: Api
    view: View
    settings: Settings
    monotonic: Callable[[], float]
    queueing: Queueing | None
    warm: WarmStarts
    lookup: DriverLookup
    writer: StatusWriter
    removal: PodRemoval
    specs: Specs
    _refusals: Refusals = field(init=False)

    def __post_init__(self) -> None:
        self._refusals = Refusals(self.settings.stuck_seconds, self.monotonic)

    async def start(
        self, job: JobView, attempt: int
    ) -> tuple[PodView | None, Refusal | None, Ending | None]:
        """Creates ConfigMap and driver; what can't be run ends the job with a sentence."""
        standing = self._refusals.standing(job, attempt)
        if standing is not None:
            return None, standing, None
        again = self._refusals.asked(job.uid)
        await self._stop_driver_before(job, attempt)
        try:
            entire, spec = await self.read(job)
            placed = await self._place(entire, spec)
            made = (
                placed
                if isinstance(placed, Refusal)
                else await self._create(entire, placed, attempt, again)
            )
        except UnusableSpecError as error:
            return None, None, refused(reasons.SPEC_INVALID, error)
        except JobTooLargeError as error:
            return None, None, refused(reasons.JOB_TOO_LARGE, error)
        if isinstance(made, Refusal):
            self._refusals.keep(job, attempt, made)
            return None, made, None
        self._refusals.forget(job.uid)
        self.view.put_pod(made)
        return made, None, None

    async def read(self, job: JobView) -> tuple[JobView, SimulationJobSpec]:
        """The job with all of its spec, of which the view may have but a part, and that spec read.

        Raises UnusableSpecError.
        """
        try:
            return await self.specs.read(job)
        except ApiError as error:
            if error.status == 404:
                await self.writer.reread(job)
            raise

    def forget(self, uid: str) -> None:
        """Of a job that has ended, rests or is gone nothing is kept."""
        self._refusals.forget(uid)

    async def _create(
        self, entire: JobView, spec: SimulationJobSpec, attempt: int, again: bool
    ) -> PodView | Refusal:
        shape = self.warm.shape_to_keep(entire, spec)
        return await create_children(self.api, entire, spec, attempt, self.settings, again, shape)

    async def _place(self, entire: JobView, spec: SimulationJobSpec) -> SimulationJobSpec | Refusal:
        """The job's spec, with its pods where its queue wants them if it has one."""
        return spec if self.queueing is None else await self.queueing.placed(entire, spec)

    async def _stop_driver_before(self, job: JobView, attempt: int) -> None:
        """Deletes the driver that is replaced; a new operator's watch may not have brought it."""
        if attempt == 1 or self.view.driver(job.uid, attempt - 1) is not None:
            return
        pod = await self.lookup.pod(job.namespace, names.driver_name(job.name, attempt - 1))
        if pod is not None and pod.job_uid == job.uid and not (pod.ended or pod.deleting):
            await self.removal.delete(pod)
