"""The verdict in words: what a reader of the report sees first."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

from bagpipe.counted import counted
from bagpipe.row_facts import counts_of, verdict_words

_HEADLINES = {
    "Passed": ("passed", "Passed"),
    "Failed": ("failed", "Failed"),
    "Invalid": ("invalid", "Not enough evidence"),
}


def headline(manifest: Mapping[str, Any]) -> tuple[str, str, str]:
    """The verdict's class in the style sheet, its word, and all that speaks against it.

    A job that broke off has no verdict.
    """
    kind, word = _HEADLINES.get(manifest["verdict"], ("errored", "No verdict"))
    _, _, against = verdict_words(manifest["verdict"], counts_of(manifest)).partition(": ")
    return kind, word, against


def sentence(manifest: Mapping[str, Any], data: Mapping[str, Any]) -> str:
    """One or two sentences: how many of how many cases, and by which criteria or reasons."""
    counts = manifest["counts"]
    planned = counts["planned"]
    hidden = counts.get("quarantined", 0)
    if manifest["verdict"] == "Passed" and hidden:
        return (
            f"{counts['passed']:,} of {counted(planned, 'case')} passed; {hidden:,} did not and"
            f" {_are(hidden)} in quarantine."
        )
    if manifest["verdict"] == "Passed":
        return f"All {planned:,} cases passed." if planned != 1 else "The one case passed."
    if not manifest["verdict"]:
        return str(manifest["message"])
    against = [
        f"{counts[outcome]:,} {word}"
        for outcome, word in (("failed", "failed"), ("invalid", "lack evidence"))
        if counts[outcome]
    ]
    # A job may fail by its comparison alone.
    sentence = f"Of {planned:,} cases {' and '.join(against) or 'none failed'}"
    sentence += f"; {hidden:,} that did not pass {_are(hidden)} in quarantine." if hidden else "."
    if manifest.get("verdictReason") == "AllQuarantined":
        sentence += " All are in quarantine, so that no case counts."
    causes = _causes(data)
    return f"{sentence} Most often: {causes}." if causes else sentence


def _are(cases: int) -> str:
    return "is" if cases == 1 else "are"


def _causes(data: Mapping[str, Any]) -> str:
    """The criteria that failed most, else the reasons that were given most."""
    found = Counter(
        {criterion["name"]: criterion["outcomes"].count("F") for criterion in data["criteria"]}
    )
    if not +found:
        reasons = data["cases"]["reason"]
        found = Counter(reasons["values"][at] for at in reasons["at"] if reasons["values"][at])
    return ", ".join(f"{name} ({count:,})" for name, count in found.most_common(3) if count)
