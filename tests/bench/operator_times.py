"""What is worked out of the moments that the operator's bench saw. Pure; all times in seconds."""

import math
from collections.abc import Iterable, Mapping, Sequence


def percentile(values: Iterable[float], share: float) -> float:
    """The least value that `share` (0 to 1) of all values do not exceed; ValueError for none."""
    ordered = sorted(values)
    if not ordered:
        raise ValueError("there is no percentile of no values: did anything happen at all?")
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)]


def delays(begun: Mapping[str, float], ended: Mapping[str, float]) -> list[float]:
    """Of each key its time from `begun` to `ended`; ValueError names keys that never ended.

    A watch may report an end before the answer to the request that began it is read: that is 0.
    """
    missing = sorted(begun.keys() - ended.keys())
    if missing:
        raise ValueError(f"{len(missing)} of {len(begun)} never got there, first {missing[0]}")
    return [max(0.0, ended[key] - moment) for key, moment in begun.items()]


def rate(begun: Sequence[float], ended: Sequence[float]) -> float:
    """How many ended in a second, from the first begin to the last end."""
    return len(ended) / (max(ended) - min(begun))


def staleness(now: float, running_since: float, reported: int | None, step: float) -> float:
    """How long a job's status has been out of date.

    Its driver's count becomes n at `running_since + n * step`, and the status says `reported`
    (None: nothing yet). It is out of date from the first change that it does not show.
    """
    next_change = running_since if reported is None else running_since + (reported + 1) * step
    return max(0.0, now - next_change)
