"""How fast cases end and how long the others will take, as one line. Pure."""

from collections import deque
from dataclasses import dataclass, field
from typing import Any

from bagpipe.row_facts import OUTCOMES

# The rate is that of the last minute: the first case waits for its slot's start, and long ones
# come first.
_WINDOW_SECONDS = 60.0


def done_of(progress: dict[str, Any]) -> int:
    """The cases that have ended, of a driver's /progress."""
    return sum(progress["cases"][outcome] for outcome in OUTCOMES)


@dataclass
class Pace:
    """Looks at a count that only grows."""

    _looks: deque[tuple[float, int]] = field(default_factory=deque)

    def look(self, now: float, done: int) -> None:
        """The count at a time, in seconds of any clock; times never go back."""
        self._looks.append((now, done))
        while len(self._looks) > 2 and self._looks[1][0] <= now - _WINDOW_SECONDS:
            self._looks.popleft()

    @property
    def rate(self) -> float:
        """Cases a second; 0 before one has ended."""
        if not self._looks:
            return 0.0
        (begin, first), (end, last) = self._looks[0], self._looks[-1]
        return (last - first) / (end - begin) if end > begin else 0.0


def line(progress: dict[str, Any], pace: Pace) -> str:
    """A driver's /progress for people: how much is done, how fast, and how long it will take."""
    cases, done = progress["cases"], done_of(progress)
    if progress["phase"] == "Planning":
        return "planning: reading the recordings' indexes"
    counts = ", ".join(f"{cases[outcome]} {outcome}" for outcome in OUTCOMES if cases[outcome])
    parts = [f"{done} of {cases['planned']} cases" + (f" ({counts})" if counts else "")]
    left = cases["planned"] - done
    if left:
        parts.append(f"{cases['running']} running")
    if pace.rate > 0:
        parts.append(_rate(pace.rate))
        if left:
            parts.append(f"about {_duration(left / pace.rate)} left")
    if progress["warning"]:
        parts.append(progress["warning"])
    return ", ".join(parts)


def _rate(rate: float) -> str:
    return f"{rate:.1f} a second" if rate >= 1 else f"{rate * 60:.1f} a minute"


def _duration(seconds: float) -> str:
    whole = round(seconds)
    if whole < 60:
        return f"{max(1, whole)} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
