"""Wakes schedules when their next run is due."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime

from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.schedules.cron import MINUTE

# A run starts at most this much after its time, plus the queue's and the API server's share.
PERIOD_SECONDS = 0.5


@dataclass
class Alarms:
    """One alarm per schedule, by UID; it stays set until it is set again or forgotten."""

    queue: WorkQueue
    now: Callable[[], datetime]
    _at: dict[str, datetime] = field(default_factory=dict)
    _rung: datetime | None = None

    def set(self, uid: str, at: datetime | None) -> None:
        """The moment to wake a schedule at; None for none."""
        if at is None:
            self._at.pop(uid, None)
        else:
            self._at[uid] = at

    def ring(self) -> int:
        """Asks for every schedule whose moment has come, but not while it rests after a fault."""
        now = self.now()
        if self._rung is not None and self._rung - now > MINUTE:
            # By a clock that was set back all alarms are wrong, also those of who rests just now.
            self._at = dict.fromkeys(self._at, now)
        self._rung = now
        due = [uid for uid, at in self._at.items() if at <= now]
        for uid in due:
            self.queue.add_if_rested(uid)
        return len(due)

    async def run(self) -> None:
        """Rings until cancelled."""
        while True:
            self.ring()
            await asyncio.sleep(PERIOD_SECONDS)
