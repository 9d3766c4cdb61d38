"""Transitions of a job that are worth an Event. Pure."""

import re
from collections.abc import Iterable
from dataclasses import replace
from datetime import datetime

from bagpipe_operator.api import conditions, names, reasons
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.events import NORMAL, WARNING, Note, event
from bagpipe_operator.jobs.job_view import JobView

# Reasons of Accepted that are no trouble; the last two are reported by the condition Suspended.
_QUIET = frozenset({reasons.IN_PROGRESS, reasons.JOB_SUSPENDED, reasons.QUEUED})
# Well below the hour after which the API server forgets an Event, and with it that it was written.
RECENT_SECONDS = 600.0


def transitions(old: Iterable[Json], new: Iterable[Json]) -> list[Note]:
    """The Events to write for the change from the old conditions to the new."""
    before = list(old)
    notes: list[Note] = []
    changed = [c for c in new if not _same(conditions.find(before, c["type"]), c)]
    # Of two that say the same the end is reported: the other one may have been reported before it.
    ends = {c["reason"] for c in changed if c["type"] in conditions.ENDS and c["status"] == "True"}
    for condition in changed:
        type_, reason = _worth(condition), condition["reason"]
        reported = any(note.reason == reason for note in notes)
        reported = reported or (reason in ends and condition["type"] not in conditions.ENDS)
        if type_ is not None and not reported:
            mark = f"{condition['type']} {condition['status']} {condition['lastTransitionTime']}"
            notes.append(Note(type_, reason, condition["message"], mark))
    return notes


def recent(written: Iterable[Json], now: datetime) -> list[Note]:
    """The Events of a status' last RECENT_SECONDS: its writer may have died before writing them."""
    # A moment to come is one of a clock that was ahead, by seconds or by far.
    fresh = [
        condition
        for condition in written
        if abs((now - datetime.fromisoformat(condition["lastTransitionTime"])).total_seconds())
        < RECENT_SECONDS
    ]
    return transitions([], fresh)


def _same(known: Json | None, condition: Json) -> bool:
    if known is None:
        return False
    # Two drivers in a row may end alike; the message counts them.
    ended = condition["reason"] in reasons.DRIVER_ENDS
    keys = ("status", "reason", "message") if ended else ("status", "reason")
    return all(known.get(key) == condition[key] for key in keys)


def _worth(condition: Json) -> str | None:
    true = condition["status"] == "True"
    match condition["type"]:
        case conditions.FAILED | conditions.NOTIFIED as kind:
            wrong = "True" if kind == conditions.FAILED else "False"
            return WARNING if condition["status"] == wrong else None
        case conditions.RUNNING if condition["reason"] in reasons.TROUBLES:
            return WARNING
        case conditions.RUNNING if not true:
            return None
        case conditions.ACCEPTED if not true:
            return WARNING if condition["reason"] not in _QUIET else None
        case conditions.SUSPENDED if not true:
            return NORMAL if condition["reason"] in reasons.GOES_ON else None
        case kind:
            # Complete and Failed have reported what Passed says.
            reported = kind == conditions.BASELINE_FOUND or (true and kind != conditions.PASSED)
            return NORMAL if reported else None


def manifest(job: JobView, note: Note, now: datetime) -> Json:
    """A job's Event as core/v1 wants it."""
    return event(job, names.KIND, note, note.mark, now)


def marked(job: JobView, note: Note) -> Note:
    """The note of one transition with a mark that is always the same.

    Of a trouble that comes and goes while cases run on (the condition stays True) the first is
    reported. A driver's end is announced, and then happens: one Event for each driver.
    """
    if not note.mark.startswith(conditions.RUNNING):
        return note
    driver = re.search(rf"\b{re.escape(job.name)}-\d+-driver\b", note.message)
    if driver and note.reason in reasons.DRIVER_ENDS:
        return replace(note, mark=driver[0])
    return replace(note, mark=f"{job.status.get('attempt')} {note.mark}")
