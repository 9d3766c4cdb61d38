"""Who has offered a driver what does not claim it."""

import threading
from collections.abc import Callable

# Long, so that many addresses of one sender get few first tries; an operator is refused seldom.
SECONDS = 60.0
MOST = 1_000


class RefusedLately:
    """The last MOST addresses that were refused in the last SECONDS of the clock `monotonic`."""

    def __init__(self, monotonic: Callable[[], float]) -> None:
        self._monotonic = monotonic
        self._lock = threading.Lock()
        self._last: dict[str, tuple[float, int]] = {}  # the latest comes last

    def times(self, address: str) -> int:
        """How often an address was refused, with less than SECONDS between two refusals."""
        with self._lock:
            return self._times(address)

    def _times(self, address: str) -> int:
        moment, times = self._last.get(address, (0.0, 0))
        return times if times and self._monotonic() - moment < SECONDS else 0

    def note(self, address: str, was_refused: bool) -> None:
        """What an offer from that address has come to."""
        with self._lock:
            times = self._times(address)
            self._last.pop(address, None)
            if was_refused:
                self._last[address] = self._monotonic(), times + 1
            if len(self._last) > MOST:
                del self._last[next(iter(self._last))]
