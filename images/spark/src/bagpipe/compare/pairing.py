"""Rows of two versions brought together: the same fragment under the same values, in all rounds."""

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

Row = Mapping[str, Any]
Key = tuple[str, str, int]


@dataclass
class Rounds:
    """What one version did in one case, round by round.

    `figures` maps a criterion's name to its measured figures.
    """

    cases: list[str] = field(default_factory=list)
    outcomes: list[str] = field(default_factory=list)
    figures: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    criteria: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))

    @property
    def judged(self) -> list[str]:
        """The outcomes that say something: passed and failed."""
        return [outcome for outcome in self.outcomes if outcome in {"passed", "failed"}]

    @property
    def flaky(self) -> bool:
        """Whether the same case has both passed and failed."""
        return len(set(self.judged)) > 1

    @property
    def outcome(self) -> str:
        """`passed` or `failed` where all rounds agree, `flaky`, or `unknown` without a verdict."""
        if not self.judged:
            return "unknown"
        return "flaky" if self.flaky else self.judged[0]


def key_of(row: Row) -> Key:
    """What makes two rows the same case of two versions; names of jobs and variants are not in it.

    An earlier job's fragments bear the names of its bags, as this one's do.
    """
    values = json.dumps(row.get("values") or {}, sort_keys=True)
    return (str(row.get("fragment") or row["case"]), values, int(row.get("seed") or 0))


def rounds_of(rows: Iterable[Row]) -> dict[str, dict[Key, Rounds]]:
    """Variant, then case, then what happened in its rounds."""
    found: dict[str, dict[Key, Rounds]] = defaultdict(dict)
    for row in rows:
        rounds = found[str(row.get("variant") or "")].setdefault(key_of(row), Rounds())
        rounds.cases.append(row["case"])
        rounds.outcomes.append(row["outcome"])
        for finding in row.get("criteria") or []:
            rounds.criteria[finding["name"]].append(finding["outcome"])
            if finding.get("figure") is not None and finding.get("direction"):
                rounds.figures[finding["name"]].append(float(finding["figure"]))
    return dict(found)
