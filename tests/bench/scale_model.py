"""A fleet of many workers as a simulation: one driver that hands out cases one after the other.

What is measured on one machine (the driver's time per case, what a case costs beyond its stack)
goes in; how long a job takes on more workers than a machine can hold comes out. Pure.
"""

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Costs:
    """Seconds: of the driver for each case, and of a worker for each case beyond its stack."""

    driver: float
    worker: float


def ends(cases: Sequence[float], workers: int, costs: Costs) -> list[float]:
    """When each of `cases` (the seconds of its stack) has ended, in seconds.

    The driver gives a case to the worker that is free first, and is busy with that for
    `costs.driver`; a case keeps its worker for its own time and `costs.worker`.
    """
    free = [0.0] * workers
    driver = 0.0
    found = []
    for seconds in cases:
        begun = max(heapq.heappop(free), driver) + costs.driver
        driver = begun
        ended = begun + seconds + costs.worker
        heapq.heappush(free, ended)
        found.append(ended)
    return found


def makespan(cases: Sequence[float], workers: int, costs: Costs) -> float:
    """Seconds until the last of the cases has ended."""
    return max(ends(cases, workers, costs), default=0.0)


def tail(cases: Sequence[float], workers: int, costs: Costs) -> float:
    """Seconds from the end of 95 of 100 cases to the end of the last."""
    found = sorted(ends(cases, workers, costs))
    return found[-1] - found[math.ceil(0.95 * len(found)) - 1]


def efficiency(cases: Sequence[float], workers: int, costs: Costs) -> float:
    """The share of the workers' time that the stacks had, from 0 to 1."""
    return sum(cases) / (workers * makespan(cases, workers, costs))
