"""A job's place in its Kueue queue: asked for, waited for, and given back.

Level-triggered as the reconciler that asks: each question is answered from the Workload as it was
last seen, and the watch may have lost a change, so it is asked for again from time to time.
"""

from collections.abc import Callable
from datetime import datetime
from typing import Protocol

from bagpipe.spec import SimulationJobSpec
from bagpipe_operator.api import conditions, readings, reasons
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import Api, ApiError
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.kueue import placement, workload, workload_view
from bagpipe_operator.jobs.kueue.workload_view import Workloads, WorkloadView
from bagpipe_operator.jobs.observation import Halt
from bagpipe_operator.jobs.pods.job_config import UnusableSpecError
from bagpipe_operator.jobs.pods.refusal import Refusal
from bagpipe_operator.jobs.specs import Specs
from bagpipe_operator.jobs.whole_job import whole
from bagpipe_operator.runtime.fair_share import FairShare
from bagpipe_operator.settings import Settings

LOOK_EVERY_SECONDS = 30.0


class KueueApi(Api, Protocol):
    """What queues need of an API server; every method raises ApiError."""

    async def create_workload(self, manifest: Json) -> Json:
        """Creates a Workload in its namespace."""

    async def get_workload(self, namespace: str, name: str) -> Json:
        """One Workload."""

    async def patch_workload_status(self, namespace: str, name: str, patch: Json) -> Json:
        """Merges into a Workload's status; the Workload as it is afterwards."""

    async def delete_workload(self, namespace: str, name: str, uid: str) -> None:
        """Deletes a Workload if it still is the one with that UID; gone is no error."""

    async def get_resource_flavor(self, name: str) -> Json:
        """One ResourceFlavor."""

    async def get_priority_class(self, group: str, name: str) -> Json:
        """One WorkloadPriorityClass, or PriorityClass, by the group that it is of."""


class Queueing:
    """The queues of all jobs; knows of each no more than its Workload and when it was asked for."""

    def __init__(
        self,
        api: KueueApi,
        workloads: Workloads,
        settings: Settings,
        now: Callable[[], datetime],
        monotonic: Callable[[], float],
    ) -> None:
        self._api = api
        self._workloads = workloads
        self._settings = settings
        self._now = now
        self._monotonic = monotonic
        self.begin_to_lead()

    def begin_to_lead(self) -> None:
        """Forgets what was asked when this replica led before: another may have led since."""
        self._specs = Specs(self._api)
        self._share = FairShare(LOOK_EVERY_SECONDS)
        self._asked: dict[str, float] = {}
        self._fitting: dict[str, int] = {}  # generations of jobs that their Workloads fit
        # Jobs without a Workload; None where a driver's creation shows what is wrong
        self._refused: dict[str, Halt | None] = {}

    async def halt(self, job: JobView) -> Halt | None:
        """Why a job may have no pods at present; None when its queue has admitted it."""
        queue = job.spec.get("queueName")
        if not queue:
            return None
        if self._is_due(job):
            self._asked[job.uid] = self._monotonic()
            await self._ask(job)
        if job.uid in self._refused:
            return self._refused[job.uid]
        seen = self._of(job)
        if seen is None or not seen.admitted:
            message = f"The job is put into the queue {queue} of Kueue."
            return Halt(
                reasons.QUEUED, message if seen is None else workload.waits_for(seen, queue)
            )
        return None

    async def placed(self, job: JobView, spec: SimulationJobSpec) -> SimulationJobSpec | Refusal:
        """The entire job's spec with its pods where its queue wants them.

        Looks once more: the watch may be behind, and who suspends a job, edits it and resumes it
        before its pods are gone has left its Workload as it was.
        Refused where a flavor can't be read. Raises ApiError, and UnusableSpecError for a flavor
        that no pod can have.
        """
        if not spec.queue_name:
            return spec
        await self._look(job)
        seen = self._of(job)
        if seen is not None and seen.made_of != workload.made_of(job):
            await self._replace(seen)
            raise ApiError(409, "Conflict", "the job was edited: it is put into its queue again")
        if seen is None or not seen.admitted:
            raise ApiError(409, "Conflict", "the queue has taken its admission back just now")
        flavors = {}
        for name in placement.flavors_of(seen):
            try:
                flavor = await self._api.get_resource_flavor(name)
            except ApiError as error:
                if error.status not in {403, 404}:
                    raise
                return _unread(name, error)
            flavors[name] = readings.mapping(flavor.get("spec"))
        try:
            return placement.placed(spec, seen, flavors)
        except ValueError as error:
            raise UnusableSpecError(f"its queue's flavors can't be used: {error}") from None

    async def settle(self, job: JobView) -> None:
        """Reports to Kueue what has become of a job: its status states it already."""
        if job.finished or (job.suspended and job.spec.get("suspend")):
            self.forget(job.uid)
        seen = self._of(job)
        if seen is None or seen.deleting:
            return
        over = seen.holds(workload_view.FINISHED)
        if job.finished:
            if not over:
                await self._report(seen, workload.finished(seen, job, self._now()))
        elif job.suspended and (over or job.spec.get("suspend")):
            await self._replace(seen)
        elif job.suspended and workload.must_be_released(seen):
            await self._report(seen, workload.released(seen, self._now()))
        elif seen.admitted and _runs(job) and not seen.holds(workload_view.PODS_READY):
            await self._report(seen, workload.ready(seen, self._now()))

    def gone(self, uid: str) -> None:
        """There is no such job any more; its Workload may have gone without a word, too."""
        self.forget(uid)
        self._workloads.forget(uid)

    def forget(self, uid: str) -> None:
        """The job is over, or waits for nothing."""
        self._specs.forget(uid)
        self._asked.pop(uid, None)
        self._fitting.pop(uid, None)
        self._refused.pop(uid, None)
        self._share.remove(uid)

    def _of(self, job: JobView) -> WorkloadView | None:
        """The job's own Workload as it was last seen."""
        seen = self._workloads.find(job.namespace, workload.name_of(job))
        return seen if seen is not None and seen.owner_uid == job.uid else None

    def _is_due(self, job: JobView) -> bool:
        self._share.add(job.uid, job.namespace)
        asked = self._asked.get(job.uid)
        if asked is None or (self._of(job) is None and job.uid not in self._refused):
            return True
        return self._monotonic() - asked >= self._share.seconds(job.namespace)

    async def _ask(self, job: JobView) -> None:
        """Looks at the job's Workload, and creates it if it is not there."""
        self._refused.pop(job.uid, None)
        if not await self._look(job):
            await self._create(job)
            return
        seen = self._of(job)
        if seen is None:
            name = workload.name_of(job)
            self._refuse(job, f"Workload {name} exists and is not of this job: delete it.")
        elif not seen.holds(workload_view.QUOTA_RESERVED) and not await self._fits(job, seen):
            await self._replace(seen)

    async def _look(self, job: JobView) -> bool:
        """Whether there is a Workload of the job's name, which the view has as it is now."""
        name = workload.name_of(job)
        try:
            found = await self._api.get_workload(job.namespace, name)
        except ApiError as error:
            if not error.is_gone(name):
                raise
            known = self._workloads.find(job.namespace, name)
            if known is not None:
                self._workloads.drop(known)
            return False
        self._workloads.put(WorkloadView.from_object(found))
        return True

    async def _fits(self, job: JobView, seen: WorkloadView) -> bool:
        """Whether a Workload that was just read is of the job's sizes; asked once for each edit."""
        if self._fitting.get(job.uid) != job.generation:
            if seen.made_of != workload.made_of(await whole(self._api, job)):
                return False
            self._fitting[job.uid] = job.generation
        return True

    async def _replace(self, seen: WorkloadView) -> None:
        """Deletes a job's Workload: another is made when the job may have pods again."""
        await self._api.delete_workload(seen.namespace, seen.name, seen.uid)
        self._workloads.drop(seen)
        self.forget(seen.owner_uid)

    async def _create(self, job: JobView) -> None:
        try:
            entire, spec = await self._specs.read(job)
        except UnusableSpecError:
            self._refused[job.uid] = None
            return
        try:
            priority = await self._priority(entire, spec)
            made = await self._api.create_workload(
                workload.manifest(entire, spec, self._settings, priority)
            )
        except ApiError as error:
            # A webhook that hangs may have been waited for in vain: the next visit looks first.
            refused = error.refuses_for_good or error.status == 404 or error.admission_denies
            if refused or error.webhook_is_awaited:
                self._refuse(job, f"Its Workload can't be created: {error.message}")
            else:
                raise
        else:
            self._workloads.put(WorkloadView.from_object(made))

    async def _priority(self, job: JobView, spec: SimulationJobSpec) -> Json | None:
        """The fields of a Workload that say how important it is."""
        name = job.marks["labels"].get(workload.LABEL_PRIORITY_CLASS)
        group, kind = workload.GROUP, "WorkloadPriorityClass"
        if name is None:
            name = spec.spark.driver.pod.priority_class_name
            group, kind = "scheduling.k8s.io", "PriorityClass"
        if not name:
            return None
        found = await self._api.get_priority_class(group, name)
        return {
            "priorityClassRef": {"group": group, "kind": kind, "name": name},
            "priority": found.get("value", 0),
        }

    def _refuse(self, job: JobView, message: str) -> None:
        self._refused[job.uid] = Halt(reasons.QUEUE_REFUSED, message)

    async def _report(self, seen: WorkloadView, status: Json) -> None:
        patch = {"metadata": {"resourceVersion": seen.resource_version}, "status": status}
        try:
            written = await self._api.patch_workload_status(seen.namespace, seen.name, patch)
        except ApiError as error:
            if error.is_gone(seen.name):
                self._workloads.drop(seen)
            elif error.status == 409:
                found = await self._api.get_workload(seen.namespace, seen.name)
                self._workloads.put(WorkloadView.from_object(found))
            raise
        self._workloads.put(WorkloadView.from_object(written))


def _unread(flavor: str, error: ApiError) -> Refusal:
    message = (
        f"ResourceFlavor {flavor}, which the job was admitted to, can't be read: {error.message}. "
        "The job starts as soon as it can."
    )
    return Refusal(reasons.QUEUE_REFUSED, message, lasting=False)


def _runs(job: JobView) -> bool:
    running = conditions.find(job.status.get("conditions") or [], conditions.RUNNING)
    return running is not None and running["status"] == "True"
