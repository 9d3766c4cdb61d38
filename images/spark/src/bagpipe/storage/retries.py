"""How often and after which pause a request is made again."""

import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from bagpipe.storage.backend import TransientError

T = TypeVar("T")

ADVICE = "check that the storage is up and reachable from the job's pods, then run the job again"


@dataclass(frozen=True)
class Patience:
    """Limits of one request. Its tries end after about a minute of pauses in all."""

    # From sending a request to the last byte of its answer, which has at most 4 MiB.
    request_seconds: float = 30.0
    tries: int = 8
    first_pause_seconds: float = 0.5
    longest_pause_seconds: float = 20.0

    def pause_seconds(self, failures: int, chance: float) -> float | None:
        """The pause after so many failures, None for no further try; `chance` is 0 to 1.

        It doubles each time, and half of it is left to chance: executors that were refused
        together must not come back together.
        """
        if failures >= self.tries:
            return None
        longest = min(self.longest_pause_seconds, self.first_pause_seconds * 2.0 ** (failures - 1))
        return longest * (0.5 + 0.5 * chance)


@dataclass(frozen=True)
class Clock:
    """Time and chance, so that tests need not wait."""

    now: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep
    chance: Callable[[], float] = random.random


class Attempts:
    """The failures of one request so far."""

    def __init__(self, patience: Patience, clock: Clock) -> None:
        self._patience = patience
        self._clock = clock
        self._began = clock.now()
        self.failures = 0

    def failed(self, error: TransientError, where: str = "") -> None:
        """Wait before the next try, or raise OSError when there is none left."""
        self.failures += 1
        pause = self._patience.pause_seconds(self.failures, self._clock.chance())
        if pause is None:
            seconds = self._clock.now() - self._began
            raise OSError(
                f"{where}{error} ({self.failures} tries in {seconds:.0f} s): {ADVICE}"
            ) from error
        self._clock.sleep(pause)


def persistently(ask: Callable[[], T], patience: Patience, clock: Clock) -> T:
    """What `ask` answers, asked again while it fails transiently. Raises OSError."""
    attempts = Attempts(patience, clock)
    while True:
        try:
            return ask()
        except TransientError as error:
            attempts.failed(error)
