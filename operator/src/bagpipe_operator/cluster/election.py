"""Holds the Lease, or waits for it: one look or renewal at a time, each with a deadline."""

import asyncio
import logging
import socket
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Protocol
from uuid import uuid4

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster import lease as leases
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.fence import Fence, elapsed
from bagpipe_operator.cluster.lease import Lease, Sighting, Step, Terms

logger = logging.getLogger(__name__)

# A look that failed is repeated this soon: the fence closes two periods after a lost renewal.
RETRY_SECONDS = 0.3
# Leases that can't be read for this many durations make the replica unready.
SILENT_DURATIONS = 3


class Leases(Protocol):
    """What the election needs of an API server; every method raises ApiError."""

    async def get_lease(self, namespace: str, name: str) -> Json:
        """The Lease."""

    async def create_lease(self, manifest: Json) -> Json:
        """Creates the Lease; 409 when there is one."""

    async def replace_lease(self, manifest: Json) -> Json:
        """Replaces the Lease; 409 when it has been written since it was read."""


def new_identity() -> str:
    """A candidate's name. A host may run two, and a container that is restarted is another one."""
    return f"{socket.gethostname()}_{uuid4().hex[:12]}"


def _timestamp() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


@dataclass
class Election:
    """One candidate. `on_lead` is called each time that it begins to lead."""

    api: Leases
    fence: Fence
    terms: Terms
    namespace: str
    name: str
    on_lead: Callable[[], object]
    clock: Callable[[], float] = elapsed
    timestamp: Callable[[], str] = _timestamp
    leader: str = ""  # as last seen
    _mine: Lease | None = None  # as we wrote it: renewing it needs no look
    _sighting: Sighting = field(default_factory=Sighting)
    _answered: float = float("-inf")
    _fault: str = ""
    _led: bool = False  # as last reported

    async def run(self) -> None:
        """Campaigns until cancelled."""
        while True:
            pause = await self.step()
            await asyncio.sleep(pause)

    async def step(self) -> float:
        """One look or renewal; the seconds until the next."""
        try:
            async with asyncio.timeout(self.terms.period_seconds):
                pause = await self._step()
        except (ApiError, TimeoutError) as error:
            self._failed(error)
            pause = RETRY_SECONDS
        except Exception as error:
            # A bug met here must not leave the replica deaf for ever.
            self._failed(error)
            logger.exception("the Lease could not be handled")
            pause = self.terms.period_seconds
        else:
            self._answered, self._fault = self.clock(), ""
        if self._led and not self.fence.leads():
            self._led = False
            logger.warning("does not lead any more; the Lease is %s's", self.leader or "nobody")
        return pause

    async def release(self) -> None:
        """Gives the Lease back, so that another need not wait for its end. Nothing may be under
        way any more; one that can't be given back runs out by itself.
        """
        self.fence.close()
        if self._mine is None:
            return
        manifest = leases.released(self.namespace, self.name, self._mine, self.timestamp())
        self._mine = None
        try:
            async with asyncio.timeout(self.terms.period_seconds):
                await self.api.replace_lease(manifest)
        except (ApiError, TimeoutError) as error:
            logger.warning("the Lease was not given back: %s", error or "no answer in time")
        else:
            logger.info("gave the Lease %s/%s back", self.namespace, self.name)

    def trouble(self) -> str:
        """Why this replica can neither lead nor wait for its turn; empty when it can."""
        age = self.clock() - self._answered
        if age < SILENT_DURATIONS * self.terms.duration_seconds:
            return ""
        return f"the Lease {self.namespace}/{self.name} can't be used: {self._fault or 'not yet'}"

    async def _step(self) -> float:
        lease = self._mine or await self._read()
        now = self.clock()
        if lease is not None:
            self.leader = lease.holder
            self._sighting = self._sighting.of(lease, now)
        decision = leases.decide(self.terms, lease, self._sighting, now)
        if decision.step is Step.WAIT:
            self.fence.close()
            return decision.pause_seconds
        manifest = leases.manifest(
            self.namespace, self.name, self.terms, decision.step, lease, self.timestamp()
        )
        write = self.api.create_lease if lease is None else self.api.replace_lease
        self._mine = Lease.from_object(await write(manifest))
        # From before the request: others count from its arrival at the earliest.
        self._lead_until(now + self.terms.work_seconds)
        return self.terms.period_seconds

    async def _read(self) -> Lease | None:
        try:
            return Lease.from_object(await self.api.get_lease(self.namespace, self.name))
        except ApiError as error:
            if error.status == 404:
                return None
            raise

    def _lead_until(self, moment: float) -> None:
        lapsed = not self.fence.leads()
        self.fence.open_until(moment)
        self.leader = self.terms.identity
        if lapsed and self.fence.leads():
            self._led = True
            logger.info("leads by the Lease %s/%s", self.namespace, self.name)
            self.on_lead()

    def _failed(self, error: Exception) -> None:
        """The Lease may have been written or not: it is read before the next step."""
        self._mine = None
        fault = str(error) or "no answer in time"
        lost_race = isinstance(error, ApiError) and error.status == 409
        if fault != self._fault and not lost_race:
            logger.warning("the Lease %s/%s: %s", self.namespace, self.name, fault)
        self._fault = fault
