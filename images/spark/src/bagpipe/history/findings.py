"""What many runs show: criteria over time, cases that flip, and slow ones. Pure."""

import itertools
import statistics
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from bagpipe.history.run import CaseOfRun, Found, Run
from bagpipe.history.steps import more_fail_since, moved_since
from bagpipe.row_facts import of_other_measures

# Beside the criteria, whose names have no colon: cases that no criterion decided, and what of one
# criterion was not judged in the others.
UNJUDGED = "cases: not judged"
_NOT_JUDGED = "{}: not judged"

_MOST = 10
# Of one criterion; an own evaluator may give another unit in each case.
_MOST_UNITS = 8
_MOST_QUARANTINED = 200
# What a criterion found in a run, with the names of the cases.
_Findings = list[tuple[str, Found]]
# Whether something was judged, as if that were a criterion.
_SEEN, _UNSEEN = Found("", "passed", None, ""), Found("", "failed", None, "")


@dataclass(frozen=True)
class Night:
    """A criterion in one run: cases that it judged, those that failed, and the median of figures of
    what it measured last.
    """

    judged: int
    failed: int
    median: float | None


@dataclass(frozen=True)
class CriterionHistory:
    """A criterion over all runs, oldest first; of one with several figures each has one, of which
    the first alone says what is worse.

    `worse` is the run (its place) since which more cases fail, and `cases` are those that failed
    since and not before; `moved` is the run since which the median is another.
    """

    name: str
    unit: str
    nights: tuple[Night, ...]
    worse: int | None
    moved: int | None
    cases: tuple[str, ...]


@dataclass(frozen=True)
class Flaky:
    """A case whose outcome changed from one run to the next so many times of so many."""

    case: str
    flips: int
    of: int


@dataclass(frozen=True)
class Quarantined:
    """A case that is in quarantine in the last run: until when and why, and in how many of its runs
    it passed. One that passed in all of them may need no quarantine any more.
    """

    case: str
    words: str
    passed: int
    of: int


@dataclass(frozen=True)
class History:
    """What the runs show, oldest first. `slowest` has the median seconds of cases.

    What is in quarantine in the last run that has it is left out of the criteria of all runs: it
    makes none worse, and hides by its end or its beginning no other. It is among the flaky and slow
    ones.
    """

    runs: tuple[Run, ...]
    criteria: tuple[CriterionHistory, ...]
    flaky: tuple[Flaky, ...]
    slowest: tuple[tuple[str, float], ...]
    quarantined: tuple[Quarantined, ...] = ()

    @property
    def regressions(self) -> list[CriterionHistory]:
        """What got worse and is."""
        return [each for each in self.criteria if each.worse is not None]


def history_of(runs: Sequence[Run]) -> History:
    """What these runs show, oldest first."""
    units: dict[str, dict[str, None]] = {}
    kept = {case.name: case.quarantine for run in runs for case in run.cases}
    by_name: list[dict[str, _Findings]] = []
    for run in runs:
        by_name.append(defaultdict(list))
        for case in run.cases:
            if kept[case.name]:
                continue
            by_name[-1][UNJUDGED].append((case.name, _unjudged(case)))
            for found in case.criteria:
                units.setdefault(found.name, {}).update(dict.fromkeys(_units_of(found)))
                by_name[-1][found.name].append((case.name, found))
    criteria: list[CriterionHistory] = []
    unjudged = [each[UNJUDGED] for each in by_name]
    lost = [{case for case, each in mine if each.outcome == "failed"} for mine in unjudged]
    doubts = []
    for name, found_units in units.items():
        mine = [each.get(name, []) for each in by_name]
        criteria += _figures(name, list(found_units), mine)
        doubts.append(_criterion(_NOT_JUDGED.format(name), "", _doubted(mine, lost)))
    doubts.append(_criterion(UNJUDGED, "", unjudged))
    criteria += [each for each in doubts if any(night.failed for night in each.nights)]
    quarantined = tuple(_quarantined(runs))
    return History(
        tuple(runs), tuple(criteria), tuple(_flaky(runs)), tuple(_slowest(runs)), quarantined
    )


def _unjudged(case: CaseOfRun) -> Found:
    """What no criterion shows: a stack that crashed, a case without evidence or without an end."""
    judged = any(found.outcome == "failed" for found in case.criteria)
    bad = case.outcome != "passed" and not judged
    return _UNSEEN if bad else _SEEN


def _doubted(runs: Sequence[_Findings], lost: Sequence[set[str]]) -> list[_Findings]:
    """Where a criterion could not be judged in a case that another one decided."""
    return [
        [
            (case, _UNSEEN if each.outcome == "invalid" and case not in gone else _SEEN)
            for case, each in mine
        ]
        for mine, gone in zip(runs, lost, strict=True)
    ]


def _units_of(found: Found) -> list[str]:
    return [each.unit for each in found.measured if each.unit or each.figure is not None]


def _figures(name: str, units: list[str], runs: Sequence[_Findings]) -> Iterator[CriterionHistory]:
    """A criterion by its first figure, and beside it each other one."""
    first = _criterion(name, units[0] if units else "", runs)
    yield first
    for unit in units[1:_MOST_UNITS]:
        nights = _nights(runs, unit)
        moved = moved_since([night.median for night in nights])
        yield CriterionHistory(f"{name} ({unit})", unit, nights, None, moved, ())


def _nights(runs: Sequence[_Findings], unit: str) -> tuple[Night, ...]:
    measured = [_measured(mine, unit) for mine in runs]
    last = next((mark for found in reversed(measured) for mark in found if mark), "")
    nights = []
    for mine, found in zip(runs, measured, strict=True):
        comparable = (
            figures for mark, figures in found.items() if not of_other_measures({mark}, {last})
        )
        figures = list(itertools.chain.from_iterable(comparable))
        median = statistics.median(figures) if figures else None
        outcomes = Counter(each.outcome for _, each in mine)
        judged = outcomes["passed"] + outcomes["failed"]
        nights.append(Night(judged, outcomes["failed"], median))
    return tuple(nights)


def _measured(findings: _Findings, unit: str) -> dict[str, list[float]]:
    """The figures of that unit by the marks of what they are of; what little an invalid finding was
    judged on is no figure.
    """
    by_mark: dict[str, list[float]] = defaultdict(list)
    for found in (found for _, found in findings if found.outcome != "invalid"):
        for its_unit, figure, mark in found.measured:
            if figure is not None and its_unit == unit:
                by_mark[mark].append(figure)
    return by_mark


def _criterion(name: str, unit: str, runs: Sequence[_Findings]) -> CriterionHistory:
    nights = _nights(runs, unit)
    failing = [{case for case, each in mine if each.outcome == "failed"} for mine in runs]
    worse = more_fail_since([night.failed for night in nights], [night.judged for night in nights])
    cases: list[str] = []
    if worse is not None:
        before: set[str] = set().union(*failing[:worse])
        counts = Counter(case for run in failing[worse:] for case in run if case not in before)
        cases = [case for case, _ in sorted(counts.items(), key=lambda each: (-each[1], each[0]))]
    moved = moved_since([night.median for night in nights])
    return CriterionHistory(name, unit, nights, worse, moved, tuple(cases))


def _outcomes(runs: Sequence[Run]) -> dict[str, list[str]]:
    """Of each case its outcomes, oldest first; errors of the machine are none of them."""
    found: dict[str, list[str]] = defaultdict(list)
    for run in runs:
        for case in run.cases:
            if case.outcome != "errored":
                found[case.name].append(case.outcome)
    return found


def _flaky(runs: Sequence[Run]) -> Iterator[Flaky]:
    """Cases that went there and back, the worst first; one that broke once did not."""
    found = []
    for case, outcomes in _outcomes(runs).items():
        flips = sum(before != after for before, after in itertools.pairwise(outcomes))
        if flips >= 2:
            found.append(Flaky(case, flips, len(outcomes) - 1))
    yield from sorted(found, key=lambda each: (-each.flips / each.of, each.case))[:_MOST]


def _quarantined(runs: Sequence[Run]) -> Iterator[Quarantined]:
    last = [case for case in runs[-1].cases if case.quarantine][:_MOST_QUARANTINED] if runs else []
    names = {case.name for case in last}
    outcomes: dict[str, Counter[str]] = defaultdict(Counter)
    for run in runs:
        for case in run.cases:
            if case.name in names:
                outcomes[case.name][case.outcome] += 1
    for case in last:
        found = outcomes[case.name]
        yield Quarantined(case.name, case.quarantine, found["passed"], found.total())


def _slowest(runs: Sequence[Run]) -> Iterator[tuple[str, float]]:
    seconds: dict[str, list[float]] = defaultdict(list)
    for run in runs:
        for case in run.cases:
            seconds[case.name].append(case.seconds)
    medians = [(case, statistics.median(each)) for case, each in seconds.items()]
    yield from sorted(medians, key=lambda each: (-each[1], each[0]))[:_MOST]
