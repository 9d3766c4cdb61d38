"""The condition Passed: whether the software under test may go on, for gates that wait. Pure.

Complete means that a job could be run; Passed, that its verdict is Passed. It follows from the
status alone, so a job that ended under a release without it gets the same one.
"""

from bagpipe_operator.api import conditions, reasons
from bagpipe_operator.api.conditions import Condition
from bagpipe_operator.api.objects import Json

NOT_ENDED = Condition(conditions.PASSED, None, reasons.NOT_ENDED, "The job has not ended.")


def passed(status: Json, complete: bool, reason: str, message: str, why: str = "") -> Condition:
    """Whether an ended job passed; `reason` and `message` are those of its end.

    `why` is the driver's word for its verdict, where it gave one.
    """
    if not complete:
        return Condition(conditions.PASSED, False, reason, message)
    verdict = status.get("verdict") or ""
    if verdict == "Passed":
        return Condition(conditions.PASSED, True, reasons.PASSED, message)
    return Condition(conditions.PASSED, False, why or _why(status, verdict), message)


def _why(status: Json, verdict: str) -> str:
    if not verdict:
        return reasons.NO_VERDICT  # the driver reported none
    # With no case that failed, it is the comparison with the baseline that is against it.
    by_comparison = verdict == "Failed" and not (status.get("cases") or {}).get("failed")
    return reasons.REGRESSED if by_comparison else verdict


def completed(status: Json) -> list[Json]:
    """An ended job's conditions with Passed among them; the other conditions stay as they are."""
    written: list[Json] = list(status.get("conditions") or [])
    if conditions.find(written, conditions.PASSED) is not None:
        return written
    end = next((c for c in written if c["type"] in conditions.ENDS and c["status"] == "True"), None)
    if end is None:
        return written
    complete = end["type"] == conditions.COMPLETE
    new = passed(status, complete, str(end.get("reason") or ""), str(end.get("message") or ""))
    since = status.get("completionTime") or end["lastTransitionTime"]
    return [*written, conditions.written(new, int(end.get("observedGeneration") or 0), str(since))]
