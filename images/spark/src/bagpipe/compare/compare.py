"""Variants against a baseline, over the cases that both have: per case, per criterion, in all."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from statistics import fmean
from typing import Any, Literal

from bagpipe.compare.pairing import Key, Rounds, Row, rounds_of
from bagpipe.compare.statistics import LEAST_PAIRS, chance_of, difference

Word = Literal["better", "worse", "same", "unknown"]

# How many cases are named; the results have all.
MOST_NAMED = 50


@dataclass(frozen=True)
class CriterionComparison:
    """One criterion's figures: means, the difference, its 95 % interval, and what it comes to."""

    name: str
    verdict: Word
    pairs: int
    baseline: float | None
    variant: float | None
    difference: float | None
    low: float | None
    high: float | None
    effect: float | None
    unit: str
    message: str


@dataclass(frozen=True)
class Comparison:
    """One variant against the baseline.

    `regressed`, `fixed` and `flaky` name cases of the variant, `missing` those of the baseline that
    the variant lacks, at most MOST_NAMED of each; `counts` has their numbers, and those of `same`,
    `unknown` and `unpaired`, the cases that only one of the two has.
    """

    variant: str
    baseline: str
    verdict: Word
    message: str
    counts: dict[str, int]
    regressed: list[str]
    fixed: list[str]
    flaky: list[str]
    chance: float
    criteria: list[CriterionComparison] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """As it stands in comparison.json."""
        return asdict(self)


def compare(
    rows: Iterable[Row], variants: list[str], earlier: Iterable[Row] | None = None
) -> list[Comparison]:
    """Each variant against the first one, or all of them against an earlier job's rows.

    Of an earlier job with variants its first one counts. A case that is flaky in either version
    is told as such and never as a regression.
    """
    rows = list(rows)
    by_variant = rounds_of(rows)
    units = _units(rows)
    names = variants or [""]
    if earlier is None:
        baseline, others = by_variant.get(names[0], {}), names[1:]
        called = names[0]
    else:
        before = rounds_of(earlier)
        baseline, others = next(iter(before.values()), {}), names
        called = "the earlier job"
    return [_compared(name, called, baseline, by_variant.get(name, {}), units) for name in others]


def _units(rows: Iterable[Row]) -> dict[str, tuple[str, str]]:
    """Each criterion's unit and the direction that is better."""
    return {
        finding["name"]: (finding.get("unit", ""), finding["direction"])
        for row in rows
        for finding in row.get("criteria") or []
        if finding.get("direction")
    }


def _compared(
    name: str,
    called: str,
    baseline: Mapping[Key, Rounds],
    variant: Mapping[Key, Rounds],
    units: Mapping[str, tuple[str, str]],
) -> Comparison:
    both = [key for key in variant if key in baseline]
    named: dict[str, list[str]] = {"regressed": [], "fixed": [], "flaky": []}
    counts = dict.fromkeys(("regressed", "fixed", "flaky", "same", "unknown"), 0)
    for key in both:
        change = _change(baseline[key].outcome, variant[key].outcome)
        counts[change] += 1
        if change in named and len(named[change]) < MOST_NAMED:
            named[change].append(variant[key].cases[0])
    missing = [rounds.cases[0] for key, rounds in baseline.items() if key not in variant]
    counts["missing"] = len(missing)
    counts["unpaired"] = len(missing) + len(variant) - len(both)
    criteria = [
        _criterion(criterion, unit, direction, [(baseline[k], variant[k]) for k in both])
        for criterion, (unit, direction) in units.items()
    ]
    verdict, message = _verdict(counts, criteria)
    chance = chance_of(counts["regressed"], counts["fixed"])
    return Comparison(
        name, called, verdict, message, counts, **named, chance=chance, criteria=criteria,
        missing=missing[:MOST_NAMED],
    )  # fmt: skip


def _change(before: str, after: str) -> str:
    if "flaky" in {before, after}:
        return "flaky"
    if "unknown" in {before, after}:
        return "unknown"
    if before == after:
        return "same"
    return "regressed" if after == "failed" else "fixed"


def _criterion(
    name: str, unit: str, direction: str, pairs: list[tuple[Rounds, Rounds]]
) -> CriterionComparison:
    """Rounds of a case are one pair: their mean, since they are no cases of their own."""
    means = [
        (fmean(before.figures[name]), fmean(after.figures[name]))
        for before, after in pairs
        if before.figures.get(name) and after.figures.get(name)
    ]
    baseline, variant = [b for b, _ in means], [v for _, v in means]
    found = difference(baseline, variant)
    if found is None:
        few = f"{len(means)} pairs of figures, and at least {LEAST_PAIRS} finite ones are needed"
        return CriterionComparison(
            name, "unknown", len(means), _mean(baseline), _mean(variant), None, None, None, None,
            unit, few,
        )  # fmt: skip
    sign = 1 if direction == "higher" else -1
    ends = sorted((sign * found.low, sign * found.high))
    verdict: Word = "better" if ends[0] > 0 else "worse" if ends[1] < 0 else "same"
    message = (
        f"{found.mean:+.4g} {unit} (95 % interval {found.low:+.4g} to {found.high:+.4g})".strip()
    )
    return CriterionComparison(
        name, verdict, found.pairs, fmean(baseline), fmean(variant), found.mean, found.low,
        found.high, found.effect if math.isfinite(found.effect) else None, unit, message,
    )  # fmt: skip


def _mean(figures: list[float]) -> float | None:
    return fmean(figures) if figures and all(map(math.isfinite, figures)) else None


def _verdict(counts: Mapping[str, int], criteria: list[CriterionComparison]) -> tuple[Word, str]:
    """A regressed case or a worse criterion is worse, whatever else got better."""
    worse = [c.name for c in criteria if c.verdict == "worse"]
    better = [c.name for c in criteria if c.verdict == "better"]
    said = ", ".join(
        f"{counts[word]} {word}"
        for word in ("regressed", "fixed", "flaky", "unknown")
        if counts[word]
    )
    compared = sum(counts[word] for word in ("regressed", "fixed", "flaky", "same"))
    said = f"{said or 'no case changed'} of {compared + counts['unknown']} cases"
    if worse:
        said += f"; worse in {', '.join(worse)}"
    if better:
        said += f"; better in {', '.join(better)}"
    new = counts["unpaired"] - counts["missing"]
    alone = [f"{n} {word}" for n, word in ((counts["missing"], "missing"), (new, "new")) if n]
    lone = f"; {', '.join(alone)}" if alone else ""
    said += lone
    if counts["regressed"] or worse:
        return "worse", said
    if not compared:
        return "unknown", f"no case of both could be compared{lone}"
    return ("better" if counts["fixed"] or better else "same"), said
