"""Rows of two versions brought together: the same fragment under the same values, in all rounds."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

from bagpipe.compare.delivery import FIGURES, LOSS, delivery, left_out
from bagpipe.row_facts import Key, figures_of, key_of, quarantine_of

Row = Mapping[str, Any]


class Series(NamedTuple):
    """Figures that can be compared: those of one criterion in one unit, as one kind of measurement
    gives them, of which the `better` are `lower` or `higher`.

    A criterion with several bounds has several, and so has one that took another's name.
    """

    name: str
    unit: str
    kind: str
    better: str


# The share of a case's rounds that passed: each of many cases may lose too few to be significant.
ROUNDS = Series("rounds: passed", "%", "", "higher")


@dataclass
class Rounds:
    """What one version did in one case, round by round.

    `figures` has what each criterion measured. `recording` says with which other
    cases it may share its luck: those of the same recording are not independent of each other.
    """

    recording: str
    cases: list[str] = field(default_factory=list)
    outcomes: list[str] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    figures: dict[Series, list[float]] = field(default_factory=lambda: defaultdict(list))

    def add(self, row: Row) -> None:
        """One more round."""
        self.cases.append(row["case"])
        self.outcomes.append(row["outcome"])
        self.reasons.append(str(row.get("reason") or ""))
        for finding in row.get("criteria") or []:
            for each in figures_of(finding):
                if each.get("figure") is not None and each.get("direction"):
                    self.figures[_series(finding, each)].append(float(each["figure"]))
        self.figures[ROUNDS].append(100.0 * (row["outcome"] == "passed"))
        for series, figure in _delivered(row).items():
            self.figures[series].append(figure)

    def joined(self, other: Self) -> Self:
        """These rounds and other ones of the same case."""
        both = defaultdict(list, {key: list(figures) for key, figures in self.figures.items()})
        for key, figures in other.figures.items():
            both[key] += figures
        return replace(
            self,
            cases=self.cases + other.cases,
            outcomes=self.outcomes + other.outcomes,
            reasons=self.reasons + other.reasons,
            figures=both,
        )

    @property
    def passed(self) -> int:
        """How many of the rounds passed."""
        return self.outcomes.count("passed")

    @property
    def steady(self) -> bool:
        """Whether all rounds passed, or none."""
        return self.passed in {0, len(self.outcomes)}

    @property
    def worst(self) -> str:
        """`passed` where all rounds did; else how most of the others ended, `failed` first."""
        others = Counter(outcome for outcome in self.outcomes if outcome != "passed")
        return max(others, key=lambda word: (others[word], word == "failed"), default="passed")

    def reason_of(self, outcome: str) -> str:
        """The first reason that was given for such an outcome."""
        found = zip(self.outcomes, self.reasons, strict=True)
        return next((reason for word, reason in found if word == outcome), "")


@dataclass
class Versions:
    """Rows by variant, and the series of their figures, in the order of the first rows.

    Those in quarantine are apart: they don't count as what a version does now, and do as what one
    did before, which nobody can change any more.
    """

    of: dict[str, dict[Key, Rounds]] = field(default_factory=lambda: defaultdict(dict))
    quarantined: dict[str, dict[Key, Rounds]] = field(default_factory=lambda: defaultdict(dict))
    series: dict[Series, None] = field(default_factory=dict)

    @classmethod
    def read(cls, rows: Iterable[Row]) -> Self:
        """Each row is looked at once and not kept."""
        found = cls()
        delivered: dict[Series, None] = {}
        for row in rows:
            variant = str(row.get("variant") or "")
            cases = found.of[variant]  # also where all are in quarantine: its keys are in order
            cases = cases if quarantine_of(row) is None else found.quarantined[variant]
            cases.setdefault(key_of(row), Rounds(recording_of(row))).add(row)
            for finding in row.get("criteria") or []:
                for each in figures_of(finding):
                    if each.get("direction"):
                        found.series[_series(finding, each)] = None
            delivered |= dict.fromkeys(_delivered(row))
        found.series |= delivered | {ROUNDS: None}
        return found

    def all_of(self, variant: str) -> dict[Key, Rounds]:
        """All rounds of a variant, also those in quarantine."""
        found = dict(self.of.get(variant, {}))
        for key, rounds in self.quarantined.get(variant, {}).items():
            found[key] = found[key].joined(rounds) if key in found else rounds
        return found


def titles(series: Iterable[Series]) -> dict[Series, str]:
    """What each is called: its criterion's name, with what distinguishes it where that one has
    several.
    """
    by_name: dict[str, list[Series]] = defaultdict(list)
    for each in series:
        by_name[each.name].append(each)
    return {each: _title(each, others) for others in by_name.values() for each in others}


def _title(one: Series, others: list[Series]) -> str:
    if len(others) == 1:
        return one.name
    units, kinds = {each.unit for each in others}, {each.kind for each in others}
    if len(units) == len(kinds) == 1:
        return f"{one.name} ({one.better} is better)"
    words = [one.unit] if len(units) > 1 else []
    words += [one.kind] if len(kinds) > 1 else []
    return f"{one.name} ({', '.join(filter(None, words))})" if any(words) else one.name


def _series(finding: Mapping[str, Any], figure: Mapping[str, Any]) -> Series:
    unit, kind = str(figure.get("unit") or ""), str(finding.get("kind") or "")
    return Series(finding["name"], unit, kind, str(figure["direction"]))


def _delivered(row: Row) -> dict[Series, float]:
    """What was lost on the way, of the nodes that are counted."""
    found = {}
    for name, figure in delivery(row).items():
        unit, better = FIGURES[name]
        found[Series(name, unit, left_out(row) if name == LOSS else "", better)] = figure
    return found


def recording_of(row: Row) -> str:
    """What a case was played from: a bag, the bags of its pieces, or one world of a simulator.

    The seeds of one simulated scenario share that scenario; there is no recording behind them.
    """
    parts = sorted({str(part["bag"]) for part in row.get("parts") or []})
    if parts:
        return "+".join(parts)
    bag = str(row.get("bag") or "")
    if "://" in bag:  # where no single recording was played, it is a word of the source's
        return bag
    fragment, values, _ = key_of(row)
    return f"{fragment} {values}"
