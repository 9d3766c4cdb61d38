"""What rounds of some cases say of one version of the software: good, bad, or nothing. Pure."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any, Literal

Word = Literal["good", "bad", "unknown"]

_NAMED = 3


@dataclass(frozen=True)
class Step:
    """What is known of a version, and why, in a sentence."""

    word: Word
    why: str


def of_round(cases: Sequence[Mapping[str, Any]], planned: int, wanted: Sequence[str] = ()) -> Step:
    """One run of the cases, as `bagpipe results` has them: `case`, `outcome`, `reason`, `message`.

    A case that failed is bad, whatever the others did. What lacks evidence, errored or gave no
    result is neither: to call it bad would name a version that nobody has seen fail. Nor is it good
    that one of the `wanted` names or patterns has no case.
    """
    failed = [case for case in cases if case["outcome"] == "failed"]
    others = [case for case in cases if case["outcome"] not in ("passed", "failed")]
    if failed:
        return Step("bad", _named(failed))
    if others:
        return Step("unknown", _named(others))
    for pattern in wanted:
        if not any(fnmatchcase(str(case["case"]), pattern) for case in cases):
            return Step("unknown", f"the job has no case {pattern}")
    if not cases or len(cases) < planned:
        return Step("unknown", f"{len(cases)} of {planned} cases gave a result")
    return Step("good", f"{len(cases)} of {planned} cases passed")


def of_rounds(rounds: Sequence[Step]) -> Step:
    """All rounds of one version: what they agree on; else nothing, since chance decided them."""
    words = Counter(each.word for each in rounds)
    if not rounds:
        return Step("unknown", "nothing ran")
    if unknown := [each for each in rounds if each.word == "unknown"]:
        return unknown[0]
    if len(words) == 1:
        return rounds[0]
    return Step(
        "unknown",
        f"{words['good']} of {len(rounds)} rounds passed: it flakes here, so that no round says"
        " which version broke it",
    )


def is_decided(rounds: Sequence[Step]) -> bool:
    """Whether further rounds can't change what `of_rounds` says."""
    return of_rounds(rounds).word == "unknown" and bool(rounds)


def _named(cases: Sequence[Mapping[str, Any]]) -> str:
    named = "; ".join(
        ": ".join(str(each) for each in (case["case"], case.get("reason") or case["outcome"],
                                         case.get("message")) if each)
        for case in cases[:_NAMED]
    )  # fmt: skip
    more = f"; and {len(cases) - _NAMED} more" if len(cases) > _NAMED else ""
    return f"{named}{more}"
