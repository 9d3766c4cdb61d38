"""The way in which tests wait: until something is seen, with a deadline."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

Seen = TypeVar("Seen")

# After this a wait fails. Large, since it is only then reached: a machine that has other work, or
# a slow one, needs some times the seconds that an idle one does.
PATIENCE = 90.0


# For a job's stack, which is waited for by the agent: a machine that stands still for seconds is no
# stack without answers.
_SUBSCRIBE, _ANSWER = "120s", "60s"


def patient(spec: dict[str, Any]) -> dict[str, Any]:
    """A job's spec in which the agent waits long for each answer of its stack, and for the stack
    itself, unless the spec says how long.
    """
    playback = spec.setdefault("playback", {})
    playback.setdefault("subscribeTimeout", _SUBSCRIBE)
    for step in playback.get("steps", []):
        step["deadline"] = _ANSWER
    return spec


class NotSeenError(AssertionError, TimeoutError):
    """What a test waited for did not come: its failure, and a deadline that was missed."""


def pauses(every: float) -> Iterator[float]:
    """Seconds between looks, each half as long again, up to 0.2 s or to those that were asked for.

    A look may be a call to an API server, which is slower for all others while it answers.
    """
    most = max(every, 0.2)
    while True:
        yield every
        every = min(every * 1.5, most)


def wait_until(
    look: Callable[[], Seen | None],
    seconds: float,
    what: str | Callable[[], str],
    every: float = 0.02,
) -> Seen:
    """The first true thing that is seen, looked for every so many seconds, and more seldom later.

    Raises NotSeenError with `what`, as it is then, where there is none in `seconds`.
    """
    deadline = time.monotonic() + seconds
    never = threading.Event()
    for pause in pauses(every):
        if seen := look():
            return seen
        if time.monotonic() > deadline:
            break
        never.wait(pause)
    raise NotSeenError(f"after {seconds:.0f} s: {what if isinstance(what, str) else what()}")
