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
    begins again, and of those namespaces whose last list failed."""

    view: Seen
    queue: WorkQueue
    # The UIDs of all that there are in a namespace, or in all; raises ApiError.
    register: Callable[[str | None], Awaitable[set[str]]]
    namespaces: Sequence[str | None]
    period_seconds: float = PERIOD_SECONDS
    # The namespaces of which the last list failed.
    unlisted: Set[str | None] = frozenset()
    _forbidden: Set[str | None] = frozenset()  # of these those without rights
    _all_at: float = 0.0
    _soon: asyncio.Event = field(default_factory=asyncio.Event)

    def hasten(self) -> None:
        """A watch has begun again with a list: of what went before no event will come."""
        self._soon.set()

    def trouble(self) -> str:
        """Why no job can be looked for in any namespace; empty while one can."""
        if len(self._forbidden) < len(self.namespaces):
            return ""
        where = ", ".join(each or "the whole cluster" for each in self.namespaces)
        return f"no list of jobs is answered in {where}: has the operator its rights there?"

    async def count(self, asked: Sequence[str | None] | None = None) -> int:
        """One comparison, in all namespaces or in some; how many were forgotten.

        Raises ApiError where no list of any namespace was answered.
        """
        asked = self.namespaces if asked is None else asked
        # Known before the list begins, so that what is created meanwhile is not missed in it.
        known = self.view.uids()
        there = await self._there(asked)
        gone = [uid for uid in known if uid not in there and self._would_be_there(uid, asked)]
        for uid in gone:
            self.view.forget(uid)
            self.queue.forget(uid)
            # A visit of what is not there forgets all else that is known of it.
            self.queue.add(uid)
        return len(gone)

    def _would_be_there(self, uid: str, asked: Sequence[str | None]) -> bool:
        """Whether it is of namespaces that were listed: of others nothing is known."""
        places, listed = self.view.namespaces_of(uid), set(asked) - self.unlisted
        known = bool(places) or len(asked) == len(self.namespaces)
        return known and (None in listed or places <= listed)

    async def _there(self, asked: Sequence[str | None]) -> set[str]:
        """The UIDs of all that there are, but for the namespaces that are unlisted from now on."""
        there: set[str] = set()
        failed: dict[str | None, ApiError] = {}
        for namespace in asked:
            try:
                there |= await self.register(namespace)
            except ApiError as error:
                failed[namespace] = error
        forbidden = {each for each, error in failed.items() if error.status in {401, 403}}
        self.unlisted = (self.unlisted - set(asked)) | failed.keys()
        self._forbidden = (self._forbidden - set(asked)) | forbidden
        if len(failed) == len(self.namespaces):
            raise next(iter(failed.values()))
        for namespace, refusal in failed.items():
            logger.warning("of namespace %s nothing is known: %s", namespace, refusal)
        return there

    async def run(self) -> None:
        """Compares until cancelled."""
        self._all_at = asyncio.get_running_loop().time() + self.period_seconds
        while True:
            asked = await self._pause()
            try:
                gone = await self.count(asked)
            except ApiError as error:
                logger.warning("what is gone is looked for later: %s", error)
                continue
            except Exception:
                # A bug met here must not keep what goes later for ever.
                logger.exception("unexpected fault in looking for what is gone")
                continue
            if gone:
                logger.info("%d went without a word of the watch", gone)

    async def _pause(self) -> Sequence[str | None]:
        """Waits until a comparison is due; the namespaces that it is of."""
        now = asyncio.get_running_loop().time
        await asyncio.sleep(min(self.period_seconds, SHORTEST_PERIOD_SECONDS))
        if self.unlisted and not self._soon.is_set() and now() < self._all_at:
            asked = [each for each in self.namespaces if each in self.unlisted]
        else:
            with suppress(TimeoutError):
                async with asyncio.timeout_at(self._all_at):
                    await self._soon.wait()
            self._soon.clear()
            asked = list(self.namespaces)
        if len(asked) == len(self.namespaces):
            self._all_at = now() + self.period_seconds
        return asked
