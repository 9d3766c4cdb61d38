"""How long progress of a job waits before it is written, by how busy the API server seems.

A write costs the API server ten milliseconds of a processor, so a thousand jobs that count keep it
from everything else. What it takes to write a status, the wait for a turn included, says how busy
it is: a mean over the last writes, which falls while nothing is written.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from bagpipe_operator.cluster.fence import PROGRESS_AT_ONCE

# An API server with time to spare answers a write in 10 to 20 ms, one on slow disks in 50 to 80.
QUIET_SECONDS = 0.1
# With all workers waiting for thirty writes a second, each takes a second: progress waits longest
# before that.
BUSY_SECONDS = 0.6
# A mean over about the last sixteen writes, of which no single one counts for more than this: one
# that got no answer must not make an API server look busy that has only been restarted.
WEIGHT = 1 / 16
MOST_OF_ONE_SECONDS = 2 * BUSY_SECONDS
# As fast it is forgotten when nothing is written: an hour ago says nothing of now.
HALF_LIFE_SECONDS = 5.0


def interval(latency: float, longest: float) -> float:
    """Seconds from one write of a job's progress to the next, at such a latency; 0 to `longest`."""
    share = (latency - QUIET_SECONDS) / (BUSY_SECONDS - QUIET_SECONDS)
    return longest * min(1.0, max(0.0, share))


class WritePace:
    """Of all jobs, by UID; `longest` is for how many seconds progress may wait."""

    def __init__(self, longest: float, now: Callable[[], float]) -> None:
        self._longest = longest
        self._now = now
        self._latency = 0.0
        self._measured_at = float("-inf")
        self._waits_since: dict[str, float] = {}
        self._under_way = 0  # writes of progress

    def interval(self) -> float:
        """The interval at this moment."""
        return interval(self._latency_at(self._now()), self._longest)

    def puts_off(self, uid: str) -> bool:
        """Whether progress of a job waits for a later visit; never once it waited for longest.

        It waits since the job's last write, or since this was first asked. While the API server is
        busy a worker does not stand in line with progress either.
        """
        now, wait = self._now(), self.interval()
        waited = now - self._waits_since.setdefault(uid, now)
        in_line = wait > 0 and self._under_way >= PROGRESS_AT_ONCE
        return waited < (self._longest if in_line else wait)

    @contextmanager
    def writing(self, uid: str, urgent: bool) -> Iterator[None]:
        """Around a write of a job's status: how long it takes, and that it was made."""
        begun = self._now()
        self._under_way += not urgent
        try:
            yield
            self._waits_since[uid] = self._now()
        finally:
            self._under_way -= not urgent
            self._measured(begun)

    def forget(self, uid: str) -> None:
        """The job is gone, or has ended, or begins again."""
        self._waits_since.pop(uid, None)

    def _latency_at(self, moment: float) -> float:
        idle = max(0.0, moment - self._measured_at)
        return self._latency * math.exp2(-idle / HALF_LIFE_SECONDS)

    def _measured(self, begun: float) -> None:
        counted = min(self._now() - begun, MOST_OF_ONE_SECONDS)
        known = self._latency_at(begun)  # while it was under way the API server had no rest
        self._latency = known + WEIGHT * (counted - known)
        self._measured_at = self._now()
