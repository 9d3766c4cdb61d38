"""What a job's plan is: the cases that will run, and what yields none."""

import hashlib
from collections import Counter
from dataclasses import dataclass, replace
from typing import Self

from bagpipe.plan.case import Case


def mark_of(uri: str) -> str:
    """What keeps files of one name apart: twelve digits of the URI, so that each keeps its own,
    whatever others there are beside it.
    """
    return hashlib.sha256(uri.encode(errors="surrogateescape")).hexdigest()[:12]


@dataclass(frozen=True)
class Unplanned:
    """A bag that yields no case, under the name that the results give it."""

    id: str
    bag: str
    reason: str
    message: str


@dataclass(frozen=True)
class Selection:
    """Which of a catalogue's rows a job is about.

    `rows` there were, `selected` are those for which `where` holds, and `recordings` the URIs that
    these name, each once. `sha256` is of the catalogue's bytes.
    """

    catalogue: str
    where: str
    sha256: str
    rows: int
    selected: int
    recordings: int

    @property
    def sentence(self) -> str:
        """For people."""
        return (
            f"{self.recordings:,} recordings of {self.selected:,} of {self.rows:,} rows of"
            f" {self.catalogue} (sha256 {self.sha256[:12]}), where {self.where}"
        )


@dataclass(frozen=True)
class Plan:
    """What will run, the biggest case first, and what can't; and by which selection, if any."""

    cases: list[Case]
    unplanned: list[Unplanned]
    selection: Selection | None = None

    @classmethod
    def of(cls, cases: list[Case], unplanned: list[Unplanned]) -> Self:
        """Puts the cases in order; each, and what yields none, has a name that no other has, as
        results have one row for each name.
        """
        named = Counter(case.id for case in cases)
        own = [
            case if named[case.id] == 1 else replace(case, id=f"{case.id}-{_mark_of_case(case)}")
            for case in cases
        ]
        named += Counter(each.id for each in unplanned)
        apart = [
            each if named[each.id] == 1 else replace(each, id=f"{each.id}-{mark_of(each.bag)}")
            for each in unplanned
        ]
        return cls(sorted(own, key=lambda case: (-case.bytes, case.id)), apart)


def _mark_of_case(case: Case) -> str:
    """What keeps fragments apart whose conditions make one name of two."""
    return mark_of(f"{case.bag} {case.fragment}")
