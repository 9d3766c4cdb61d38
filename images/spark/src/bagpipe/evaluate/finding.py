"""What a criterion found in one case, and what the findings of a case come to."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

Outcome = Literal["passed", "failed", "invalid"]
Clock = Literal["header", "receipt", "none"]


@dataclass(frozen=True)
class Figure:
    """What was measured for one of several bounds of a criterion, and whether that one holds."""

    outcome: Outcome
    figure: float | None
    unit: str
    limit: str
    direction: str
    measures: str = ""


@dataclass(frozen=True)
class Finding:
    """One criterion's answer. `figure` is None where nothing could be measured.

    `direction` says which way of `figure` is better: `lower`, `higher`, or `` where a comparison
    of two figures says nothing. `limit` is the bound as people write it. `coverage` is the part of
    the window, or of the truth's samples, that it was judged on, `covered` the same in words, and
    `clock` what its times were read from. `figures` has one for each bound of a criterion with
    several figures, of which `figure` is the one that decided. `measures` is a mark of what was
    measured, empty where that is not known.
    """

    name: str
    kind: str
    outcome: Outcome
    figure: float | None = None
    unit: str = ""
    limit: str = ""
    direction: str = ""
    message: str = ""
    expected_failure: bool = False
    coverage: float | None = None
    covered: str = ""
    clock: Clock = "none"
    # What a failure is where the criterion is expected to fail: one that is not the known fault.
    instead: Outcome | None = None
    # Over time (courses.py); of a user's own evaluator what it answered, until then.
    course: dict[str, Any] | None = None
    figures: tuple[Figure, ...] = ()
    measures: str = ""

    def as_row(self) -> dict[str, Any]:
        """As it stands in results.jsonl."""
        row = asdict(self)
        del row["instead"]
        if self.course is None:
            del row["course"]
        if not self.figures:
            del row["figures"]
        return row


class NoEvidenceError(Exception):
    """A criterion can't be judged by what was recorded; never a pass. The message says why."""


def covering(
    finding: Finding,
    share: float | None,
    covered: str,
    clock: Clock,
    least: float,
    *,
    lasting: bool = False,
    remedy: str = "",
) -> Finding:
    """The finding with the part that it was judged on, or None; invalid below `least`.

    `lasting` says that more evidence could not undo a failure: what was seen out of its bounds
    stays failed, however little else was seen.
    """
    part = None if share is None else round(share, 4)
    finding = replace(finding, coverage=part, covered=covered, clock=clock)
    if share is None or share >= least - 1e-9 or finding.outcome == "invalid":
        return finding
    if finding.outcome == "failed" and (lasting or finding.instead):
        return replace(finding, instead=finding.instead or "invalid")
    message = (
        f"judged on {covered}, which is {share:.0%}, and at least {least:.0%} are needed"
        f"{f': {remedy}' if remedy else ''}; {finding.message}"
    )
    return replace(finding, outcome="invalid", message=message)


def as_expected(finding: Finding) -> Finding:
    """A criterion that is expected to fail: its failure passes, and its pass is the news.

    A failure for another reason than the known fault (no number, nothing there) is none of these.
    """
    if finding.outcome == "failed" and finding.instead is not None:
        message = f"expected to fail, but not like this: {finding.message}"
        return replace(
            finding, outcome=finding.instead, message=message, expected_failure=True, instead=None
        )
    if finding.outcome == "failed":
        message = f"failed as expected: {finding.message}"
        return replace(finding, outcome="passed", message=message, expected_failure=True)
    if finding.outcome == "passed":
        message = "passed although it was expected to fail: remove expectFailure"
        return replace(finding, outcome="failed", message=message, expected_failure=True)
    return replace(finding, expected_failure=True)


def verdict(findings: Sequence[Finding]) -> tuple[Outcome, str, str]:
    """Outcome, reason (CamelCase) and sentence of a case: a failure first, then a doubt."""
    for outcome, reason in (("failed", "CriterionFailed"), ("invalid", "NotEnoughEvidence")):
        found = [f for f in findings if f.outcome == outcome]
        if found:
            message = "; ".join(f"{f.name}: {f.message}" for f in found)
            return ("failed" if outcome == "failed" else "invalid"), reason, message[:2000]
    return "passed", "", ""
