"""The way in which tests wait: until something is seen, with a deadline."""

import threading
import time
from collections.abc import Callable
from typing import TypeVar

Seen = TypeVar("Seen")

# After this a wait fails. Large, since it is only then reached: a machine that has other work, or
# a slow one, needs some times the seconds that an idle one does.
PATIENCE = 90.0


class NotSeenError(AssertionError, TimeoutError):
    """What a test waited for did not come: its failure, and a deadline that was missed."""


def wait_until(
    look: Callable[[], Seen | None], seconds: float, what: str, every: float = 0.02
) -> Seen:
    """The first true thing that is seen, looked for every so many seconds.

    Raises NotSeenError with `what` where there is none in `seconds`.
    """
    deadline = time.monotonic() + seconds
    pause = threading.Event()
    while not (seen := look()):
        if time.monotonic() > deadline:
            raise NotSeenError(f"after {seconds:.0f} s: {what}")
        pause.wait(every)
    return seen
