"""Cases that did not pass, grouped by what they have in common: one fault often fails hundreds.

A cause is a reason, the criteria that did not hold, and the message without what differs from case
to case: numbers, addresses, and the case's own name.
"""

import re
from collections.abc import Mapping
from typing import Any

Row = Mapping[str, Any]

# Nobody reads more causes than this; the others stand together, by reason.
MOST_CAUSES = 40
_EXAMPLE_CHARACTERS = 300
# But for the number of a signal and an exit status, which distinguish one crash from another.
_VARYING = re.compile(
    r"0x[0-9a-f]+|\b[0-9a-f]{8,}\b|(?<!status )(?<!signal )(?<!\d)[-+]?\d[\d.,_]*(?:e[-+]?\d+)?",
    re.IGNORECASE,
)
_OTHERS = "other messages"


def normalised(message: str, case: str) -> str:
    """A message without what differs between cases of one cause."""
    return " ".join(_VARYING.sub("#", message.replace(case, "#")).split())[:_EXAMPLE_CHARACTERS]


class Causes:
    """Takes every row; its memory is the causes, and a number for each case that did not pass."""

    def __init__(self) -> None:
        self._numbers: dict[tuple[str, ...], int] = {}
        self._groups: list[dict[str, Any]] = []
        self._of: dict[str, int] = {}

    def add(self, row: Row) -> None:
        """One case, which may have passed."""
        if row["outcome"] == "passed":
            return
        case, reason = str(row["case"]), str(row.get("reason") or row["outcome"])
        criteria = [
            str(finding["name"])
            for finding in row.get("criteria") or []
            if finding["outcome"] != "passed"
        ]
        message = str(row.get("message") or "")
        key = (str(row["outcome"]), reason, *criteria, normalised(message, case))
        if key not in self._numbers and len(self._groups) >= MOST_CAUSES:
            key, criteria, message = (str(row["outcome"]), reason, _OTHERS), [], _OTHERS
        number = self._numbers.setdefault(key, len(self._groups))
        if number == len(self._groups):
            self._groups.append(
                {
                    "outcome": row["outcome"], "reason": reason, "criteria": criteria,
                    "message": message[:_EXAMPLE_CHARACTERS], "count": 0, "first": case,
                }
            )  # fmt: skip
        group = self._groups[number]
        group["count"] += 1
        group["first"] = min(group["first"], case)
        self._of[case] = number

    def as_json(self, cases: list[str]) -> dict[str, Any]:
        """`groups`, the largest first, and for each of `cases` the number of its own, or -1."""
        order = sorted(range(len(self._groups)), key=lambda n: (-self._groups[n]["count"], n))
        place = {number: at for at, number in enumerate(order)}
        return {
            "groups": [self._groups[number] for number in order],
            "at": [place[self._of[case]] if case in self._of else -1 for case in cases],
        }
