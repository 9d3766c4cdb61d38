"""Since when a series is another: a split of it that chance hardly explains. Pure."""

import statistics
from collections.abc import Sequence

from scipy.stats import fisher_exact, mannwhitneyu

# A split that is looked for in many places is found by chance in some of them: what chance gives is
# multiplied by their number (Bonferroni).
LEVEL = 0.01
# Fewer values on a side are never rare enough.
_LEAST_SIDE = 3


def more_fail_since(failed: Sequence[int], judged: Sequence[int]) -> int | None:
    """The run since which a larger share fails; None where chance explains it, or it is over.

    `failed` of `judged` in each run, oldest first. Fisher's exact test, one-sided, of all before
    against all since. What does not fail more often in the last run with evidence is over.
    """
    known = [run for run, many in enumerate(judged) if many]
    best: tuple[float, int] | None = None
    for at in known[1:]:
        before, since = _sums(failed, judged, 0, at), _sums(failed, judged, at, len(judged))
        if since[0] * before[1] <= before[0] * since[1]:
            continue
        table = [[since[0], since[1] - since[0]], [before[0], before[1] - before[0]]]
        chance = float(fisher_exact(table, alternative="greater").pvalue) * len(known[1:])
        if chance < LEVEL and (best is None or chance < best[0]):
            best = (chance, at)
    if best is None:
        return None
    before = _sums(failed, judged, 0, best[1])
    last = known[-1]
    return best[1] if failed[last] * before[1] > before[0] * judged[last] else None


def moved_since(values: Sequence[float | None]) -> int | None:
    """The run since which figures are others; None where chance explains it.

    One figure of each run, oldest first, None without one. The rank test of Mann and Whitney,
    two-sided; where several splits are as unlikely, the one with the medians furthest apart.
    """
    known = [(run, value) for run, value in enumerate(values) if value is not None]
    splits = range(_LEAST_SIDE, len(known) - _LEAST_SIDE + 1)
    best: tuple[float, float, int] | None = None
    for at in splits:
        before, since = [value for _, value in known[:at]], [value for _, value in known[at:]]
        test = mannwhitneyu(before, since, alternative="two-sided", method="asymptotic")
        chance = float(test.pvalue) * len(splits)
        apart = abs(statistics.median(since) - statistics.median(before))
        if chance < LEVEL and apart > 0 and (best is None or (chance, -apart) < best[:2]):
            best = (chance, -apart, known[at][0])
    return None if best is None else best[2]


def _sums(failed: Sequence[int], judged: Sequence[int], begin: int, end: int) -> tuple[int, int]:
    return sum(failed[begin:end]), sum(judged[begin:end])
