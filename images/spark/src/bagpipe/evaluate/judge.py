"""All criteria of a job over one case; one that can't be judged is invalid, never passed."""

import logging
from collections.abc import Callable, Sequence
from typing import Any

from bagpipe.evaluate.courses import with_courses
from bagpipe.evaluate.delivery import latency, presence, rate
from bagpipe.evaluate.errors import error, final_pose
from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.finding import Finding, NoEvidenceError, as_expected
from bagpipe.evaluate.measured import marked
from bagpipe.evaluate.model import Criterion
from bagpipe.evaluate.motion import separation
from bagpipe.evaluate.own import own
from bagpipe.evaluate.usage import resources
from bagpipe.evaluate.values import bounds, compiled, expression

log = logging.getLogger(__name__)

_MEASURES: dict[str, Callable[[str, Any, Evidence], Finding]] = {
    "presence": presence,
    "rate": rate,
    "latency": latency,
    "bounds": bounds,
    "expression": expression,
    "error": error,
    "finalPose": final_pose,
    "separation": separation,
    "resources": resources,
    "own": own,
}


def evaluate(
    criteria: Sequence[Criterion],
    evidence: Evidence,
    unread: tuple[type[Exception], ...] = (),
) -> list[Finding]:
    """One finding per criterion, in their order, with its course over time.

    Raises nothing but `unread`: that what was to be judged could not be read, which is no finding.
    """
    findings = [_found(criterion, evidence, unread) for criterion in criteria]
    return with_courses(criteria, findings, evidence)


def faults(criteria: Sequence[Criterion]) -> list[str]:
    """What is wrong with expressions, one sentence each: known before anything runs."""
    found = []
    for criterion in criteria:
        if criterion.expression is not None:
            try:
                compiled(criterion.expression.holds)
            except NoEvidenceError as fault:
                found.append(f"evaluate[{criterion.name}]: {fault}")
    return found


def _found(
    criterion: Criterion, evidence: Evidence, unread: tuple[type[Exception], ...]
) -> Finding:
    kind = criterion.kind
    measure = _MEASURES[kind]
    try:
        finding = measure(criterion.name, criterion.measurement, evidence)
    except NoEvidenceError as lack:
        finding = Finding(criterion.name, kind, "invalid", message=str(lack))
    except unread:
        raise
    except Exception as fault:  # a doubt about one criterion must not hide the others
        log.exception("criterion %s", criterion.name)
        text = f"{type(fault).__name__}: {fault}"
        finding = Finding(criterion.name, kind, "invalid", message=f"could not be judged: {text}")
    finding = marked(finding, criterion, evidence.rate, paced=evidence.paced)
    return as_expected(finding) if criterion.expect_failure else finding
