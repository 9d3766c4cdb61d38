"""A case's criteria: what they read is fetched from storage only when one of them asks for it."""

from typing import Any

from bagpipe.engine.engine import Attempt
from bagpipe.evaluate.evidence import Evidence, Recording
from bagpipe.evaluate.finding import verdict
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import topics_of
from bagpipe.judgement import Judgement
from bagpipe.storage import StorageError

_NOTHING_SHOWN = {"NothingPlayed", "NothingRecorded", "NothingAnswered"}


def judged_by_criteria(
    judgement: Judgement, attempt: Attempt, recorded: Recording, result: dict[str, Any]
) -> tuple[Judgement, list[dict[str, Any]]]:
    """The verdict on a delivered case, and the findings behind it, as the results have them.

    Without criteria the delivery alone is judged; a case in which nothing was played or recorded,
    or whose stack has failed, is what it is whatever its criteria say. One that lacks evidence
    otherwise can only fail by them. Raises StorageError where what they read can't be had.
    """
    case, spec, storage = attempt.case, attempt.spec, attempt.storage
    if not spec.evaluate or judgement.outcome in {"failed", "errored"}:
        return judgement, []
    if judgement.reason in _NOTHING_SHOWN:
        return judgement, []
    truths = {topic for criterion in spec.evaluate for topic in topics_of(criterion)[1]}
    evidence = Evidence(
        # To the end of the drain: each criterion's clock decides what of it belongs to the
        # window (bagpipe.evaluate.window).
        recorded=recorded,
        source=Recording(
            lambda: attempt.source.truth(case, truths, storage),
            case.window.start,
            case.window.end,
        ),
        start=case.window.start,
        end=case.window.end,
        result=result,
        values=case.conditions.values,
        lead_in_start=case.window.lead_in_start,
        paced=spec.playback.mode != "max",
        rate=spec.playback.rate if spec.playback.mode == "realtime" else 1.0,
        inputs=attempt.source.input_times(case, storage),
        input_stamps=attempt.source.input_stamps(case, storage),
    )
    findings = evaluate(spec.evaluate, evidence, unread=(StorageError,))
    outcome, reason, message = verdict(findings)
    rows = [finding.as_row() for finding in findings]
    if judgement.outcome == "invalid" and outcome != "failed":
        return judgement, rows
    return Judgement(outcome, reason, message, judgement.allowed), rows
