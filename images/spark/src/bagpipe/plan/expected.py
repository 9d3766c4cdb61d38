"""How long cases are expected to take, by what earlier results show, and their order by that. Pure.

The longest begin first, so that the last slot ends close to the others.
"""

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from bagpipe.plan.case import Case

_SECOND = 1e9


@dataclass(frozen=True)
class Earlier:
    """What earlier results show: seconds of each case and of each fragment, seconds for a second of
    recording, and of the stack and its recordings the most bytes.
    """

    by_case: dict[str, list[float]] = field(default_factory=dict)
    by_fragment: dict[str, list[float]] = field(default_factory=dict)
    shares: list[float] = field(default_factory=list)
    stack: int | None = None
    recorded: int | None = None

    def own_seconds(self, case: Case) -> tuple[str, float] | None:
        """The median of what the same case took, else its fragment, and which of both."""
        for name, known in (
            ("case", self.by_case.get(case.id)),
            ("fragment", self.by_fragment.get(case.fragment)),
        ):
            if known:
                return name, statistics.median(known)
        return None


def earlier_of(rows: Iterable[Mapping[str, Any]]) -> Earlier:
    """Of lines of results; those without a time of their own are passed over."""
    found = Earlier()
    stack: list[int] = []
    recorded: list[int] = []
    for row in rows:
        seconds, window = row.get("seconds"), row.get("window")
        if not isinstance(seconds, int | float) or not 0 < seconds < math.inf:
            continue
        # A case that was tried again says what all its attempts took.
        each = seconds / max(1, int(row.get("attempts") or 1))
        found.by_case.setdefault(str(row["case"]), []).append(each)
        if row.get("fragment"):
            found.by_fragment.setdefault(str(row["fragment"]), []).append(each)
        if isinstance(window, list) and len(window) == 3 and window[2] > window[0]:
            found.shares.append(each / ((window[2] - window[0]) / _SECOND))
        result = row.get("result") or {}
        stack.append(((result.get("stack") or {}).get("usage") or {}).get("peak_memory_bytes") or 0)
        recorded.append((result.get("recorded") or {}).get("high_water_bytes") or 0)
    return Earlier(
        found.by_case,
        found.by_fragment,
        found.shares,
        max(stack, default=0) or None,
        max(recorded, default=0) or None,
    )


def recorded_seconds(case: Case) -> float:
    """Seconds of recording that the case plays, its lead-in among them."""
    return (case.window.end - case.window.lead_in_start) / _SECOND


def longest_first(cases: Sequence[Case], earlier: Earlier) -> list[Case]:
    """The cases by their expected seconds; as they are where earlier results show none.

    A case that nothing is known of goes first: begun last, it could be the one all wait for.
    """
    if not earlier.by_case:
        return list(cases)
    share = statistics.median(earlier.shares) if earlier.shares else math.inf

    def expected(case: Case) -> float:
        own = earlier.own_seconds(case)
        return own[1] if own is not None else share * max(recorded_seconds(case), 1 / _SECOND)

    return sorted(cases, key=lambda case: (-expected(case), -case.bytes, case.id))
