"""One after the other, and of each who asks at most one at a time: who asks without end makes only
itself wait."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager


class Turns:
    """Turns at something that one thread at a time may do."""

    def __init__(self, patience_seconds: float) -> None:
        self._patience_seconds = patience_seconds
        self._lock = threading.Lock()
        self._asking: set[str] = set()
        self._free = threading.Semaphore()

    @contextmanager
    def taken(self, by: str) -> Iterator[bool]:
        """The turn of `by`; False where it has or awaits one already, or none came in time."""
        with self._lock:
            is_asking = by in self._asking
            self._asking.add(by)
        if is_asking:
            yield False
            return
        try:
            with self._next() as has_it:
                yield has_it
        finally:
            with self._lock:
                self._asking.discard(by)

    @contextmanager
    def _next(self) -> Iterator[bool]:
        has_it = self._free.acquire(timeout=self._patience_seconds)
        try:
            yield has_it
        finally:
            if has_it:
                self._free.release()
