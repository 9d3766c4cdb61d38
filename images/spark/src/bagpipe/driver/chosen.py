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
    name are taken. Bags that yield no case stay as far as their names match. Raises NoCaseError.
    """
    numbers = [int(word) for word in wanted if word.isdecimal()]
    patterns = [word for word in wanted if not word.isdecimal()]
    if not wanted or not (planned.cases or planned.unplanned):
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
        first = min([case.id for case in planned.cases] + [bag.id for bag in planned.unplanned])
        raise NoCaseError(
            f"none of the {len(planned.cases)} cases is called {' or '.join(wanted)}; the first is"
            f" {first}: `bagpipe plan` lists them all"
        )
    return left
