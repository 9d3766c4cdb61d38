"""Nothing is written without leadership: every write asks the fence, and ends before it closes."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import TypeVar

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import Api, ApiError
from bagpipe_operator.cluster.write_turns import WriteTurns

Answer = TypeVar("Answer")

# An API server with few processors makes fewer writes in a second when more are asked for at once;
# its watches fall behind, and the Lease's renewal gets no answer. Workers beyond these ask drivers.
# Of one namespace:
WRITES_AT_ONCE = 8
# Progress of jobs has no more of them: what is urgent finds a turn free of it, whatever counts.
PROGRESS_AT_ONCE = 6
# So many more of each kind are for other namespaces, however slow the writes of one are.
FOR_OTHERS = 2
# So many more of each kind are for namespaces that make none, however slow the others' are.
BESIDE_SLOW = 16


class NotLeadingError(ApiError):
    """Another replica leads, or this one can't know: the write was not made, or not awaited."""

    def __init__(self) -> None:
        super().__init__(0, "NotLeading", "this replica does not lead any more, as far as it knew")


def elapsed() -> float:
    """Seconds of a clock that nobody sets and that goes on while the machine sleeps."""
    return time.clock_gettime(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))


class Fence:
    """Until when this process may write. It closes by time alone, whatever else hangs."""

    def __init__(self, clock: Callable[[], float] = elapsed) -> None:
        self._clock = clock
        self._until = float("-inf")

    def open_until(self, moment: float) -> None:
        """A renewal succeeded."""
        self._until = moment

    def close(self) -> None:
        """Leadership is given up, or another's."""
        self._until = float("-inf")

    def remaining(self) -> float:
        """Seconds for which writing is safe; none or less when it is not."""
        return self._until - self._clock()

    def leads(self) -> bool:
        """Whether this process leads now."""
        return self.remaining() > 0


class FencedApi:
    """An Api whose writes need an open fence, WRITES_AT_ONCE at once of one namespace, and of all
    FOR_OTHERS more, and BESIDE_SLOW beside those that take long. Reads harm nobody.

    A write waits for its turn no longer than its reconcile may last.
    """

    def __init__(self, api: Api, fence: Fence) -> None:
        self._api = api
        self._fence = fence
        self._turns = WriteTurns(WRITES_AT_ONCE, FOR_OTHERS, BESIDE_SLOW)
        self._progress = WriteTurns(PROGRESS_AT_ONCE, FOR_OTHERS, BESIDE_SLOW)

    async def create(self, resource: str, manifest: Json) -> Json:
        namespace = manifest["metadata"]["namespace"]
        return await self._leading(namespace, lambda: self._api.create(resource, manifest))

    async def try_create(self, resource: str, manifest: Json) -> None:
        await self._api.try_create(resource, manifest)  # it keeps nothing, so it harms nobody

    async def events_of(self, namespace: str, uid: str) -> list[Json]:
        return await self._api.events_of(namespace, uid)

    async def get(self, resource: str, namespace: str, name: str) -> Json:
        return await self._api.get(resource, namespace, name)

    async def delete_pod(
        self, namespace: str, name: str, uid: str, grace_seconds: int | None = None
    ) -> bool:
        return await self._leading(
            namespace, lambda: self._api.delete_pod(namespace, name, uid, grace_seconds)
        )

    async def get_job(self, namespace: str, name: str) -> Json:
        return await self._api.get_job(namespace, name)

    async def get_schedule(self, namespace: str, name: str) -> Json:
        return await self._api.get_schedule(namespace, name)

    async def list_jobs(self, namespace: str, label: str, most: int | None = None) -> list[Json]:
        return await self._api.list_jobs(namespace, label, most)

    async def delete_unchanged_job(self, namespace: str, name: str, uid: str, version: str) -> None:
        await self._leading(
            namespace, lambda: self._api.delete_unchanged_job(namespace, name, uid, version)
        )

    async def patch_status(
        self, namespace: str, name: str, patch: Json, urgent: bool = True
    ) -> Json:
        if urgent:
            return await self._leading(
                namespace, lambda: self._api.patch_status(namespace, name, patch)
            )
        async with self._progress.taken(namespace):
            return await self.patch_status(namespace, name, patch)

    async def _leading(self, namespace: str, write: Callable[[], Awaitable[Answer]]) -> Answer:
        async with self._turns.taken(namespace):
            remaining = self._fence.remaining()
            if remaining <= 0:
                raise NotLeadingError
            try:
                async with asyncio.timeout(remaining):
                    return await write()
            except TimeoutError:
                raise NotLeadingError from None
