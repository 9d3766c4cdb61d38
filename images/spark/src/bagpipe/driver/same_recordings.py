"""The cases of a job's next driver: those of the recordings, and of the choice, that it began with.

Patterns are looked up again by each driver. What is gone by then would take its failed cases along,
and what has come would give others their names, or take their place in a number of cases. So all
go by what the first one planned.
"""

import posixpath
import re
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace

from bagpipe.driver.chosen import NoCaseError
from bagpipe.driver.first_plan import FirstPlan, Names, first_plan, names_of, recordings_of
from bagpipe.plan.case import Case
from bagpipe.plan.made import Plan, Unplanned, mark_of
from bagpipe.run.case_run import Row
from bagpipe.storage import Storage, StorageUnfitError

# What a fragment's name has behind that of its recording.
_NUMBER = re.compile(r"-[0-9]{4,}$")

Wanted = Callable[[Plan], Plan]


def of_the_same_recordings(
    storage: Storage,
    folder: str,
    planned: Plan,
    journaled: Callable[[], Iterable[Row]],
    wanted: Wanted = lambda planned: planned,
) -> Plan:
    """What is `wanted` of the recordings that the job began with, by the names that cases had then;
    what of it yields no case any more has the reasons that there are for it.

    A job that an earlier release has begun began with those that are there and those that
    `journaled` gives. Raises NoCaseError and StorageError.
    """
    first = first_plan(storage, folder, planned, wanted, journaled)
    made = _of_the_same(planned, first, wanted)
    return replace(made, unplanned=[*made.unplanned, *_replaced(made, journaled())])


def _of_the_same(planned: Plan, first: FirstPlan, wanted: Wanted) -> Plan:
    if first == FirstPlan.of(planned, planned):
        return wanted(planned)
    cases, lost = _of_its_recordings(planned, first)
    unplanned = _named(planned.unplanned, first)
    gone = [_gone(uri) for uri in sorted(first.recordings.keys() - names_of(planned).keys())]
    lost += _no_more(first, [*cases, *lost], [*gone, *unplanned])
    if gone:
        # A folder that could not be listed has lost them, and says why.
        gone += [each for each in planned.unplanned if each.bag not in first.recordings]
    made = _of_its_choice(replace(planned, cases=cases, unplanned=unplanned), first, wanted)
    _check_names(made)
    # Whatever is wanted: it may have been in a case that was.
    return replace(made, unplanned=[*made.unplanned, *gone, *lost])


def _of_its_recordings(planned: Plan, first: FirstPlan) -> tuple[list[Case], list[Unplanned]]:
    """The cases of the first plan's recordings, by their names then; and what is of others, too."""
    cases, lost = list[Case](), list[Unplanned]()
    for case in planned.cases:
        there = [uri in first.recordings for uri in recordings_of(case)]
        if all(there):
            cases.append(case)
        elif any(there) and (first.has(case) or _is_readable_now(case, first)):
            lost.append(_of_others(case))
    return _renamed(cases, first.recordings, names_of(planned)), lost


def _is_readable_now(case: Case, first: FirstPlan) -> bool:
    """Whether it is of a recording that yielded no case then."""
    return any(uri in first.unplanned for uri in recordings_of(case))


def _of_its_choice(planned: Plan, first: FirstPlan, wanted: Wanted) -> Plan:
    """The cases that were chosen, and what is wanted of each recording that yielded none then."""
    if first.chosen is None:
        return wanted(planned)
    names = set(first.chosen)
    late: dict[str, list[Case]] = {}
    for case in planned.cases:
        if not first.has(case) and _is_readable_now(case, first):
            late.setdefault(case.bag, []).append(case)
    for cases in late.values():
        # One by one: of a number of cases none takes another's place.
        with suppress(NoCaseError):
            names |= {case.id for case in wanted(Plan(cases, [])).cases}
    return replace(planned, cases=[case for case in planned.cases if case.id in names])


def _named(unplanned: list[Unplanned], first: FirstPlan) -> list[Unplanned]:
    """What of the first plan's recordings yields no case, by the names that they had."""
    counts = Counter(each.bag for each in unplanned)
    return [
        replace(each, id=first.unplanned.get(each.bag) or each.id)
        if counts[each.bag] == 1
        else each
        for each in unplanned
        if each.bag in first.recordings
    ]


def _check_names(planned: Plan) -> None:
    """Raises StorageUnfitError where two would have one name."""
    counts = Counter([case.id for case in planned.cases] + [each.id for each in planned.unplanned])
    if twice := [name for name, count in counts.items() if count > 1]:
        raise StorageUnfitError(
            f"two cases would have the name {min(twice)} that one had when the job began: create"
            " the job again"
        )


def _no_more(
    first: FirstPlan, named: Iterable[Case | Unplanned], explained: Iterable[Unplanned]
) -> list[Unplanned]:
    """The chosen cases that are none any more, though nothing is wrong with their recordings."""
    names, bags = {each.id for each in named}, {each.bag for each in explained}
    return [
        Unplanned(
            name,
            uri,
            "BagMissing",
            f"{name}, which was chosen when the job began, is no case of {uri} by now: it was"
            " replaced; create the job again",
        )
        for name, uri in (first.chosen or {}).items()
        if name not in names and uri not in bags
    ]


def _replaced(made: Plan, rows: Iterable[Row]) -> list[Unplanned]:
    """The cases that an earlier driver has run and that are none any more, though their recordings
    are there: these are shorter by now, and whatever the cases came to would be forgotten.
    """
    names = {case.id for case in made.cases} | {each.id for each in made.unplanned}
    there = {case.bag for case in made.cases}
    ran = {row["case"]: str(row.get("bag") or "") for row in rows if "window" in row}
    return [
        Unplanned(
            name,
            uri,
            "BagMissing",
            f"{name}, which an earlier driver of the job has run, is no case of {uri} by now: it"
            " was replaced; create the job again",
        )
        for name, uri in sorted(ran.items())
        if name not in names and uri in there
    ]


def _renamed(cases: list[Case], first: Names, now: Names) -> list[Case]:
    """The cases by the names that they had first: of recordings of one name these depend on which
    there are, and results, quarantines and comparisons go by them.
    """
    stems = {
        uri: _stems(first[uri], now[uri])
        for uri in first.keys() & now.keys()
        if first[uri] and now[uri] and first[uri] != now[uri]
    }
    return [_of_stem(case, *stems.get(case.bag, ("", ""))) for case in cases]


def _of_stem(case: Case, then: str, now: str) -> Case:
    if then == now or not case.id.startswith(now):
        return case
    fragment = then + case.fragment.removeprefix(now) if case.fragment else ""
    return replace(case, id=then + case.id.removeprefix(now), fragment=fragment)


def _stems(first: str, now: str) -> tuple[str, str]:
    if _NUMBER.search(first) and _NUMBER.search(now):
        return _NUMBER.sub("", first), _NUMBER.sub("", now)
    return first, now


def _gone(uri: str) -> Unplanned:
    name = posixpath.splitext(posixpath.basename(uri))[0] or "recording"
    return Unplanned(
        f"{name}-{mark_of(uri)}",
        uri,
        "BagMissing",
        f"{uri}, with which the job began, is in no case of what another driver of it found: its"
        " cases count as errored, whatever they came to before; bring it back and create the job"
        " again",
    )


def _of_others(case: Case) -> Unplanned:
    return Unplanned(
        case.id,
        case.bag,
        "BagMissing",
        f"{case.id} is put together of other recordings by now than when the job began: create the"
        " job again",
    )
