"""Forgets jobs and schedules whose deletion no watch has reported: they went between two watches.

One that ended, rests or is stalled is visited by nothing else, and would stay in memory and in the
gauges.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Protocol

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.runtime.queue import WorkQueue

logger = logging.getLogger(__name__)

PERIOD_SECONDS = 600.0
# Each lists all that there is, for which the API server reads each object whole.
SHORTEST_PERIOD_SECONDS = 60.0


class Seen(Protocol):
    """What was seen of one kind."""

    def uids(self) -> list[str]:
        """Of all that are known."""

    def namespaces_of(self, uid: str) -> set[str]:
        """Where one was seen, or what belongs to it."""

    def forget(self, uid: str) -> None:
        """One is gone."""


@dataclass
class Census:
    """Compares what is known with what there is, every `period_seconds`; earlier when a watch
    begins again, or a comparison has failed."""

    view: Seen
    queue: WorkQueue
    # The UIDs of all that there are in a namespace, or in all; raises ApiError.
    register: Callable[[str | None], Awaitable[set[str]]]
    namespaces: Sequence[str | None]
    period_seconds: float = PERIOD_SECONDS
    # The namespaces of which the last list failed.
    unlisted: Set[str | None] = frozenset()
    _soon: asyncio.Event = field(default_factory=asyncio.Event)

    def hasten(self) -> None:
        """A watch has begun again with a list: of what went before no event will come."""
        self._soon.set()

    def trouble(self) -> str:
        """Why no job can be looked for in any namespace; empty while one can."""
        if len(self.unlisted) < len(self.namespaces):
            return ""
        where = ", ".join(each or "the whole cluster" for each in self.namespaces)
        return f"no list of jobs is answered in {where}: has the operator its rights there?"

    async def count(self) -> int:
        """One comparison; how many were forgotten. Raises ApiError where no list was answered."""
        # Known before the list begins, so that what is created meanwhile is not missed in it.
        known = self.view.uids()
        there = await self._there()
        missing = (uid for uid in known if uid not in there)
        # Of a namespace without a list nothing is known.
        gone = [uid for uid in missing if not self.view.namespaces_of(uid) & self.unlisted]
        for uid in gone:
            self.view.forget(uid)
            self.queue.forget(uid)
            # A visit of what is not there forgets all else that is known of it.
            self.queue.add(uid)
        return len(gone)

    async def _there(self) -> set[str]:
        """The UIDs of all that there are, but for the namespaces that are unlisted from now on."""
        there: set[str] = set()
        failed: dict[str | None, ApiError] = {}
        for namespace in self.namespaces:
            try:
                there |= await self.register(namespace)
            except ApiError as error:
                failed[namespace] = error
        self.unlisted = failed.keys()
        if len(failed) == len(self.namespaces):
            raise next(iter(failed.values()))
        for namespace, refusal in failed.items():
            logger.warning("of namespace %s nothing is known: %s", namespace, refusal)
        return there

    async def run(self) -> None:
        """Compares until cancelled."""
        while True:
            await self._pause()
            try:
                gone = await self.count()
            except ApiError as error:
                logger.warning("what is gone is looked for later: %s", error)
                self.hasten()
                continue
            except Exception:
                # A bug met here must not keep what goes later for ever.
                logger.exception("unexpected fault in looking for what is gone")
                continue
            if self.unlisted:
                self.hasten()
            if gone:
                logger.info("%d went without a word of the watch", gone)

    async def _pause(self) -> None:
        shortest = min(self.period_seconds, SHORTEST_PERIOD_SECONDS)
        await asyncio.sleep(shortest)
        with suppress(TimeoutError):
            async with asyncio.timeout(self.period_seconds - shortest):
                await self._soon.wait()
        self._soon.clear()
