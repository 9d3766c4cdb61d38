"""Wakes schedules when their next run is due."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime

from bagpipe_operator.runtime.queue import Lane, WorkQueue
from bagpipe_operator.schedules.cron import MINUTE

# A run starts at most this much after its time, plus the queue's and the API server's share.
PERIOD_SECONDS = 0.5


@dataclass
class Alarms:
    """One alarm per schedule, by UID; it stays set until it is set again or forgotten.

    And one for its next run, which rings once, and also while the schedule rests after a fault:
    the pauses that an earlier run has brought about would make that one late.
    """

    queue: WorkQueue
    now: Callable[[], datetime]
    _at: dict[str, datetime] = field(default_factory=dict)
    _next: dict[str, datetime] = field(default_factory=dict)
    _rung: datetime | None = None

    def set(self, uid: str, at: datetime | None) -> None:
        """The moment to wake a schedule at; None for none."""
        _set(self._at, uid, at)

    def set_next(self, uid: str, at: datetime | None) -> None:
        """The moment of a schedule's next run, or the end of its time for this one."""
        _set(self._next, uid, at)

    def forget(self, uid: str) -> None:
        """The schedule is gone."""
        self.set(uid, None)
        self.set_next(uid, None)

    def ring(self) -> int:
        """Asks for every schedule whose moment has come, but not while it rests after a fault,
        unless its next run is due."""
        now = self.now()
        if self._rung is not None and self._rung - now > MINUTE:
            # By a clock that was set back all alarms are wrong, also those of who rests just now.
            self._at = dict.fromkeys(self._at, now)
            self._next.clear()  # each visit sets it
        self._rung = now
        for uid in [uid for uid, at in self._next.items() if at <= now]:
            del self._next[uid]
            self.queue.add(uid, Lane.ROUND)
        due = [uid for uid, at in self._at.items() if at <= now]
        for uid in due:
            self.queue.add_if_rested(uid)
        return len(due)

    async def run(self) -> None:
        """Rings until cancelled."""
        while True:
            self.ring()
            await asyncio.sleep(PERIOD_SECONDS)


def _set(moments: dict[str, datetime], uid: str, at: datetime | None) -> None:
    if at is None:
        moments.pop(uid, None)
    else:
        moments[uid] = at
