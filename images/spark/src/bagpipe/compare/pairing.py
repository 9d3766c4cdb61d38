"""Rows of two versions brought together: the same fragment under the same values, in all rounds."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self, TypeVar

from bagpipe.compare.delivery import DISCARDED, FIGURES, LOSS, delivery, left_out
from bagpipe.row_facts import (
    NOTHING_PLAYED,
    Key,
    figures_of,
    key_of,
    of_other_measures,
    quarantine_of,
)

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
# What was lost on the way.
LOSSES, DISCARDS = (Series(name, unit, "", better) for name, (unit, better) in FIGURES.items())


@dataclass
class Rounds:
    """What one version did in one case, round by round.

    `figures` has what each criterion measured, `marks` what that is where it is known, and
    `losses` the shares of messages that were lost, by what they are without (left_out), also where
    nothing is left. `recording` says with which other cases it may share its luck: those of the
    same recording are not independent of each other. `windows` are the parts of it that were
    judged, in ns since 1970, and `files` the marks of each of its files when it was planned.
    `invalid` names criteria that were in some round: what little they were judged on is no figure.
    """

    recording: str
    cases: list[str] = field(default_factory=list)
    outcomes: list[str] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    figures: dict[Series, list[float]] = field(default_factory=lambda: defaultdict(list))
    marks: dict[Series, set[str]] = field(default_factory=lambda: defaultdict(set))
    losses: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    windows: set[tuple[int, int]] = field(default_factory=set)
    files: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))
    invalid: set[str] = field(default_factory=set)

    def add(self, row: Row) -> None:
        """One more round."""
        self.cases.append(row["case"])
        self.outcomes.append(row["outcome"])
        self.reasons.append(str(row.get("reason") or ""))
        if row.get("window"):
            _, start, end = row["window"]
            self.windows.add((start, end))
        # A folder's own mark is that of its metadata alone.
        for file in [{"bag": row.get("bag"), "version": row.get("bag_version")}, *_parts(row)]:
            if file.get("version"):
                self.files[str(file["bag"])].add(str(file["version"]))
        for finding in row.get("criteria") or []:
            self._add_finding(finding)
        self.figures[ROUNDS].append(100.0 * (row["outcome"] == "passed"))
        delivered = delivery(row)
        self.figures[DISCARDS].append(delivered[DISCARDED])
        without = left_out(row)
        if without or LOSS in delivered:
            self.losses[without] += [delivered[LOSS]] if LOSS in delivered else []

    def _add_finding(self, finding: Row) -> None:
        if finding.get("outcome") == "invalid":
            self.invalid.add(str(finding.get("name") or ""))
            return
        for each in figures_of(finding):
            if each.get("figure") is not None and each.get("direction"):
                series = _series(finding, each)
                self.figures[series].append(float(each["figure"]))
                self.marks[series].add(str(each.get("measures") or ""))

    def joined(self, other: Self) -> Self:
        """These rounds and other ones of the same case."""
        figures, losses = _merged(self.figures, other.figures), _merged(self.losses, other.losses)
        return replace(
            self,
            cases=self.cases + other.cases,
            outcomes=self.outcomes + other.outcomes,
            reasons=self.reasons + other.reasons,
            figures=figures,
            losses=losses,
            windows=self.windows | other.windows,
            marks=_both(self.marks, other.marks),
            files=_both(self.files, other.files),
            invalid=self.invalid | other.invalid,
        )

    @property
    def passed(self) -> int:
        """How many of the rounds passed."""
        return self.outcomes.count("passed")

    @property
    def had_input(self) -> bool:
        """Whether something was played in a round: of other cases nothing is missed."""
        return set(self.reasons) != {NOTHING_PLAYED}

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
        for row in rows:
            variant = str(row.get("variant") or "")
            cases = found.of[variant]  # also where all are in quarantine: its keys are in order
            cases = cases if quarantine_of(row) is None else found.quarantined[variant]
            cases.setdefault(key_of(row), Rounds(recording_of(row))).add(row)
            for finding in row.get("criteria") or []:
                for each in figures_of(finding):
                    if each.get("direction"):
                        found.series[_series(finding, each)] = None
        versions = [*found.of.values(), *found.quarantined.values()]
        lost = any(any(each.losses.values()) for cases in versions for each in cases.values())
        found.series |= dict.fromkeys([DISCARDS, *([LOSSES] if lost else []), ROUNDS])
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
    return {each: title for others in by_name.values() for each, title in _titles(others)}


def _titles(alike: list[Series]) -> Iterator[tuple[Series, str]]:
    """Of series of one name."""
    units, kinds = {each.unit for each in alike}, {each.kind for each in alike}
    for one in alike:
        words = [one.unit] if len(units) > 1 else []
        words += [one.kind] if len(kinds) > 1 else []
        if len(alike) > 1 and len(units) == len(kinds) == 1:
            words = [f"{one.better} is better"]
        yield one, f"{one.name} ({', '.join(filter(None, words))})" if any(words) else one.name


def figures_of_both(
    series: Series, then: Rounds, now: Rounds
) -> tuple[Sequence[float], Sequence[float]]:
    """What can be compared of a case, both empty where nothing can: of losses those that are
    without as many nodes.
    """
    before, after = then.figures.get(series) or (), now.figures.get(series) or ()
    if measures_differ(series, then, now):
        return (), ()
    if series == LOSSES:
        both = {each: (then.losses[each], now.losses.get(each, [])) for each in then.losses}
        before, after = max(both.values(), key=lambda of: min(map(len, of)), default=((), ()))
    return (before, after) if before and after else ((), ())


def measures_differ(series: Series, then: Rounds, now: Rounds) -> bool:
    """Whether a criterion is known to have measured something else under the same name."""
    return of_other_measures(then.marks.get(series, set()), now.marks.get(series, set()))


def measured_no_more(series: Series, then: Rounds, now: Rounds) -> bool:
    """Whether a case has no figure any more because its criterion is invalid in all rounds."""
    lacks = bool(then.figures.get(series)) and not now.figures.get(series)
    return lacks and series.name in now.invalid


def windows_differ(then: Rounds, now: Rounds) -> bool:
    """Whether both are known to have judged another part of the recording: no figure of one, and
    no outcome, says anything of the other.
    """
    return bool(then.windows and now.windows and then.windows != now.windows)


def files_differ(then: Rounds, now: Rounds) -> bool:
    """Whether a file of the recording of one name was another one."""
    both = then.files.keys() & now.files if then.recording == now.recording else ()
    return any(then.files[file] != now.files[file] for file in both)


def losses_differ(then: Rounds, now: Rounds) -> bool:
    """Whether both versions had losses counted, or nodes that nobody counts, and not alike."""
    some = any(then.losses.values()) or any(now.losses.values())
    return bool(some and then.losses and now.losses and not figures_of_both(LOSSES, then, now)[0])


def _parts(row: Row) -> list[Row]:
    return list(row.get("parts") or [])


_K = TypeVar("_K")


def _merged(one: dict[_K, list[float]], other: dict[_K, list[float]]) -> dict[_K, list[float]]:
    both = defaultdict(list, {key: list(figures) for key, figures in one.items()})
    for key, figures in other.items():
        both[key] += figures
    return both


def _both(one: Mapping[_K, set[str]], other: Mapping[_K, set[str]]) -> dict[_K, set[str]]:
    both = defaultdict(set, {key: set(marks) for key, marks in one.items()})
    for key, marks in other.items():
        both[key] |= marks
    return both


def _series(finding: Mapping[str, Any], figure: Mapping[str, Any]) -> Series:
    unit, kind = str(figure.get("unit") or ""), str(finding.get("kind") or "")
    return Series(finding["name"], unit, kind, str(figure["direction"]))


def recording_of(row: Row) -> str:
    """What a case was played from: a recording, the bags of its pieces, or a simulator's world.

    The seeds of one simulated scenario share that scenario; there is no recording behind them.
    """
    bag = str(row.get("bag") or "")
    if "://" in bag:  # where no single recording was played, it is a word of the source's
        return bag
    parts = sorted({str(part["bag"]) for part in _parts(row)})
    if parts:
        return "+".join(parts)
    fragment, values, _ = key_of(row)
    return f"{fragment} {values}"
