"""The queue of jobs to reconcile: coalescing, one worker per job, retries with backoff.

It has three lanes, because a thousand new jobs must not make the status of those that run old,
and those that run must not keep new ones out. A key that is added while it is being worked on is
worked on once more afterwards. Its bound is the number of jobs: every key is held at most once.
"""

import asyncio
from collections import Counter, deque
from collections.abc import Callable
from enum import IntEnum
from functools import partial
from typing import Any

FIRST_RETRY_SECONDS = 0.5
LONGEST_RETRY_SECONDS = 30.0
RETRY_LIMIT = 8
# After the limit a key rests this long, unless an event asks for it: the fault is not ours to mend.
REST_SECONDS = 120.0
# One turn in so many is for new jobs, whatever else waits; the others are shared by the rest.
TURNS = 4
# So many workers may a tenant have for each that is free beside the last.
BUSY_FOR_EACH_FREE = 3


class Lane(IntEnum):
    """Why a key is asked for. A key is in one lane, and only news takes it out of another."""

    NEWS = 0  # something of a job that runs, or its pods, has changed
    ROUND = 1  # nothing is known to have changed but the time
    START = 2  # the job has no driver yet


def retry_delay(failures: int) -> float:
    """Seconds to wait after the nth failure in a row, counted from 1."""
    if failures > RETRY_LIMIT:
        return REST_SECONDS
    return float(min(LONGEST_RETRY_SECONDS, FIRST_RETRY_SECONDS * 2 ** (failures - 1)))


def has_its_share(busy: int, free: int) -> bool:
    """Whether a tenant that has `busy` of the workers is to leave those that are free to others.

    Alone it has three quarters of them, and the less the more tenants have some; the last one that
    is free is for a tenant that has none.
    """
    return busy > 0 and busy >= BUSY_FOR_EACH_FREE * (free - 1)


def most_in_lane(workers: int) -> int:
    """How many workers a tenant's new jobs may have, and its rounds as many: news finds others."""
    return max(1, workers // 4)


def order(turn: int) -> tuple[Lane, ...]:
    """The lanes in the order in which they are looked into at a turn."""
    if turn % TURNS == 0:
        return (Lane.START, Lane.NEWS, Lane.ROUND)
    if turn % 2:
        return (Lane.NEWS, Lane.ROUND, Lane.START)
    return (Lane.ROUND, Lane.NEWS, Lane.START)


class _Turns:
    """One lane's keys: their tenants take turns, and each tenant's are in their order."""

    def __init__(self) -> None:
        self._keys: dict[str, dict[str, None]] = {}  # by tenant; whose turn it is comes first

    def add(self, key: str, tenant: str) -> None:
        self._keys.setdefault(tenant, {})[key] = None

    def remove(self, key: str, tenant: str) -> None:
        del self._keys[tenant][key]
        if not self._keys[tenant]:
            del self._keys[tenant]

    def take(self, has_its_share: Callable[[str], bool]) -> str | None:
        tenant = next((each for each in self._keys if not has_its_share(each)), None)
        if tenant is None:
            return None
        key = next(iter(self._keys[tenant]))
        self.remove(key, tenant)
        if tenant in self._keys:
            self._keys[tenant] = self._keys.pop(tenant)  # to the end
        return key


class WorkQueue:
    """Keys; in each lane their tenants take turns, so that no tenant's thousands come first.

    `tenant_of` says whose a key is: a job's namespace. Turns alone would not do where the visits of
    some tenants' jobs take long, as of drivers that hang: they would have all workers in the end.
    So of the `workers` that there are each tenant has its share; None: as many as it can get. New
    jobs and rounds have a quarter of all each at most, since their visits write, and wait for
    writes: else the tenant's news would wait until they have done so.
    """

    def __init__(
        self,
        now: Callable[[], float] | None = None,
        tenant_of: Callable[[str], str] = lambda _key: "",
        workers: int | None = None,
    ) -> None:
        self._now = now or (lambda: asyncio.get_running_loop().time())
        self._tenant_of = tenant_of
        self._workers = workers
        self._ready: dict[Lane, _Turns] = {lane: _Turns() for lane in Lane}
        self._place: dict[str, tuple[Lane, str]] = {}  # lane and tenant of each key that is ready
        self._turn = 0
        self._busy: dict[str, tuple[Lane, str]] = {}  # of each key that is worked on
        self._busy_of: Counter[str] = Counter()
        self._busy_in: Counter[tuple[Lane, str]] = Counter()
        self._again: dict[str, Lane] = {}
        self._failures: dict[str, int] = {}
        self._not_before: dict[str, float] = {}
        # A key wakes one of the workers that wait, and not all of them.
        self._idle: deque[asyncio.Future[None]] = deque()

    def __len__(self) -> int:
        return len(self._place)

    def add(self, key: str, lane: Lane = Lane.NEWS) -> None:
        """Asks for a key now, also when it is waiting for a retry: something has changed."""
        if key in self._busy:
            self._again[key] = min(lane, self._again.get(key, lane))
            return
        place = self._place.get(key)
        if place is not None:
            there, tenant = place
            if lane is not Lane.NEWS or there is lane:
                return
            self._ready[there].remove(key, tenant)
        else:
            tenant = self._tenant_of(key)
            self._wake_one()
        self._place[key] = lane, tenant
        self._ready[lane].add(key, tenant)

    def add_if_rested(self, key: str) -> None:
        """Asks for a key unless it is waiting for a retry: nothing has changed but the time."""
        if self._not_before.get(key, 0.0) <= self._now():
            self.add(key, Lane.ROUND)

    def rested(self) -> list[str]:
        """The keys that have failed and may be tried again now; their times go with done()."""
        now = self._now()
        waiting = ((key, at) for key, at in self._not_before.items() if key not in self._busy)
        return [key for key, at in waiting if at <= now]

    async def get(self) -> str:
        """The next key; its worker must end with done() or retry()."""
        while (key := self._take()) is None:
            woken = asyncio.get_running_loop().create_future()
            self._idle.append(woken)
            try:
                await woken
            except asyncio.CancelledError:
                if not woken.cancelled():
                    self._wake_one()  # the key that it was woken for is another's
                raise
        return key

    def _take(self) -> str | None:
        """The next key, or None where none is ready of a tenant that may have another worker."""
        for lane in order(self._turn):
            key = self._ready[lane].take(partial(self._has_its_share, lane))
            if key is not None:
                self._turn += 1
                place = self._busy[key] = self._place.pop(key)
                self._busy_of[place[1]] += 1
                self._busy_in[place] += 1
                return key
        return None

    def _has_its_share(self, lane: Lane, tenant: str) -> bool:
        if self._workers is None:
            return False
        if lane is not Lane.NEWS and self._busy_in[lane, tenant] >= most_in_lane(self._workers):
            return True
        return has_its_share(self._busy_of[tenant], self._workers - len(self._busy))

    def _wake_one(self) -> None:
        while self._idle:
            woken = self._idle.popleft()
            if not woken.done():
                woken.set_result(None)
                return

    def done(self, key: str) -> None:
        """The key was worked on without a fault."""
        self._failures.pop(key, None)
        self._not_before.pop(key, None)
        self._release(key)

    def retry(self, key: str) -> float:
        """The key failed; the sweeper asks for it again after the seconds that this returns."""
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
        self._again.pop(key, None)

    def _release(self, key: str) -> None:
        place = self._busy.pop(key, None)
        if place is not None:
            if self._place:
                self._wake_one()  # others' shares are larger now, and this tenant's may be
            self._drop(self._busy_in, place)
            self._drop(self._busy_of, place[1])
        lane = self._again.pop(key, None)
        if lane is not None:
            self.add(key, lane)

    @staticmethod
    def _drop(counts: Counter[Any], counted: object) -> None:
        counts[counted] -= 1
        if not counts[counted]:
            del counts[counted]
