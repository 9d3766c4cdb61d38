"""The place of one job at a time in a driver that stays for the next one.

Who offers a job is not believed: what counts is the claim in the job's own status, looked up at
that moment, which nobody but the operator writes.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from bagpipe.driver.refused_lately import RefusedLately
from bagpipe.driver.turns import Turns
from bagpipe.spec import JobFile

# What is remembered of offers; a driver that has met more takes no other and ends.
MOST_MET = 1_000
# Together with a look-up less than the operator waits for an answer.
_TURN_SECONDS = 0.3
# An operator is refused a time or two, as when a job is deleted while it is offered; who floods
# leaves these lines at once, for the last.
_LINES = 4
# SIGTERM's handler may not wake who waits, which looks by itself so often.
_LOOK_SECONDS = 0.5

Answer = Literal["taken", "ended", "refused", "unknown"]


@dataclass(frozen=True)
class Offer:
    """A job for this driver, as whoever sends it says."""

    namespace: str
    name: str
    uid: str
    attempt: int
    digest: str
    """SHA-256 of job.json as it came, in hexadecimal digits."""

    read: Callable[[], JobFile | None]
    """The whole of it, or None where it can't be read: asked of what claims this driver alone."""

    sender: str = ""
    """The address that it came from."""

    @property
    def key(self) -> tuple[str, int]:
        """Which job, and which of its attempts."""
        return self.uid, self.attempt


@dataclass(frozen=True)
class Claimed:
    """What a job's status says of its claim."""

    uid: str
    attempt: int
    driver: str
    digest: str


# Looks a job's claim up by its name, within a deadline of its own; None where it has none. Raises
# OSError where nobody answers.
LookUp = Callable[[str], Claimed | None]


class Seat:
    """Whose turn it is. Offers come from the server's threads, one thread works."""

    def __init__(
        self,
        driver: str,
        namespace: str,
        idle_seconds: float,
        look_up: LookUp,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._driver, self._namespace = driver, namespace
        self._idle_seconds = idle_seconds
        self._look_up = look_up
        self._monotonic = monotonic
        self._changed = threading.Condition()
        self._refused = RefusedLately(monotonic)
        self._looking_up = [Turns(_TURN_SECONDS) for _ in range(_LINES)]
        self._closing = False
        self._met: set[tuple[str, int]] = set()
        self._ended: set[tuple[str, int]] = set()
        self._current: JobFile | None = None
        self._closed = False
        self._until = monotonic() + idle_seconds

    def begin(self, job: JobFile) -> None:
        """The job that the driver's pod was made for, which needs no claim."""
        with self._changed:
            self._current = job
            self._met.add(_key(job))

    def offer(self, offer: Offer) -> Answer:
        """Whether the driver runs the job, or has run it; `unknown` may be asked again.

        A job that claims this driver and was refused once is refused for ever: the operator has
        made other pods for it. What claims it not is not remembered, as anybody may send it.
        """
        with self._changed:
            known = self._known(offer)
        if known is not None:
            return known
        ours = self._looked_up(offer)
        if ours is None:
            return "unknown"
        job = offer.read() if ours else None
        with self._changed:
            return self._known(offer) or self._seated(offer, ours, job)

    def close(self) -> None:
        """No further job is taken. For a signal's handler: it takes no lock."""
        self._closing = True

    def _known(self, offer: Offer) -> Answer | None:
        """What the answer is without a look-up."""
        if self._current is not None and _key(self._current) == offer.key:
            return "taken"
        if offer.key in self._ended:
            return "ended"
        # A closed seat needs no memory of offers.
        self._closed = self._closed or self._closing or len(self._met) >= MOST_MET
        return "refused" if self._closed or offer.key in self._met else None

    def _looked_up(self, offer: Offer) -> bool | None:
        """Whether the job claims this driver; None where that is not known now.

        One at a time in each line, and without the lock: who sends many delays neither the work nor
        its end. Who was refused lately waits with those who were as often, so that they delay
        nobody else, however many addresses they have and however long a look-up takes.
        """
        line = min(self._refused.times(offer.sender), _LINES - 1)
        with self._looking_up[line].taken(offer.sender) as has_turn:
            if not has_turn:
                return None
            try:
                ours = self._is_ours(offer)
            except OSError:
                return None
            self._refused.note(offer.sender, not ours)
            return ours

    def _seated(self, offer: Offer, ours: bool, job: JobFile | None) -> Answer:
        if not ours:
            return "refused"
        self._met.add(offer.key)
        if job is None or not self._is_free():
            return "refused"
        self._current = job
        self._changed.notify_all()
        return "taken"

    def taken(self) -> JobFile | None:
        """Waits for the next job; None when none came in time, and no other will be taken."""
        with self._changed:
            while self._current is None and not self._closed:
                left = self._until - self._monotonic()
                if left <= 0 or self._closing:
                    self._closed = True
                else:
                    self._changed.wait(min(left, _LOOK_SECONDS))
            return self._current

    def leave(self, stays: bool) -> None:
        """The job has ended; `stays` where nothing of it can reach the next one."""
        with self._changed:
            if self._current is not None:
                self._ended.add(_key(self._current))
            self._current = None
            self._closed = self._closed or not stays
            self._until = self._monotonic() + self._idle_seconds
            self._changed.notify_all()

    def _is_free(self) -> bool:
        return self._current is None and self._monotonic() < self._until

    def _is_ours(self, offer: Offer) -> bool:
        if offer.namespace != self._namespace:
            return False
        wanted = Claimed(offer.uid, offer.attempt, self._driver, offer.digest)
        return self._look_up(offer.name) == wanted


def _key(job: JobFile) -> tuple[str, int]:
    return job.uid, job.attempt
