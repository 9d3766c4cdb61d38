"""Who is notified of a job's end, and what became of that, as its status has it. Pure.

Who is to be notified is written together with the end itself, in one status: an operator that is
killed then has lost nothing, and a job that ended under a release without notifications owes none.
"""

from collections.abc import Iterable, Mapping
from datetime import datetime

from bagpipe_operator.api import conditions, readings, reasons
from bagpipe_operator.api.conditions import Condition
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.policies.deletion import was_deleted
from bagpipe_operator.notify.letter import Outcome
from bagpipe_operator.receivers import MOST_NAMED, Receiver, Receivers

FIELD = "notifications"
PENDING, DELIVERED, UNKNOWN = "Pending", "Delivered", "Unknown"
_NO_LONGER = Outcome("Dropped", "It is not among the operator's receivers any more.")


def with_notifications(
    job: JobView, status: Json, receivers: Receivers, outcomes: Mapping[str, Outcome], now: datetime
) -> Json:
    """A status that is about to be written, with what it says of notifications."""
    entries = _entries(job, status, receivers, outcomes, now)
    if entries is None and not job.finished:
        wanted = _before_the_end(job, receivers)
        # Before the end nobody is owed anything, whatever somebody has written there.
        status = {key: value for key, value in status.items() if key != FIELD}
    elif entries is None:
        return status
    else:
        wanted = _condition(entries)
        status = status | {FIELD: entries}
    if wanted is None:
        return status
    old = job.status.get("conditions") or []
    others = [c for c in status.get("conditions") or [] if c["type"] != conditions.NOTIFIED]
    written = conditions.merged(old, [wanted], job.generation, now)
    return status | {"conditions": [*others, *written]}


def pending(status: Json) -> list[str]:
    """The receivers that are still to be notified."""
    entries = status.get(FIELD) or []
    return [e["receiver"] for e in entries if e["state"] == PENDING]


def kinds_of(status: Json) -> frozenset[str]:
    """What an ended job's end is, as receivers ask for it; the first of them is how it ended."""
    return frozenset({kind_of(status)} | ({"regressed"} if regressed(status) else set()))


def kind_of(status: Json) -> str:
    """How an ended job ended: passed, failed, invalid, or errored where it could not be run."""
    if status.get("phase") != conditions.COMPLETE:
        return "errored"
    verdict = str(status.get("verdict") or "").lower()
    return verdict if verdict in {"passed", "failed"} else "invalid"


def regressed(status: Json) -> int:
    """How many cases got worse than with the baseline, over all variants."""
    comparisons = status.get("comparisons") or []
    return sum(readings.whole(each.get("regressed")) or 0 for each in comparisons)


def _entries(
    job: JobView, status: Json, receivers: Receivers, outcomes: Mapping[str, Outcome], now: datetime
) -> list[Json] | None:
    """What the status is to say of each receiver; None where it says nothing."""
    if not job.finished:
        return _owed(job, status, receivers) if _ends(status) else None
    written = job.status.get(FIELD)
    if written is None:
        return None
    return [_settled(job, entry, receivers, outcomes, now) for entry in written]


def _ends(status: Json) -> bool:
    found = status.get("conditions") or []
    return any(c["type"] in conditions.ENDS and c["status"] == "True" for c in found)


def _owed(job: JobView, status: Json, receivers: Receivers) -> list[Json] | None:
    known, unknown = _named(job, receivers)
    kinds = kinds_of(status)
    asking = [each.name for each in known if each.events & kinds]
    if not known and not unknown:
        return None
    if was_deleted(status):
        return []
    owed = [{"receiver": name, "state": PENDING} for name in asking]
    return owed + [{"receiver": name, "state": UNKNOWN} for name in unknown]


def _settled(
    job: JobView, entry: Json, receivers: Receivers, outcomes: Mapping[str, Outcome], now: datetime
) -> Json:
    name = entry["receiver"]
    if entry["state"] != PENDING:
        return entry
    outcome = outcomes.get(name)
    if outcome is None and receivers.named(name, job.namespace) is None:
        outcome = _NO_LONGER
    if outcome is None:
        return entry
    settled = {"receiver": name, "state": outcome.state, "time": conditions.timestamp(now)}
    return settled | ({"message": outcome.message} if outcome.message else {})


def _named(job: JobView, receivers: Receivers) -> tuple[list[Receiver], list[str]]:
    """The receivers of a job, each once, and the names that its namespace has no receiver for."""
    names = list(dict.fromkeys(readings.texts(job.spec.get("notify"))))[:MOST_NAMED]
    found = {name: receivers.named(name, job.namespace) for name in names}
    known = {each.name: each for each in found.values() if each is not None}
    known |= {each.name: each for each in receivers.of_all(job.namespace)}
    return list(known.values()), [name for name, each in found.items() if each is None]


def _before_the_end(job: JobView, receivers: Receivers) -> Condition | None:
    known, unknown = _named(job, receivers)
    if unknown:
        return Condition(
            conditions.NOTIFIED, False, reasons.RECEIVER_UNKNOWN,
            f"{_no_receiver(unknown)} The job runs on without.",
        )  # fmt: skip
    if not known:
        return None
    words = f"{_listed(each.name for each in known)}: notified when the job has ended."
    return Condition(conditions.NOTIFIED, None, reasons.NOT_ENDED, words)


def _condition(entries: list[Json]) -> Condition:
    """What the entries come to: first what a person has to mend, then what is left to do."""
    by_state: dict[str, list[Json]] = {}
    for entry in entries:
        by_state.setdefault(entry["state"], []).append(entry)
    lost = [*by_state.get("Failed", []), *by_state.get("Dropped", [])]
    words = [_no_receiver(_names(by_state[UNKNOWN]))] if UNKNOWN in by_state else []
    words += [f"{each['receiver']} was not notified. {each.get('message', '')}" for each in lost]
    if PENDING in by_state:
        words.append(f"{_listed(_names(by_state[PENDING]))}: being notified.")
    if DELIVERED in by_state:
        words.append(f"{_listed(_names(by_state[DELIVERED]))}: notified.")
    message = " ".join(words) or "No receiver asks for jobs that end so."
    if UNKNOWN in by_state:
        return Condition(conditions.NOTIFIED, False, reasons.RECEIVER_UNKNOWN, message)
    if lost:
        return Condition(conditions.NOTIFIED, False, reasons.NOTIFICATION_LOST, message)
    if PENDING in by_state:
        return Condition(conditions.NOTIFIED, None, reasons.NOTIFYING, message)
    return Condition(conditions.NOTIFIED, True, reasons.NOTIFIED, message)


def _no_receiver(unknown: list[str]) -> str:
    which = _listed(unknown)
    is_none = "is no receiver" if len(unknown) == 1 else "are no receivers"
    return (
        f"spec.notify has {which}, which {is_none} for jobs of this namespace: correct it, or let"
        " an administrator add it to the chart's notifications.receivers."
    )


def _names(entries: Iterable[Json]) -> list[str]:
    return [entry["receiver"] for entry in entries]


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names)
