"""How fast a job's cases end, and when the last one will. Pure: the clock comes in from outside."""

from collections import deque
from dataclasses import dataclass, field

from bagpipe.cli.cluster.state import Counts

# What counts for the rate: long enough for cases of a minute, short enough to notice a change.
_WINDOW_SECONDS = 300.0
# One step of a count says nothing of a rate.
_LEAST_SECONDS = 5.0
_MOST_LOOKS = 600


@dataclass
class Pace:
    """Looks at the counts, each with the second at which it was made."""

    _looks: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=_MOST_LOOKS))

    def began(self, second: float) -> None:
        """The first case began then, before anybody watched; call it before any look."""
        if not self._looks:
            self._looks.append((second, 0))

    def look(self, second: float, done: int) -> None:
        """So many cases had ended at that second."""
        if self._looks and done < self._looks[-1][1]:
            self._looks.clear()  # another driver counts again from its journal
        self._looks.append((second, done))
        while len(self._looks) > 2 and second - self._looks[1][0] > _WINDOW_SECONDS:
            self._looks.popleft()

    def per_second(self, now: float) -> float | None:
        """Cases per second; None as long as it is unknown."""
        if not self._looks:
            return None
        (since, before), (_, done) = self._looks[0], self._looks[-1]
        if now - since < _LEAST_SECONDS or done <= before:
            return None
        return (done - before) / (now - since)

    def seconds_left(self, now: float, cases: Counts) -> float | None:
        """When the last case will have ended, at this rate."""
        rate = self.per_second(now)
        if rate is None or not cases.planned:
            return None
        return max(0, cases.planned - cases.done) / rate


def rate_words(per_second: float | None) -> str:
    """A rate in the unit in which it is easily read; empty where there is none."""
    if per_second is None:
        return ""
    for unit, seconds in (("s", 1), ("min", 60)):
        if per_second * seconds >= 1:
            return f"{per_second * seconds:.1f} cases/{unit}"
    return f"{per_second * 3600:.1f} cases/h"


def time_words(seconds: float | None) -> str:
    """A length of time in two units at most: `45 s`, `2 min 5 s`, `3 h 20 min`, `2 d 3 h`."""
    if seconds is None:
        return ""
    whole = round(seconds)
    for (unit, size), (smaller, part) in ((("d", 86400), ("h", 3600)), (("h", 3600), ("min", 60)),
                                          (("min", 60), ("s", 1))):  # fmt: skip
        if whole >= size:
            rest = whole % size // part
            return f"{whole // size} {unit}" + (f" {rest} {smaller}" if rest else "")
    return f"{whole} s"
