"""Jobs of pools: each is handed to a driver that waits, or has pods of its own that wait later.

Level-triggered as the reconciler that asks; what decides is in pools/.
"""

import hashlib
import json
import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Protocol

from bagpipe.spec import SimulationJobSpec, evaluator_config_maps
from bagpipe_operator.api import readings
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import Api, get_if_there
from bagpipe_operator.jobs.claim import COLD, Claim, claim_of, taken
from bagpipe_operator.jobs.driver.ending import overdue
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.pods.children import check_allowed
from bagpipe_operator.jobs.pods.job_config import (
    LARGEST_CONFIG_BYTES,
    UnusableSpecError,
    job_file,
)
from bagpipe_operator.jobs.policies.places import over
from bagpipe_operator.jobs.pools.crowds import Crowds
from bagpipe_operator.jobs.pools.handover import Received, step
from bagpipe_operator.jobs.pools.shape import shape_of
from bagpipe_operator.jobs.pools.standing import drivers_of_pools, standing_driver
from bagpipe_operator.jobs.pools.warm import (
    Cold,
    Pooling,
    Wish,
    chosen,
    forbidden,
    leaving,
)
from bagpipe_operator.jobs.specs import Specs
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.patience import Patience
from bagpipe_operator.settings import Settings

logger = logging.getLogger(__name__)

# A driver that waits and has not answered for this long is ended when it is its turn.
SILENT_SECONDS = 30.0


class Offers(Protocol):
    """Who hands jobs to drivers."""

    async def offer(self, ip: str, description: bytes) -> Received:
        """What the driver at that address answers to a job.json."""


class Working(Protocol):
    """Who asks drivers whether they have a job."""

    async def works(self, ip: str) -> bool | None:
        """Whether the driver at that address has a job, whichever; None where none answers."""


class NoOffers:
    """Where nobody hands jobs over, no driver answers."""

    async def offer(self, ip: str, description: bytes) -> Received:  # noqa: ARG002
        """Silence."""
        return "silent"


def pool_of(job: JobView) -> str:
    """The pool that a job names; empty for none."""
    return str(readings.mapping(job.spec.get("spark")).get("pool") or "")


@dataclass
class WarmStarts:
    """One per operator."""

    api: Api
    view: View
    offers: Offers
    drivers: Working
    settings: Settings
    now: Callable[[], datetime]
    monotonic: Callable[[], float]
    specs: Specs
    _crowds: Crowds = field(init=False)
    # The drivers' pods that jobs are about to claim, by the jobs' UIDs.
    _chosen: dict[str, str] = field(default_factory=dict)
    # The drivers that don't answer, by the jobs whose pods they are.
    _silent: Patience = field(default_factory=Patience)

    def __post_init__(self) -> None:
        self._crowds = Crowds(self.pooling.idle_seconds)

    @property
    def pooling(self) -> Pooling:
        """What the administrator lets drivers do."""
        settings = self.settings
        return Pooling(settings.pools, settings.pool_idle_seconds, settings.pools_per_namespace)

    async def next_status(self, job: JobView, halted: bool) -> Json | None:
        """What status.pool of a job without a driver is to say next; None where nothing is asked.

        Raises ApiError.
        """
        pool = pool_of(job)
        if not pool or int(job.status.get("attempt") or 1) != 1:
            return None
        claim = claim_of(job.status)
        self._chosen.pop(job.uid, None)
        if claim is not None:
            return None if claim.state == "Taken" else await self._go_on(job, pool, claim, halted)
        decided = readings.mapping(job.status.get("pool")).get("state") == COLD
        return None if decided or halted or job.suspended else await self._begin(job, pool)

    async def _begin(self, job: JobView, pool: str) -> Json | None:
        """A driver that waits, or why the job has pods of its own."""
        try:
            entire, spec = await self.specs.read(job)
            check_allowed(spec, self.settings)
        except UnusableSpecError:
            return None  # the job ends, with its sentence, when its pods are to be made
        taken_soon = set(self._chosen.values())
        waiting = drivers_of_pools(self.view, job.namespace)
        drivers = [d for d in waiting if d.uid not in taken_soon]
        found = chosen(self._wish(entire, spec, pool), drivers, self.pooling, self.now())
        if isinstance(found, Cold):
            return _cold(pool, found)
        pod = next((pod for pod in self.view.all_pods() if pod.uid == found.uid), None)
        description = self._description(entire, spec)
        if pod is None or len(description) > LARGEST_CONFIG_BYTES:
            return _cold(pool, Cold("NoneWaits", f"No driver of pool {pool} can take the job."))
        self._chosen[job.uid] = pod.uid
        claim = Claim(
            pod.uid, self.now(), "Offered", pod.name, pod.job, pod.job_uid, pod.attempt,
            hashlib.sha256(description).hexdigest(),
        )  # fmt: skip
        return claim.as_status(pool)

    async def _go_on(self, job: JobView, pool: str, claim: Claim, halted: bool) -> Json:
        received = await self._received(job, claim, halted)
        following = step(claim, received, self.now())
        if halted and following.act == "offer":
            # Nobody may run it now, and a driver that has not answered may have taken it.
            return replace(claim, state="Fenced").as_status(pool)
        if following.claim is not None:
            return following.claim.as_status(pool)
        message = f"Driver {claim.pod}, which waited in pool {pool}, could not take the job."
        return _cold(pool, Cold("DriverGone" if received == "gone" else "DriverRefused", message))

    async def _received(self, job: JobView, claim: Claim, halted: bool) -> Received:
        """What the driver answers, or that it can't have the job: its pod is gone."""
        pod = await self._pod(job.namespace, claim)
        if pod is None or pod.ended or over(pod) or overdue(pod, self.now()):
            return "gone"
        if self._is_anothers(job, claim):
            return "refused"
        if claim.state == "Fenced":
            if not pod.deleting:
                await self.api.delete_pod(pod.namespace, pod.name, pod.uid)
            return "silent"
        if halted or pod.deleting:
            return "silent"
        try:
            entire, spec = await self.specs.read(job)
            check_allowed(spec, self.settings)
        except UnusableSpecError:
            return "silent"  # nobody may run it any more, and the driver may have taken it
        return await self.offers.offer(pod.ip, self._description(entire, spec))

    def _is_anothers(self, job: JobView, claim: Claim) -> bool:
        """Whether another job, which claimed the driver as well, has got it."""
        pooled = self.view.pooled(job.namespace)
        others = (each for each in pooled if not each.finished and each.uid != job.uid)
        held = (taken(each.status) for each in others)
        return any(one is not None and one.driver == claim.driver for one in held)

    async def _pod(self, namespace: str, claim: Claim) -> PodView | None:
        found = await get_if_there(self.api, "pods", namespace, claim.pod)
        pod = PodView.from_object(found) if found is not None else None
        return pod if pod is not None and pod.uid == claim.driver else None

    def _description(self, entire: JobView, spec: SimulationJobSpec) -> bytes:
        return json.dumps(job_file(entire, spec, 1, self.settings), sort_keys=True).encode()

    def _wish(self, entire: JobView, spec: SimulationJobSpec, pool: str) -> Wish:
        shape = shape_of(entire, spec, self.settings)
        own = bool(evaluator_config_maps(spec))
        queue = spec.queue_name or ""
        return Wish(entire.namespace, pool, shape.digest, shape.pulls, queue, own)

    def shape_to_keep(self, entire: JobView, spec: SimulationJobSpec) -> str:
        """The shape of pods that wait after the job; empty where they don't."""
        if not spec.spark.pool:
            return ""
        wish = self._wish(entire, spec, spec.spark.pool)
        return "" if forbidden(wish, self.pooling) else wish.shape

    def note_room(self, job: JobView, in_quota: bool, on_nodes: bool) -> None:
        """Whether a job waits for room, and where: drivers that wait for a job give theirs."""
        if in_quota or on_nodes:
            self._crowds.note(job.uid, job.namespace, on_nodes, self.now())
        else:
            self._crowds.forget(job.uid)

    def forget(self, uid: str) -> None:
        """A job has ended, or is gone."""
        self._crowds.forget(uid)
        self._chosen.pop(uid, None)

    def forget_driver(self, uid: str) -> None:
        """A job has no pods any more, or is gone."""
        self._silent.forget(uid)

    async def keeps(self, job: JobView) -> bool:
        """Whether the pods of a job that has ended stay, for another job or because they have one.

        Those that wait go when they have waited for too long, are too many, or others need room.
        """
        if not job.status.get("pool"):
            return False
        pod = standing_driver(self.view, job)
        if pod is None:
            self._silent.forget(job.uid)
            return await self._has_unlisted_driver(job)
        drivers = drivers_of_pools(self.view, job.namespace)
        found = next((driver for driver in drivers if driver.uid == pod.uid), None)
        if found is None:
            return False
        leave = leaving(drivers, self._crowds.now(), self.pooling, self.now())
        why = next((why for driver, why in leave if driver.uid == pod.uid), None)
        if why is None:
            self._silent.forget(job.uid)  # it is not asked, and might answer
            return True
        if await self._may_work(job, pod):
            return True
        logger.info("%s/%s waits no longer: %s", pod.namespace, pod.name, why)
        return False

    async def _has_unlisted_driver(self, job: JobView) -> bool:
        """Whether only the executors are in the view yet, as when an operator starts."""
        name = str(job.status.get("driver") or "")
        found = await get_if_there(self.api, "pods", job.namespace, name) if name else None
        pod = PodView.from_object(found) if found is not None else None
        if pod is None or pod.ended or over(pod) or pod.deleting:
            return False
        known = self.view.driver(pod.job_uid, pod.attempt)
        return known is None or known.uid != pod.uid

    async def _may_work(self, job: JobView, pod: PodView) -> bool:
        """Whether a driver has a job that is not in the view, as when an operator starts.

        One that is silent is waited for as long as it may take to bring all jobs into the view.
        """
        works = await self.drivers.works(pod.ip)
        silent = [pod.uid] if works is None else []
        seconds = self._silent.observe(job.uid, silent, self.monotonic())
        return bool(works) or any(waited < SILENT_SECONDS for waited in seconds.values())


def _cold(pool: str, why: Cold) -> Json:
    return {"name": pool, "state": COLD, "reason": why.reason, "message": why.message}
