"""How long this machine did nothing while a test measured a promise about time."""

import threading
import time
from typing import Self

_LOOK_SECONDS = 0.05


class Stalls:
    """Sums up by how much later than asked for a thread of this process was woken.

    What is promised in seconds is promised of a machine that goes on: these are to be taken off.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        before = time.monotonic()
        while not self._over.wait(_LOOK_SECONDS):
            now = time.monotonic()
            self.seconds += max(0.0, now - before - _LOOK_SECONDS)
            before = now
