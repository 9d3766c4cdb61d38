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
        self._since: dict[str, float] = {}  # the latest comes last

    def __contains__(self, address: str) -> bool:
        with self._lock:
            since = self._since.get(address)
        return since is not None and self._monotonic() - since < SECONDS

    def note(self, address: str, was_refused: bool) -> None:
        """What an offer from that address has come to."""
        with self._lock:
            self._since.pop(address, None)
            if was_refused:
                self._since[address] = self._monotonic()
            if len(self._since) > MOST:
                del self._since[next(iter(self._since))]
