"""Cases that were given up although their executors were only taken away: they run again. Pure.

Spark counts a task's launches and no more, so a worker gives a case up by their number. What became
of them is known to the driver alone: an executor that was drained, deleted or scaled down proves
nothing against the cases that it ran.
"""

from dataclasses import dataclass, field
from typing import Any

from bagpipe.run.attempts import MOST_STARTS, QUARANTINE_ATTEMPT
from bagpipe.run.case_run import Row

_MOST_KEPT = 10


@dataclass(frozen=True)
class Tried:
    """A case's starts in earlier rounds, and how many of these count against it."""

    starts: int = 0
    faults: int = 0

    def is_enough(self, launches: int) -> bool:
        """Whether a case is given up that was launched so often in this round.

        In the worst case each was its own fault; `GivenBack` looks at what they really were.
        """
        worst = self.faults + launches >= QUARANTINE_ATTEMPT
        return worst or self.starts + launches >= MOST_STARTS


@dataclass
class GivenBack:
    """The cases to run again, and what is known of their starts."""

    tried: dict[str, Tried] = field(default_factory=dict)
    again: set[str] = field(default_factory=set)
    _lost: dict[str, list[dict[str, Any]]] = field(default_factory=dict)

    def sift(self, rows: list[Row]) -> list[Row]:
        """The rows that count.

        One of a case that was given up says by `taken_away` how many of this round's starts ended
        without the case being at fault.
        """
        return [kept for row in rows if (kept := self._sifted(dict(row))) is not None]

    def _sifted(self, row: Row) -> Row | None:
        taken_away = row.pop("taken_away", None)
        if taken_away is None:
            return row
        case, starts = row["case"], row["starts"]
        before = self.tried.get(case, Tried())
        faults = before.faults + max(0, starts - before.starts - taken_away)
        lost = [*self._lost.get(case, []), *row["evidence"]["starts"]][-_MOST_KEPT:]
        if faults >= QUARANTINE_ATTEMPT or starts >= MOST_STARTS:
            return row | {"evidence": {"starts": lost}}
        self.tried[case], self._lost[case] = Tried(starts, faults), lost
        self.again.add(case)
        return None
