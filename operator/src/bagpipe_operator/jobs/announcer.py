"""Hands the ends of jobs to those who deliver them, and takes back what became of that.

What is sent is made from the status alone, bounded field by field, since others may write one too.
"""

from dataclasses import dataclass, field
from datetime import datetime

from bagpipe_operator.api import conditions, readings
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.policies import notifying
from bagpipe_operator.notify.courier import Courier
from bagpipe_operator.notify.event import cloud_event
from bagpipe_operator.notify.letter import Letter
from bagpipe_operator.receivers import Receivers

_MOST_FAILURES, _MOST_COMPARISONS = 5, 16
_LONGEST_WORD, _LONGEST_TEXT = 256, 1024


@dataclass
class Announcer:
    """One per operator."""

    receivers: Receivers = field(default_factory=Receivers)
    courier: Courier = field(default_factory=Courier)

    def with_notifications(self, job: JobView, status: Json, now: datetime) -> Json:
        """A status that is about to be written, with what it says of notifications."""
        return notifying.with_notifications(
            job, status, self.receivers, self.courier.outcomes(job.uid), now
        )

    def announce(self, job: JobView) -> None:
        """Sees to it that whoever is to know of an ended job is notified; waits for nothing."""
        owed = notifying.pending(job.status)
        if not owed:
            self.courier.forget(job.uid)
            return
        identity, body = f"{job.uid}-ended", event_of(job)
        for name in owed:
            about = f"{job.namespace}/{job.name}"
            self.courier.offer(Letter(job.uid, about, name, identity, body))

    def owes(self, job: JobView) -> bool:
        """Whether somebody is still to be notified: the tries are few, so this passes."""
        return bool(notifying.pending(job.status))

    def forget(self, uid: str) -> None:
        """The job is gone."""
        self.courier.forget(uid)

    def begin_to_lead(self) -> None:
        """What is owed is read from the statuses again."""
        self.courier.begin_to_lead()


def event_of(job: JobView) -> bytes:
    """The CloudEvent about the end of a job, the same for all its receivers: at most 32 KiB."""
    status = job.status
    ended = readings.moment(status.get("completionTime")) or datetime.fromisoformat(job.created)
    kind = notifying.kind_of(status)
    identity = f"{job.uid}-ended"
    return cloud_event(kind, job.namespace, job.name, identity, ended, _data(job))


def _data(job: JobView) -> Json:
    status = job.status
    end = conditions.find(status.get("conditions") or [], conditions.PASSED) or {}
    data = {
        "namespace": job.namespace,
        "name": job.name,
        "uid": job.uid,
        "phase": _cut(status.get("phase")),
        "verdict": _cut(status.get("verdict")),
        "reason": _cut(end.get("reason")),
        "message": _cut(end.get("message"), _LONGEST_TEXT),
        "regressed": notifying.regressed(status),
        "cases": dict(list((status.get("cases") or {}).items())[:_MOST_COMPARISONS]),
        "comparisons": [
            _picked(each, ("variant", "verdict"), ("regressed", "fixed", "flaky"))
            for each in (status.get("comparisons") or [])[:_MOST_COMPARISONS]
        ],
        "failures": [
            _picked(each, ("case", "reason"))
            | {"message": _cut(each.get("message"), _LONGEST_TEXT)}
            for each in (status.get("failures") or [])[-_MOST_FAILURES:]
        ],
        "results": _cut(status.get("results"), 2 * _LONGEST_TEXT),
        "startTime": status.get("startTime"),
        "completionTime": status.get("completionTime"),
    }
    return {key: value for key, value in (data | job.marks).items() if value not in (None, "")}


def _picked(found: Json, words: tuple[str, ...], counts: tuple[str, ...] = ()) -> Json:
    picked: Json = {key: _cut(found.get(key)) for key in words}
    return picked | {key: readings.whole(found.get(key)) or 0 for key in counts}


def _cut(text: object, longest: int = _LONGEST_WORD) -> str:
    return text[:longest] if isinstance(text, str) else ""
