"""The loop's body: look at one job, decide, write its status once, tell what changed.

Level-triggered: it is right whenever and however often it is called.
"""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Protocol

from bagpipe_operator import events, names, reasons
from bagpipe_operator.api import Api, ApiError
from bagpipe_operator.children import Refusal, create_children
from bagpipe_operator.diagnose import troubles
from bagpipe_operator.ending import Ending, ending_of
from bagpipe_operator.job_config import JobTooLargeError, UnusableSpecError, read_spec
from bagpipe_operator.patience import Patience
from bagpipe_operator.progress import Progress
from bagpipe_operator.settings import Settings
from bagpipe_operator.status import Observation, decide
from bagpipe_operator.view import JobView, Json, PodView, View

logger = logging.getLogger(__name__)

# A driver that has been silent for this long is looked for: the watch may have lost its end.
SILENT_DRIVER_SECONDS = 30.0


class Drivers(Protocol):
    """Who asks drivers for their progress."""

    async def read(self, uid: str, ip: str) -> Progress | None:
        """The driver's last account."""

    def silent_seconds(self, uid: str) -> float:
        """How long it has not answered."""

    def forget(self, uid: str) -> None:
        """The job is over."""


def utc_now() -> datetime:
    """The wall clock."""
    return datetime.now(UTC)


@dataclass
class Reconciler:
    """One per operator; knows no job by itself, all is in the view and in the API server."""

    api: Api
    view: View
    drivers: Drivers
    settings: Settings
    now: Callable[[], datetime] = utc_now
    monotonic: Callable[[], float] = lambda: asyncio.get_running_loop().time()
    _patience: Patience = field(default_factory=Patience)
    _missing: Patience = field(default_factory=Patience)

    async def reconcile(self, uid: str) -> None:
        """Brings one job forward; raises ApiError when it should be tried again."""
        job = self.view.job(uid)
        if job is None or job.deleting:
            self._forget(uid)  # its children go by their ownerReferences
            return
        if not job.finished:
            seen = await self._observe(job)
            status = decide(seen, self.now(), self.settings.stuck_seconds)
            job = await self._write(job, status)
        if job is not None and job.finished:
            await self._stop_leftovers(job)
            self._forget(uid)

    async def _observe(self, job: JobView) -> Observation:
        """Everything that the decision needs; creates the children if they were never there."""
        attempt = int(job.status.get("attempt") or 1)
        driver = self.view.driver(job.uid, attempt)
        refusal: Refusal | None = None
        ending: Ending | None = None
        if driver is None and not job.status.get("driver"):
            driver, refusal, ending = await self._start(job, attempt)
        elif driver is None:
            driver, ending = await self._look_for(job, attempt)
        if driver is not None:
            driver = await self._refreshed_if_silent(driver)
            if driver is None:
                ending = _lost(job, names.driver_name(job.name, attempt))
        progress = None
        if driver is not None:
            ending = ending_of(driver)
            if ending is None and driver.phase == "Running" and driver.ip:
                progress = await self.drivers.read(job.uid, driver.ip)
        return self._observation(job, attempt, driver, progress, refusal, ending)

    def _observation(
        self,
        job: JobView,
        attempt: int,
        driver: PodView | None,
        progress: Progress | None,
        refusal: Refusal | None,
        ending: Ending | None,
    ) -> Observation:
        pods = tuple(pod for pod in self.view.pods(job.uid) if pod.attempt == attempt)
        found = tuple(troubles(pods))
        keys = [t.key for t in found] + ([("refused",)] if refusal else [])
        seen_for = self._patience.observe(job.uid, keys, self.monotonic())
        return Observation(
            job=job,
            attempt=attempt,
            driver=driver,
            executors=tuple(pod for pod in pods if pod.role == names.ROLE_EXECUTOR),
            progress=progress,
            refusal=refusal,
            troubles=found,
            seen_for=seen_for,
            refused_for=seen_for.get(("refused",), 0.0),
            ending=ending,
        )

    async def _start(
        self, job: JobView, attempt: int
    ) -> tuple[PodView | None, Refusal | None, Ending | None]:
        """Creates ConfigMap and driver; what can't be run ends the job with a sentence."""
        try:
            made = await create_children(self.api, job, read_spec(job), attempt, self.settings)
        except UnusableSpecError as error:
            return None, None, Ending(False, reasons.SPEC_INVALID, str(error))
        except JobTooLargeError as error:
            return None, None, Ending(False, reasons.JOB_TOO_LARGE, str(error))
        if isinstance(made, Refusal):
            return None, made, None
        self.view.put_pod(made)
        return made, None, None

    async def _look_for(self, job: JobView, attempt: int) -> tuple[PodView | None, Ending | None]:
        """A driver that should be there and is not in sight: wait for the watch, then ask."""
        name = names.driver_name(job.name, attempt)
        missing_for = self._missing.observe(job.uid, [name], self.monotonic())[name]
        if missing_for < self.settings.missing_driver_seconds:
            return None, None
        driver = await self._get_pod(job.namespace, name)
        if driver is None or driver.job_uid != job.uid:
            return None, _lost(job, name)
        self.view.put_pod(driver)
        return driver, None

    async def _refreshed_if_silent(self, driver: PodView) -> PodView | None:
        """The driver as it is now if it has not answered for long; None when it is gone."""
        self._missing.forget(driver.job_uid)
        if driver.ended or self.drivers.silent_seconds(driver.job_uid) < SILENT_DRIVER_SECONDS:
            return driver
        live = await self._get_pod(driver.namespace, driver.name)
        if live is None or live.uid != driver.uid:
            self.view.drop_pod(driver)
            return None
        self.view.put_pod(live)
        return live

    async def _get_pod(self, namespace: str, name: str) -> PodView | None:
        try:
            return PodView.from_object(await self.api.get("pods", namespace, name))
        except ApiError as error:
            if error.status == 404:
                return None
            raise

    async def _write(self, job: JobView, status: Json) -> JobView | None:
        """Writes what changed, then tells it; the job as it is now, None when it is gone."""
        changed = {key: value for key, value in status.items() if job.status.get(key) != value}
        if not changed:
            return job
        # With the version that was decided on, a job that has changed since answers 409.
        patch = {"metadata": {"resourceVersion": job.resource_version}, "status": changed}
        try:
            written = await self.api.patch_status(job.namespace, job.name, patch)
        except ApiError as error:
            if error.status in {404, 409}:
                await self._reread(job)
            if error.status == 404:
                return None
            raise
        now = JobView.from_object(written)
        self.view.put_job(now)
        notes = events.transitions(
            job.status.get("conditions") or [], now.status.get("conditions") or []
        )
        await events.tell(self.api, now, notes, self.now())
        return now

    async def _reread(self, job: JobView) -> None:
        """The watch is behind: takes the job from the API server itself."""
        try:
            live = JobView.from_object(await self.api.get_job(job.namespace, job.name))
        except ApiError as error:
            if error.status != 404:
                raise
            self.view.drop_job(job.uid)
            return
        if live.uid == job.uid:
            self.view.put_job(live)
        else:
            self.view.drop_job(job.uid)

    async def _stop_leftovers(self, job: JobView) -> None:
        """Deletes the pods of an ended job that have not ended themselves.

        The driver first: it owns the executors and would replace them. Pods that have ended stay
        for their logs until the job is deleted.
        """
        pods = [p for p in self.view.pods(job.uid) if not p.ended and not p.deleting]
        for pod in sorted(pods, key=lambda p: p.role != names.ROLE_DRIVER):
            driver = pod.container(names.CONTAINER_DRIVER)
            if driver is not None and driver.exit_code is not None:
                continue  # it is over; its pod's phase follows in a moment
            await self.api.delete_pod(pod.namespace, pod.name, pod.uid)

    def _forget(self, uid: str) -> None:
        self._patience.forget(uid)
        self._missing.forget(uid)
        self.drivers.forget(uid)


def _lost(job: JobView, name: str) -> Ending:
    return Ending(
        False,
        reasons.DRIVER_LOST,
        f"The driver's pod {name} was deleted in namespace {job.namespace} before its job ended. "
        "Create the job again.",
    )
