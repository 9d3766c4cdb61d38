"""What of a comparison speaks against a job: which causes, unless they are allowed. Pure."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

Cause = Literal["Regressed", "Missing", "WorseCriteria", "Unknown"]
CAUSES: tuple[Cause, ...] = get_args(Cause)


@dataclass(frozen=True)
class Objection:
    """One cause, of one comparison as comparison.json has it, with its sentence."""

    cause: Cause
    message: str


def objections(comparison: Mapping[str, Any], allowed: Collection[str] = ()) -> list[Objection]:
    """All causes that are not allowed, the gravest first.

    Cases that passed and are missing are regressed too, and stand below Missing alone.
    """
    name = comparison["variant"] or "this job"
    found = _found(comparison, f"{name} against {comparison['baseline']}")
    return [objection for objection in found if objection.cause not in allowed]


def _found(comparison: Mapping[str, Any], who: str) -> Iterator[Objection]:
    counts, became = comparison["counts"], comparison["became"]
    worse = [one["name"] for one in comparison["criteria"] if one["verdict"] == "worse"]
    regressed = counts["regressed"] - became["missing"]
    if regressed:
        now = ", ".join(f"{became[to]} {to}" for to in ("failed", "invalid", "errored")
                        if became[to])  # fmt: skip
        yield Objection("Regressed", f"{who}: {regressed} regressed ({now})")
    if counts["missing"]:
        yield Objection("Missing", f"{who}: {counts['missing']} missing")
    if worse:
        yield Objection("WorseCriteria", f"{who}: worse in {', '.join(worse)}")
    if not regressed + sum(counts[word] for word in ("fixed", "flaky", "same")):
        yield Objection("Unknown", f"{who}: no case of both could be compared")
    elif doubtful := comparison.get("doubtful"):
        why = "and were not compared, since another part of the recording was played"
        yield Objection("Unknown", f"{who}: {doubtful} pass less often now {why}")
