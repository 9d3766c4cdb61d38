"""Figures of two versions, criterion by criterion: better, worse, the same or undecided.

The recording is the unit: fragments of one recording, scenarios of one fragment and rounds of one
case share its luck, and are averaged first. Of the 5 % of comparisons of a version with itself
that may find something, 4 go to `worse`, which a gate is for, and 1 to `better`.
"""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Literal

import numpy as np

from bagpipe.compare.correction import family_size, holm
from bagpipe.compare.pairing import Rounds, Series, figures_of_both, titles
from bagpipe.compare.sign_flips import Figures, SignFlips
from bagpipe.counted import counted
from bagpipe.row_facts import Key

Word = Literal["better", "worse", "same", "unknown"]

# False alarms in all criteria of one comparison.
WORSE_LEVEL, BETTER_LEVEL = 0.04, 0.01
LEVEL = WORSE_LEVEL + BETTER_LEVEL
# Of a figure: means of the same numbers that differ by less do so by their rounding.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class CriterionComparison:
    """One criterion's figures, and what they come to.

    `baseline`, `variant` and `difference` are means over recordings; `low` and `high` the interval
    of the difference, corrected for the number of criteria, None for an end that so few recordings
    don't give; `chance` how likely a version gives so much against itself in any criterion.
    """

    name: str
    verdict: Word
    pairs: int
    recordings: int
    baseline: float | None
    variant: float | None
    difference: float | None
    low: float | None
    high: float | None
    effect: float | None
    chance: float | None
    unit: str
    message: str


@dataclass(frozen=True)
class Measured:
    """The figures of one criterion in both versions: one of each for every recording."""

    name: str
    unit: str
    direction: str
    pairs: int
    baseline: Sequence[float]
    variant: Sequence[float]

    @property
    def finite(self) -> bool:
        """Whether all figures are numbers that can be subtracted and added up."""
        return math.isfinite(sum(map(abs, [*self.baseline, *self.variant])))

    @property
    def differences(self) -> Figures:
        """Of each recording, the variant's less the baseline's; 0 where rounding explains it."""
        found = np.subtract(self.variant, self.baseline, dtype=np.float64)
        figures = np.maximum(np.abs(self.variant), np.abs(self.baseline))
        return np.where(np.abs(found) <= _ROUNDING * figures, 0.0, found)

    @property
    def sign(self) -> int:
        """What turns differences so that those above zero are worse."""
        return 1 if self.direction == "lower" else -1


@dataclass(frozen=True)
class _Side:
    """One criterion's chance on one side, and the share of chance its interval leaves out there."""

    chance: float
    tail: float


def measured(called: str, series: Series, pairs: Sequence[tuple[Rounds, Rounds]]) -> Measured:
    """What the cases that have the figure in both versions measured, by recording.

    What is infinite, such as the time to a collision that never comes, counts as twice the largest
    figure that is not: else one such recording would leave the whole criterion undecided.
    """
    both = ((now.recording, *figures_of_both(series, then, now)) for then, now in pairs)
    there = [each for each in both if each[1]]
    figures = [abs(figure) for _, then, now in there for figure in (*then, *now)]
    most = 2 * max(filter(math.isfinite, figures), default=0.0) or 1.0
    before, after = defaultdict(list), defaultdict(list)
    for recording, then, now in there:
        before[recording].append(fmean(_bounded(then, most)))
        after[recording].append(fmean(_bounded(now, most)))
    baseline = [fmean(found) for found in before.values()]
    variant = [fmean(found) for found in after.values()]
    return Measured(called, series.unit, series.better, len(there), baseline, variant)


def _bounded(figures: Sequence[float], most: float) -> list[float]:
    """NaN stays: it is no figure, however large."""
    return [math.copysign(most, each) if math.isinf(each) else each for each in figures]


def compared(
    series: Sequence[Series], pairs: Mapping[Key, tuple[Rounds, Rounds]]
) -> list[CriterionComparison]:
    """Every figure that has a better direction, each corrected for the others."""
    both, called = list(pairs.values()), titles(series)
    return judged([measured(called[each], each, both) for each in series])


def judged(all_measured: Sequence[Measured]) -> list[CriterionComparison]:
    """All criteria of one comparison, in their order."""
    tests = {
        at: SignFlips(one.sign * one.differences)
        for at, one in enumerate(all_measured)
        if one.pairs and one.finite
    }
    least = [test.least_chance for test in tests.values()]
    enough = _recordings_for(family_size(least, WORSE_LEVEL))
    needed = _recordings_for(sum(test.differing > 0 for test in tests.values()))
    worse = _sides([test.chance_above() for test in tests.values()], least, WORSE_LEVEL)
    better = _sides([test.chance_below() for test in tests.values()], least, BETTER_LEVEL)
    sides = dict(zip(tests, zip(worse, better, strict=True), strict=True))
    return [
        _decided(one, tests[at], *sides[at], needed if tests[at].differing < enough else 0)
        if at in tests
        else _undecided(
            one, "not every figure is a finite number" if one.pairs else "no pair has it"
        )
        for at, one in enumerate(all_measured)
    ]


def _recordings_for(criteria: int) -> int:
    """How many recordings can show that one of so many criteria is worse."""
    return math.ceil(math.log2(max(1, criteria) / WORSE_LEVEL))


def _sides(chances: Sequence[float], least: Sequence[float], level: float) -> list[_Side]:
    """Each criterion's corrected chance, and its tail: below it lies exactly what is a find."""
    size = family_size(least, level)
    asked = [at for at, chance in enumerate(least) if chance <= level / size]
    corrected = dict(zip(asked, holm([chances[at] for at in asked]), strict=True))
    found = sum(chance <= level for chance in corrected.values())
    order = sorted(asked, key=lambda at: chances[at])
    sides = []
    for at in range(len(chances)):
        if at not in corrected:
            sides.append(_Side(1.0, level / size))
            continue
        place = min(order.index(at), found)
        sides.append(_Side(corrected[at], level / (len(asked) - place)))
    return sides


def _decided(
    one: Measured, test: SignFlips, worse: _Side, better: _Side, needed: int
) -> CriterionComparison:
    """`needed` is how many recordings have to differ for a decision where too few do, else 0."""
    recordings = len(one.baseline)
    difference = fmean(one.variant) - fmean(one.baseline)
    chance = min(1.0, worse.chance * LEVEL / WORSE_LEVEL, better.chance * LEVEL / BETTER_LEVEL)
    message = f"{difference:+.4g} {one.unit}".strip() + f" in {_counted(one)}"
    low, high = test.ends(worse.tail, better.tail)
    if one.sign < 0:
        low, high = (None if end is None else -end for end in (high, low))
    verdict: Word = "same"
    if not test.differing:
        message = f"no figure differs in {_counted(one)}"
    elif worse.chance <= WORSE_LEVEL:
        verdict = "worse"
    elif better.chance <= BETTER_LEVEL:
        verdict = "better"
    elif needed:
        few = f", of which {test.differing} differ" if recordings >= needed else ""
        return _undecided(one, f"{message}{few}: {needed} recordings are needed to rule out chance")
    if test.differing:
        message += f" ({_interval(low, high)}chance {chance:.2g})"
    return CriterionComparison(
        one.name, verdict, one.pairs, recordings, fmean(one.baseline), fmean(one.variant),
        difference, low, high, _effect(one), chance, one.unit, message,
    )  # fmt: skip


def _undecided(one: Measured, why: str) -> CriterionComparison:
    baseline = variant = difference = None
    if one.pairs and one.finite:
        baseline, variant = fmean(one.baseline), fmean(one.variant)
        difference = variant - baseline
    return CriterionComparison(
        one.name, "unknown", one.pairs, len(one.baseline), baseline, variant, difference, None,
        None, None, None, one.unit, why,
    )  # fmt: skip


def _counted(one: Measured) -> str:
    recordings = len(one.baseline)
    return f"{counted(one.pairs, 'pair')} of {counted(recordings, 'recording')}"


def _interval(low: float | None, high: float | None) -> str:
    if low is None or high is None:
        return f"at least {low:+.4g}, " if low is not None else f"at most {high:+.4g}, "
    return f"{low:+.4g} to {high:+.4g}, "


def _effect(one: Measured) -> float | None:
    """The mean difference in standard deviations of the recordings' differences."""
    differences = one.differences
    if not differences.any():
        return None
    spread = float(differences.std(ddof=1))
    return float(differences.mean()) / spread if spread > 0 else None
