"""The queue of jobs to reconcile: coalescing, one worker per job, retries with backoff.

A key that is added while it is being worked on is worked on once more afterwards. Its bound is
the number of jobs: every key is held at most once.
"""

import asyncio
from collections.abc import Callable

FIRST_RETRY_SECONDS = 0.5
LONGEST_RETRY_SECONDS = 30.0
RETRY_LIMIT = 8
# After the limit a key rests this long, unless an event asks for it: the fault is not ours to mend.
REST_SECONDS = 120.0


def retry_delay(failures: int) -> float:
    """Seconds to wait after the nth failure in a row, counted from 1."""
    if failures > RETRY_LIMIT:
        return REST_SECONDS
    return float(min(LONGEST_RETRY_SECONDS, FIRST_RETRY_SECONDS * 2 ** (failures - 1)))


class WorkQueue:
    """Keys in the order in which they were first asked for."""

    def __init__(self, now: Callable[[], float] | None = None) -> None:
        self._now = now or (lambda: asyncio.get_running_loop().time())
        self._ready: dict[str, None] = {}
        self._busy: set[str] = set()
        self._again: set[str] = set()
        self._failures: dict[str, int] = {}
        self._not_before: dict[str, float] = {}
        self._wake = asyncio.Event()

    def __len__(self) -> int:
        return len(self._ready)

    def add(self, key: str) -> None:
        """Asks for a key now, also when it is waiting for a retry: something has changed."""
        if key in self._busy:
            self._again.add(key)
            return
        self._ready[key] = None
        self._wake.set()

    def add_if_rested(self, key: str) -> None:
        """Asks for a key unless it is waiting for a retry: nothing has changed but the time."""
        if self._not_before.get(key, 0.0) <= self._now():
            self.add(key)

    async def get(self) -> str:
        """The next key; its worker must end with done() or retry()."""
        while not self._ready:
            self._wake.clear()
            await self._wake.wait()
        key = next(iter(self._ready))
        del self._ready[key]
        self._busy.add(key)
        return key

    def done(self, key: str) -> None:
        """The key was worked on without a fault."""
        self._failures.pop(key, None)
        self._not_before.pop(key, None)
        self._release(key)

    def retry(self, key: str) -> float:
        """The key failed; the sweeper may ask for it again after the seconds that this returns."""
        failures = self._failures.get(key, 0) + 1
        self._failures[key] = failures
        delay = retry_delay(failures)
        self._not_before[key] = self._now() + delay
        self._release(key)
        return delay

    def forget(self, key: str) -> None:
        """Drops what is remembered of a key that is gone."""
        self._failures.pop(key, None)
        self._not_before.pop(key, None)
        self._again.discard(key)

    def _release(self, key: str) -> None:
        self._busy.discard(key)
        if key in self._again:
            self._again.discard(key)
            self.add(key)
