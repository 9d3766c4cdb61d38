"""How long a job took from one milestone to the next, by what its status says. Pure.

A status holds whole seconds, so each figure is right to within one.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import get_args

from bagpipe_operator.api import conditions, readings, reasons
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.claim import COLD
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.policies.deletion import was_deleted
from bagpipe_operator.jobs.pools.warm import ColdReason

ACCEPTED = "created_to_accepted"
PLANNED = "accepted_to_planned"
RUNNING = "planned_to_running"
ENDED = "running_to_ended"
VERDICTS = ("Passed", "Failed", "Invalid", "None")


@dataclass(frozen=True)
class Ended:
    """How a job ended: its phase, and its verdict, which is None where it failed."""

    phase: str
    verdict: str


def passed(before: JobView, after: JobView) -> Iterator[tuple[str, float]]:
    """The transitions between two statuses of one job, each with its seconds.

    A driver that replaces a lost one, and a job that goes on after a suspension, pass no
    milestone a second time but `planned_to_running`, whose clock then begins with the new driver.
    """
    old, new = _true(before), _true(after)
    status = after.status
    if conditions.ACCEPTED in _newly(old, new) and status.get("attempt", 1) == 1:
        begun = _latest(after.created, _resumed(status))
        yield from _span(ACCEPTED, begun, new[conditions.ACCEPTED])
    if conditions.PLANNED in _newly(old, new) and conditions.ACCEPTED in new:
        yield from _span(PLANNED, new[conditions.ACCEPTED], new[conditions.PLANNED])
    if status.get("firstCaseTime") and not before.status.get("firstCaseTime"):
        begun = _latest(new.get(conditions.PLANNED), status.get("startTime"))
        yield from _span(RUNNING, begun, status["firstCaseTime"])
    if after.finished and not before.finished:
        yield from _span(ENDED, status.get("firstCaseTime"), status.get("completionTime"))


def ended(before: JobView, after: JobView) -> Ended | None:
    """How the job ended, if it did so between the two statuses, and was not deleted: then nothing
    has failed.
    """
    if before.finished or not after.finished or was_deleted(after.status):
        return None
    verdict = str(after.status.get("verdict") or "None")
    # Not its phase, which may be any text where somebody else has written the status meanwhile.
    phase = conditions.COMPLETE if conditions.COMPLETE in _true(after) else conditions.FAILED
    return Ended(phase, verdict if verdict in VERDICTS else "None")


def begun_in_pool(before: JobView, after: JobView) -> str | None:
    """How a job of a pool began, if that was decided between the two statuses.

    `Taken` by a driver that waited, or the reason for pods of its own; None for one that is not
    ours, as where somebody else has written the status meanwhile.
    """
    old, new = (readings.mapping(job.status.get("pool")) for job in (before, after))
    if new.get("state") not in {"Taken", COLD} or old.get("state") == new["state"]:
        return None
    if new["state"] == "Taken":
        return "Taken"
    reason = new.get("reason")
    return reason if reason in get_args(ColdReason) else None


def _true(job: JobView) -> dict[str, str]:
    """Since when each condition that holds has held."""
    return {
        c["type"]: c["lastTransitionTime"]
        for c in job.status.get("conditions") or []
        if c.get("status") == "True"
    }


def _newly(old: dict[str, str], new: dict[str, str]) -> set[str]:
    return set(new) - set(old)


def _resumed(status: Json) -> str | None:
    found = conditions.find(status.get("conditions") or [], conditions.SUSPENDED)
    resumed = found is not None and found["reason"] in reasons.GOES_ON
    return str(found["lastTransitionTime"]) if found is not None and resumed else None


def _latest(*moments: str | None) -> str | None:
    """ISO moments in UTC sort as text."""
    return max((moment for moment in moments if moment), default=None)


def _span(name: str, since: str | None, until: str | None) -> Iterator[tuple[str, float]]:
    if since and until:
        seconds = (datetime.fromisoformat(until) - datetime.fromisoformat(since)).total_seconds()
        yield name, max(0.0, seconds)
