"""A difference of two versions, over recordings: what of it may be chance. Deterministic.

Were both versions the same, the difference of each recording could as well have the other sign.
So the chance is the share of all ways to flip signs that give as large a mean (Fisher 1935). It
is exact whatever the figures' distribution is; a test by Student's t or a bootstrap is not for
few recordings. The interval holds those differences that the same test would not refuse: its
ends are among the means of all subsets of the recordings (Hartigan 1969).
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Figures = NDArray[np.float64]

# All ways for up to 14 recordings; for more, as many random ones, with the observed one among them.
EXACT_BELOW = 15
_WAYS = 1 << (EXACT_BELOW - 1)
_BLOCK = 64
# Of the sum of a subset's amounts: sums that differ by less are equal but for their rounding.
_ROUNDING = 1e-12


class SignFlips:
    """The test of one figure; `differences` has one number for each recording."""

    def __init__(self, differences: Figures) -> None:
        sums, sizes = _subsets(differences)
        amounts, _ = _subsets(np.abs(differences))
        sums[np.abs(sums) <= _ROUNDING * amounts] = 0.0
        self._sums = sums
        self._sizes = sizes
        self._ways = len(sums) + 1
        self.differing = int(np.count_nonzero(differences))

    @property
    def least_chance(self) -> float:
        """The chance if all differences had one sign."""
        return max(2.0**-self.differing, 1 / self._ways)

    def chance_above(self) -> float:
        """The chance of so large a mean, were the true one zero or less."""
        return float(1 + np.count_nonzero(self._sums <= 0)) / self._ways

    def chance_below(self) -> float:
        """The chance of so small a mean, were the true one zero or more."""
        return float(1 + np.count_nonzero(self._sums >= 0)) / self._ways

    def ends(self, below: float, above: float) -> tuple[float | None, float | None]:
        """The interval that leaves these shares out on its two sides.

        An end is None where so few recordings can leave no so small a share out.
        """
        means = np.sort(self._sums / self._sizes)
        low, high = (int(tail * self._ways * (1 + 1e-9)) - 1 for tail in (below, above))
        return (
            float(means[low]) if low >= 0 else None,
            float(means[-1 - high]) if high >= 0 else None,
        )


def _subsets(differences: Figures) -> tuple[Figures, Figures]:
    """Sum and size of each subset of the recordings that is looked at."""
    members = _members(len(differences))
    sums = np.zeros(len(members))
    for first in range(0, len(differences), _BLOCK):
        block = slice(first, first + _BLOCK)
        sums += members[:, block].astype(np.float64) @ differences[block]
    return sums, np.maximum(1, members.sum(axis=1, dtype=np.float64))


@lru_cache(maxsize=4)
def _members(count: int) -> NDArray[np.uint8]:
    """A line for each subset, 1 where a recording is in it: all but the empty one, or some."""
    if count < EXACT_BELOW:
        numbers = np.arange(1, 1 << count, dtype=np.uint32)[:, None]
        return (numbers >> np.arange(count, dtype=np.uint32) & 1).astype(np.uint8)
    random = np.random.default_rng(0)
    return random.integers(0, 2, (_WAYS - 1, count), dtype=np.uint8)
