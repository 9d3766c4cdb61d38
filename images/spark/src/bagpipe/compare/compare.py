"""Variants against a baseline, over the cases that both have: per case, per criterion, in all."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, get_args

from bagpipe.compare.changes import Change, changes, lost_together, passes_less_often
from bagpipe.compare.changes import Word as ChangeWord
from bagpipe.compare.criteria import CriterionComparison, Word, compared
from bagpipe.compare.delivery import FIGURES
from bagpipe.compare.pairing import (
    ROUNDS,
    Rounds,
    Row,
    Series,
    Versions,
    files_differ,
    losses_differ,
    measured_no_more,
    measures_differ,
    titles,
    windows_differ,
)
from bagpipe.counted import counted
from bagpipe.row_facts import Key

# How many cases are named; the results have all.
MOST_NAMED = 50

_WORDS: tuple[ChangeWord, ...] = get_args(ChangeWord)
# By name, unit and kind.
_Measured = dict[tuple[str, str, str], set[Series]]
_BECAME = ("failed", "invalid", "errored", "missing")


@dataclass(frozen=True)
class Comparison:
    """One variant against the baseline.

    `doubtful` is how many cases pass less often now, and not by chance, and were not compared since
    another part of the recording was played.

    `regressed` has maps of a case of the variant, what it came `to` and the `reason`; of a missing
    one the baseline's name. `fixed` and `flaky` name cases of the variant, `missing` those of the
    baseline that the variant lacks. At most MOST_NAMED are named of each; `counts` has all their
    numbers, and those of `same`, `unknown` and `new`; `became` is what the regressed came to.
    `quarantined` is what would be regressed and is in quarantine: it is in no other list or number.
    """

    variant: str
    baseline: str
    verdict: Word
    message: str
    counts: dict[str, int]
    became: dict[str, int]
    regressed: list[dict[str, str]]
    fixed: list[str]
    flaky: list[str]
    missing: list[str]
    criteria: list[CriterionComparison] = field(default_factory=list)
    quarantined: list[dict[str, str]] = field(default_factory=list)
    doubtful: int = 0

    def as_json(self) -> dict[str, Any]:
        """As it stands in comparison.json."""
        return asdict(self)


def compare(
    rows: Iterable[Row], variants: list[str], earlier: Iterable[Row] | None = None
) -> list[Comparison]:
    """Each variant against the first one, or all of them against an earlier job's rows.

    Of an earlier job with variants its first one counts.
    """
    now = Versions.read(rows)
    names = variants or [""]
    if earlier is None:
        baseline, others = now.all_of(names[0]), names[1:]
        called, series = names[0], now.series
    else:
        before = Versions.read(earlier)
        baseline = next((before.all_of(variant) for variant in before.of), {})
        others = names
        called, series = "the earlier job", before.series | now.series
    return [_compared(name, called, baseline, now, list(series)) for name in others]


def _compared(
    name: str,
    called: str,
    baseline: Mapping[Key, Rounds],
    now: Versions,
    series: list[Series],
) -> Comparison:
    variant, quarantined = now.of.get(name, {}), now.quarantined.get(name, {})
    found = changes(baseline, variant)
    missing = {
        key: rounds
        for key, rounds in baseline.items()
        if key not in variant and key not in quarantined and rounds.had_input
    }
    gone = [rounds for rounds in missing.values() if rounds.worst == "passed"]
    regressed = _regressed(found, variant)
    hidden = _regressed(changes(baseline, quarantined), quarantined)
    regressed += [{"case": rounds.cases[0], "to": "missing", "reason": ""} for rounds in gone]
    became = Counter(case["to"] for case in regressed)
    words = Counter(change.word for change in found.values())
    counts: dict[str, int] = {word: words[word] for word in _WORDS} | {
        "regressed": len(regressed), "missing": len(missing), "new": len(variant) - len(found),
        "quarantined": len(hidden),
    }  # fmt: skip
    both = [(baseline[key], variant[key]) for key in found]
    pairs = {
        key: (baseline[key], variant[key])
        for key in found
        if not windows_differ(baseline[key], variant[key])
    }
    if all(len(rounds.outcomes) == 1 for pair in pairs.values() for rounds in pair):
        series = [each for each in series if each != ROUNDS]
    criteria = compared(series, pairs)
    criteria = [one for one in criteria if one.name not in FIGURES or _says_something(one)]
    doubtful = _doubtful(baseline, variant)
    verdict, message = _verdict(counts, became, criteria)
    verdict = "unknown" if doubtful and verdict in ("same", "better") else verdict
    fails = sum(variant[key].worst != "passed" for key in variant.keys() - found.keys())
    message += f" ({fails} not passed)" if fails else ""
    called_by = titles(series)
    measured = _measured(baseline), _measured(variant)
    unmeasured, turned = _unmeasured(*measured, called_by), _turned(*measured, called_by)
    unmeasured += _unmeasured_in_some(measured[1], pairs.values(), called_by)
    message += f"; {len(hidden)} worse in quarantine" if hidden else ""
    message += f"; measured no more: {', '.join(unmeasured)}" if unmeasured else ""
    message += (
        f"; not compared, as the other way is better now: {', '.join(turned)}" if turned else ""
    )
    message += _of_other_measures(series, pairs.values(), called_by)
    message += _of_pairs(both, doubtful)
    return Comparison(
        name, called, verdict, message, counts, {word: became[word] for word in _BECAME},
        regressed=regressed[:MOST_NAMED], fixed=_named("fixed", found, variant),
        flaky=_named("flaky", found, variant),
        missing=[rounds.cases[0] for rounds in missing.values()][:MOST_NAMED], criteria=criteria,
        quarantined=hidden[:MOST_NAMED], doubtful=doubtful,
    )  # fmt: skip


def _doubtful(baseline: Mapping[Key, Rounds], variant: Mapping[Key, Rounds]) -> int:
    """How many cases of another part of the recording pass less often.

    None where chance explains it: in the same part none of them would have regressed, and their
    rounds together do not pass so much less often, either.
    """
    found = changes(baseline, variant, of_any_window=True)
    other = [key for key in found if windows_differ(baseline[key], variant[key])]
    fewer = [key for key in other if passes_less_often(baseline[key], variant[key])]
    certain = any(found[key].word == "regressed" for key in fewer)
    together = lost_together([(baseline[key], variant[key]) for key in other])
    return len(fewer) if certain or together else 0


def _of_pairs(pairs: Sequence[tuple[Rounds, Rounds]], doubtful: int) -> str:
    """In how many pairs something was not alike, after a semicolon; else nothing."""
    uncounted = sum(losses_differ(before, after) for before, after in pairs)
    other = sum(before.recording != after.recording for before, after in pairs)
    windows = sum(windows_differ(before, after) for before, after in pairs)
    files = sum(files_differ(before, after) for before, after in pairs)
    message = f"; {windows} of another part of the recording than there" if windows else ""
    message += f" ({doubtful} pass less often now)" if doubtful else ""
    message += f"; {files} played from a file that has changed since" if files else ""
    if uncounted:
        message += f"; losses not compared in {counted(uncounted, 'case')}, in which"
        message += " not as many nodes are counted as there"
    return message + (f"; {other} played from another recording than there" if other else "")


def _regressed(found: Mapping[Key, Change], variant: Mapping[Key, Rounds]) -> list[dict[str, str]]:
    return [
        {"case": variant[key].cases[0], "to": change.to, "reason": change.reason}
        for key, change in found.items()
        if change.word == "regressed"
    ]


def _unmeasured(before: _Measured, now: _Measured, called: Mapping[Series, str]) -> list[str]:
    """Figures of which the variant has not one: nothing would say that they are gone.

    One of several bounds may be gone alone, as where a criterion has one less now; and which way a
    figure is better may have changed.
    """
    gone = (each for key in before.keys() - now for each in before[key] if key[0] not in FIGURES)
    return sorted(called[series] for series in gone) if now else []


def _unmeasured_in_some(
    now: _Measured, pairs: Collection[tuple[Rounds, Rounds]], called: Mapping[Series, str]
) -> list[str]:
    """Figures that the variant has in other cases alone, as the criterion is invalid in these."""
    found = []
    for series, name in called.items():
        gone = sum(measured_no_more(series, *pair) for pair in pairs)
        if gone and series in now.get(series[:3], ()):
            found.append(f"{name} in {counted(gone, 'case')}")
    return sorted(found)


def _turned(before: _Measured, now: _Measured, called: Mapping[Series, str]) -> list[str]:
    """Figures that both have, of which the other way is better now: nothing compares them."""
    turned = (key for key in before.keys() & now if not before[key] & now[key])
    return sorted(called[series] for key in turned for series in before[key])


def _of_other_measures(
    series: Iterable[Series], pairs: Collection[tuple[Rounds, Rounds]], called: Mapping[Series, str]
) -> str:
    """What has its name alone from before, after a semicolon; else nothing."""
    other = [one for one in series if any(measures_differ(one, *pair) for pair in pairs)]
    names = ", ".join(sorted(called[each] for each in other))
    return f"; not compared, as something else is measured now: {names}" if other else ""


def _measured(version: Mapping[Key, Rounds]) -> _Measured:
    """The series of which a version has figures, by what they are of."""
    found: _Measured = {}
    for rounds in version.values():
        for series, figures in rounds.figures.items():
            if figures:
                found.setdefault(series[:3], set()).add(series)
    return found


def _says_something(one: CriterionComparison) -> bool:
    """Whether anything was lost or discarded at all: most jobs have nothing to say there."""
    return bool(one.baseline or one.variant)


def _named(word: str, found: Mapping[Key, Change], variant: Mapping[Key, Rounds]) -> list[str]:
    names = [variant[key].cases[0] for key, change in found.items() if change.word == word]
    return names[:MOST_NAMED]


def _verdict(
    counts: Mapping[str, int], became: Mapping[str, int], criteria: list[CriterionComparison]
) -> tuple[Word, str]:
    """A regressed case or a worse criterion is worse, whatever else got better."""
    by_word = {
        word: [one.name for one in criteria if one.verdict == word and one.pairs]
        for word in ("worse", "better", "unknown")
    }
    message = _cases_in_words(counts, became)
    for word, names in by_word.items():
        if names:
            message += f"; {'undecided' if word == 'unknown' else word} in {', '.join(names)}"
    alone = [f"{counts[word]} {word}" for word in ("missing", "new") if counts[word]]
    message += f"; {', '.join(alone)}" if alone else ""
    if counts["regressed"] or by_word["worse"]:
        return "worse", message
    if not any(counts[word] for word in ("fixed", "flaky", "same")):
        lone = f"; {', '.join(alone)}" if alone else ""
        return "unknown", f"no case of both could be compared{lone}"
    return ("better" if counts["fixed"] or by_word["better"] else "same"), message


def _cases_in_words(counts: Mapping[str, int], became: Mapping[str, int]) -> str:
    words = []
    for word in ("regressed", "fixed", "flaky", "unknown"):
        if counts[word]:
            words.append(f"{counts[word]} {word}")
            if word == "regressed" and set(became) != {"failed"}:
                now = ", ".join(f"{became[to]} {to}" for to in _BECAME if became[to])
                words[-1] += f" ({now})"
    both = sum(counts[word] for word in _WORDS) - became.get("missing", 0)
    return f"{', '.join(words) or 'no case changed'} of {counted(both, 'case')}"
