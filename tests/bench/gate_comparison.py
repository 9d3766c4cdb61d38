"""How often comparisons cry wolf, and how often they see one: simulated, since the truth is known.

A comparison is of 60 pairs, five fragments of each of 12 recordings, with ten criteria. A figure's
variance is 1: three quarters are the fragment's, in both versions, and one quarter is the run's,
of which fragments of one recording share a fifth and criteria of one fragment three tenths. Half a
standard deviation may be one of the figure, or one of the differences of pairs, which are closer to
each other; and it is harder to find in one of ten criteria than in the only one. All are printed.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from bagpipe.compare.compare import compare
from tests.bench.rows import Row

Figures = NDArray[np.float64]  # by recording, fragment, criterion

COMPARISONS = 2000
RECORDINGS, FRAGMENTS, CRITERIA = 12, 5, 10
_OF_RUN, _OF_RECORDING, _OF_CRITERIA = 0.25, 0.2, 0.3
_SHIFT = 0.5
# Nine of ten cases pass: ten figures, each of which is above this once in a hundred cases.
_LIMIT = 2.33
_LEVEL = 0.05

Alarm = Callable[[Figures, Figures], bool]


@dataclass(frozen=True)
class Scene:
    """What is true: so many standard deviations' shift, of so many of the criteria."""

    name: str
    criteria: int
    shifted: int
    shift: float

    @property
    def is_quiet(self) -> bool:
        """Whether both versions are the same."""
        return not self.shifted


# The spread of the differences of pairs, which is less than that of figures: cases are paired.
_OF_PAIRS = (2 * _OF_RUN) ** 0.5
A_A = Scene("A/A, 10 criteria", CRITERIA, 0, 0.0)
ONE = Scene("0.5 sd of the pairs' differences, 1 criterion", 1, 1, _SHIFT * _OF_PAIRS)
SCENES = (
    A_A,
    ONE,
    Scene("0.5 sd of the pairs' differences, 1 of 10", CRITERIA, 1, _SHIFT * _OF_PAIRS),
    Scene("0.5 sd of the pairs' differences, 10 of 10", CRITERIA, CRITERIA, _SHIFT * _OF_PAIRS),
    Scene("0.5 sd of the figure, 1 of 10", CRITERIA, 1, _SHIFT),
)


def rows() -> list[Row]:
    """Prints the table; raises AssertionError where it can't be what the project wants."""
    found = {scene: shares(scene, COMPARISONS) for scene in SCENES}
    print(f"\n{report(found)}", flush=True)
    quiet, loud = found[A_A]["bagpipe"], found[ONE]["bagpipe"]
    assert interval(quiet, COMPARISONS)[0] <= _LEVEL, f"{quiet} of {COMPARISONS} false alarms"
    assert interval(loud, COMPARISONS)[1] >= 0.8, f"found in {loud} of {COMPARISONS} alone"
    return [
        Row(f"comparison: {scene.name}", method, "alarms", [float(alarms)], "-", [])
        for scene, alarms_by in found.items()
        for method, alarms in alarms_by.items()
    ]


def shares(scene: Scene, comparisons: int, seed: int = 1) -> dict[str, int]:
    """In how many comparisons each method says that something has changed."""
    random = np.random.default_rng(seed)
    found = dict.fromkeys(METHODS, 0)
    for _ in range(comparisons):
        before, after = versions(scene, random)
        for name, alarm in METHODS.items():
            found[name] += alarm(before, after)
    return found


def versions(scene: Scene, random: np.random.Generator) -> tuple[Figures, Figures]:
    """The figures of one comparison."""
    shape = (RECORDINGS, FRAGMENTS, scene.criteria)
    shared = (1 - _OF_RUN) ** 0.5 * random.standard_normal(shape)
    before, after = (shared + _OF_RUN**0.5 * _luck(shape, random) for _ in range(2))
    after[..., : scene.shifted] += scene.shift
    return before, after


def _luck(shape: tuple[int, int, int], random: np.random.Generator) -> Figures:
    """Of variance 1, shared in part by the fragments of a recording and by a case's criteria."""

    def by_criterion(recordings: int, fragments: int) -> Figures:
        common = random.standard_normal((recordings, fragments, 1))
        own = random.standard_normal((recordings, fragments, shape[2]))
        drawn: Figures = _OF_CRITERIA**0.5 * common + (1 - _OF_CRITERIA) ** 0.5 * own
        return drawn

    of_recording = by_criterion(shape[0], 1)
    own = by_criterion(shape[0], shape[1])
    luck: Figures = _OF_RECORDING**0.5 * of_recording + (1 - _OF_RECORDING) ** 0.5 * own
    return luck


def _bagpipe(before: Figures, after: Figures) -> bool:
    """The whole comparison, from rows as results.jsonl has them."""
    rows = [*_lines(before, "before"), *_lines(after, "after")]
    [found] = compare(rows, ["before", "after"])
    return found.verdict in {"worse", "better"}


def _lines(figures: Figures, variant: str) -> Iterator[dict[str, Any]]:
    for recording, fragments in enumerate(figures.tolist()):
        for number, criteria in enumerate(fragments):
            name = f"{recording}-{number}"
            yield {
                "case": f"{name}-{variant}", "fragment": name, "variant": variant,
                "bag": f"pvc://r/{recording}.bag", "outcome": "passed",
                "criteria": [
                    {"name": f"c{at}", "figure": figure, "direction": "lower"}
                    for at, figure in enumerate(criteria)
                ],
            }  # fmt: skip


def _naive_pairs(before: Figures, after: Figures) -> bool:
    """Student's t over all pairs, criterion by criterion, as if none had to do with another."""
    differences = (after - before).reshape(-1, after.shape[-1])
    return bool((stats.ttest_1samp(differences, 0.0).pvalue < _LEVEL).any())


def _passed(figures: Figures) -> int:
    return int((figures < _LIMIT).all(axis=2).sum())


def _lower_rate(before: Figures, after: Figures) -> bool:
    return _passed(after) < _passed(before)


def _tested_rates(before: Figures, after: Figures) -> bool:
    """By Fisher's exact test of two independent samples."""
    cases = RECORDINGS * FRAGMENTS
    table = [[passed, cases - passed] for passed in (_passed(before), _passed(after))]
    return bool(stats.fisher_exact(table).pvalue < _LEVEL)


METHODS: dict[str, Alarm] = {
    "bagpipe": _bagpipe,
    "naive pairs": _naive_pairs,
    "lower pass rate": _lower_rate,
    "pass rates, tested": _tested_rates,
}


def interval(alarms: int, comparisons: int) -> tuple[float, float]:
    """Of 95 %, by Clopper and Pearson."""
    found = stats.binomtest(alarms, comparisons).proportion_ci(0.95, method="exact")
    return float(found.low), float(found.high)


def report(found: dict[Scene, dict[str, int]], comparisons: int = COMPARISONS) -> str:
    """A table: false alarms where nothing changed, else how often the change was found."""
    lines = [
        f"Alarms in {comparisons:,} comparisons of 60 pairs from 12 recordings (95 % interval):",
        f"| what is true | {' | '.join(METHODS)} |", "|---" * (1 + len(METHODS)) + "|",
    ]  # fmt: skip
    for scene, alarms in found.items():
        cells = []
        for count in alarms.values():
            low, high = interval(count, comparisons)
            cells.append(f"{count / comparisons:.1%} ({low:.1%} to {high:.1%})")
        word = "false alarms" if scene.is_quiet else "found"
        lines.append(f"| {scene.name}: {word} | {' | '.join(cells)} |")
    return "\n".join(lines)
