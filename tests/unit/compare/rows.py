"""Rows of two versions, as results.jsonl has them."""

from typing import Any

from bagpipe.compare.compare import Comparison, compare


def row(
    fragment: int,
    variant: str,
    outcome: str = "passed",
    figure: float | None = None,
    direction: str = "lower",
    **more: Any,
) -> dict[str, Any]:
    """A fragment with one criterion, latency; of a recording of its own unless `bag` says."""
    made = {
        "case": f"a-{fragment:04d}-{variant}",
        "fragment": f"a-{fragment:04d}",
        "variant": variant,
        "values": {},
        "seed": 0,
        "round": 0,
        "outcome": outcome,
        "reason": "" if outcome == "passed" else "Bad",
        "criteria": [
            {"name": "latency", "outcome": outcome, "figure": figure, "unit": "s",
             "direction": direction}
        ],
    }  # fmt: skip
    return made | more


def rounds(fragment: int, variant: str, outcomes: str) -> list[dict[str, Any]]:
    """A case's rounds: P, F, I or E for each."""
    words = {"P": "passed", "F": "failed", "I": "invalid", "E": "errored"}
    return [row(fragment, variant, words[o], round=n) for n, o in enumerate(outcomes)]


def only(rows: list[dict[str, Any]]) -> Comparison:
    """The one comparison of pr-812 with released."""
    [comparison] = compare(rows, ["released", "pr-812"])
    return comparison
