"""The cases that somebody wants to see first: some of a plan's, by number or by name. Pure."""

import dataclasses
from collections.abc import Sequence
from fnmatch import fnmatchcase

from bagpipe.plan.made import Plan


class NoCaseError(Exception):
    """No case of the plan is wanted; the sentence says what to write."""


def chosen(planned: Plan, wanted: Sequence[str]) -> Plan:
    """The plan's cases whose names match any pattern of `wanted`, at most as many as a number says.

    Patterns know `*`, `?` and `[...]`; of several numbers the least counts, and the first cases by
    name are taken. Bags that yield no case stay as far as their names match, and all of them where
    nothing yields one: why is then what there is to report. Raises NoCaseError.
    """
    numbers = [int(word) for word in wanted if word.isdecimal()]
    patterns = [word for word in wanted if not word.isdecimal()]
    if not wanted or not planned.cases:
        return planned

    def fits(name: str) -> bool:
        return not patterns or any(fnmatchcase(name, pattern) for pattern in patterns)

    names = sorted(case.id for case in planned.cases if fits(case.id))
    kept = set(names[: min(numbers)] if numbers else names)
    left = dataclasses.replace(
        planned,
        cases=[case for case in planned.cases if case.id in kept],
        unplanned=[bag for bag in planned.unplanned if fits(bag.id)],
    )
    if not left.cases and not left.unplanned:
        raise NoCaseError(_nobody(planned, wanted))
    return left


def check_named(planned: Plan, wanted: Sequence[str]) -> None:
    """Raises NoCaseError where a pattern of `wanted` matches neither a case nor a recording that
    yields none: what it was written for would not be in the verdict.
    """
    names = [case.id for case in planned.cases] + [bag.id for bag in planned.unplanned]
    patterns = [word for word in wanted if not word.isdecimal()]
    unknown = [word for word in patterns if not any(fnmatchcase(name, word) for name in names)]
    if unknown and planned.cases:
        raise NoCaseError(_nobody(planned, unknown))


def _nobody(planned: Plan, wanted: Sequence[str]) -> str:
    """That no case is called so, and what there is."""
    sentence = (
        f"none of the {len(planned.cases)} cases is called {' or '.join(wanted)}; the first is"
        f" {min(case.id for case in planned.cases)}: `bagpipe plan` lists them all"
    )
    if not planned.unplanned:
        return sentence
    lost = planned.unplanned[0]
    gave = "recording gave" if len(planned.unplanned) == 1 else "recordings gave"
    return f"{sentence}. {len(planned.unplanned)} {gave} none, the first {lost.bag}: {lost.message}"
