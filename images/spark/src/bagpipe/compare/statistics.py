"""Differences of paired figures, with what chance alone would give. Deterministic."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

# Fewer pairs say nothing about chance, whatever the differences are.
LEAST_PAIRS = 5
_RESAMPLES = 4000
_CONFIDENCE = 0.95
# Resampling in slices keeps memory at some tens of MB for a hundred thousand pairs.
_SLICE_VALUES = 4_000_000


@dataclass(frozen=True)
class Difference:
    """Mean of (variant - baseline) with its 95 % interval; `effect` is Cohen's d of pairs.

    The interval is a percentile bootstrap over the pairs (Efron 1979).
    """

    pairs: int
    mean: float
    low: float
    high: float
    effect: float


def difference(baseline: Sequence[float], variant: Sequence[float]) -> Difference | None:
    """None for fewer than LEAST_PAIRS pairs, or where a figure is not finite."""
    differences = np.asarray(variant, dtype=float) - np.asarray(baseline, dtype=float)
    if len(differences) < LEAST_PAIRS or not np.isfinite(differences).all():
        return None
    mean = float(differences.mean())
    spread = float(differences.std(ddof=1))
    low, high = _interval(differences)
    effect = 0.0 if mean == 0 else math.copysign(math.inf, mean)
    if spread > 0:
        effect = mean / spread
    return Difference(len(differences), mean, low, high, effect)


def _interval(differences: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> tuple[float, float]:
    random = np.random.default_rng(0)
    count = len(differences)
    slice_size = max(1, _SLICE_VALUES // count)
    means = []
    for first in range(0, _RESAMPLES, slice_size):
        size = (min(slice_size, _RESAMPLES - first), count)
        means.append(differences[random.integers(0, count, size)].mean(axis=1))
    tail = (1 - _CONFIDENCE) / 2
    low, high = np.quantile(np.concatenate(means), [tail, 1 - tail])
    return float(low), float(high)


def chance_of(worse: int, better: int) -> float:
    """How likely so one-sided a split of changed cases is by chance: McNemar's exact test.

    1.0 where no case has changed. (McNemar 1947; the binomial form, two-sided.)
    """
    changed = worse + better
    if changed == 0:
        return 1.0
    few = min(worse, better)
    # Each binomial from the one before: all of them anew take minutes for some ten thousand cases.
    ways = term = 1
    for k in range(few):
        term = term * (changed - k) // (k + 1)
        ways += term
    return min(1.0, float(2 * ways / 2**changed))
