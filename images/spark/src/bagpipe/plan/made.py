"""What a job's plan is: the cases that will run, and what yields none."""

from dataclasses import dataclass
from typing import Self

from bagpipe.plan.case import Case


@dataclass(frozen=True)
class Unplanned:
    """A bag that yields no case, under the name that the results give it."""

    id: str
    bag: str
    reason: str
    message: str


@dataclass(frozen=True)
class Plan:
    """What will run, the biggest case first, and what can't."""

    cases: list[Case]
    unplanned: list[Unplanned]

    @classmethod
    def of(cls, cases: list[Case], unplanned: list[Unplanned]) -> Self:
        """Puts the cases in order."""
        return cls(sorted(cases, key=lambda case: (-case.bytes, case.id)), unplanned)
