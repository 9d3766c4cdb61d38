"""What strangers wrote, read as what it should be, or as absent. Pure.

A status may be written by whoever has that right in a namespace, and a CRD of another release, or
one that an administrator has changed, lets other types through than this release's.
"""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from bagpipe.texts import duration_seconds

Json = dict[str, Any]
Reading = Callable[[object], object]

# Moments beyond are nobody's clock, and sums with them leave what a datetime holds.
_FIRST_YEAR, _LAST_YEAR = 1970, 2999
_EPOCH = "1970-01-01T00:00:00Z"
# No job lives for as many, and one more still is a number that the CRD takes.
_MOST_DRIVERS = 10**6
# What the API server keeps an integer in.
_LARGEST = 2**63 - 1


def moment(value: object) -> datetime | None:
    """An ISO 8601 moment with its offset, in UTC; None for anything else."""
    if not isinstance(value, str):
        return None
    try:
        read = datetime.fromisoformat(value)
    except ValueError:
        return None
    if read.tzinfo is None or not _FIRST_YEAR <= read.year <= _LAST_YEAR:
        return None
    return read.astimezone(UTC)


def whole(value: object) -> int | None:
    """A whole number that 64 bits hold; None for anything else."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool) or abs(value) > _LARGEST:
        return None
    return value


def seconds(value: object) -> float | None:
    """Seconds of a duration such as `1h30m`; None for anything else."""
    try:
        return duration_seconds(value) if isinstance(value, str) else None
    except ValueError:
        return None


def mapping(value: object) -> Json:
    """An object; an empty one for anything else."""
    return value if isinstance(value, dict) else {}


def objects(value: object) -> list[Json]:
    """The objects of a list; none for anything else."""
    return [each for each in value if isinstance(each, dict)] if isinstance(value, list) else []


def conditions(value: object) -> list[Json]:
    """A status's conditions, each with the texts that all conditions have; others are left out."""
    return [_condition(each) for each in objects(value) if _is_one(each)]


def _is_one(condition: Json) -> bool:
    return isinstance(condition.get("type"), str) and isinstance(condition.get("status"), str)


def _condition(written: Json) -> Json:
    texts = {key: _text(written.get(key)) or "" for key in ("reason", "message")}
    since = written.get("lastTransitionTime")
    seen = whole(written.get("observedGeneration"))
    generation = {} if seen is None else {"observedGeneration": seen}
    since = since if moment(since) else _EPOCH
    kept = {"type": written["type"], "status": written["status"], "lastTransitionTime": since}
    return kept | texts | generation


def _text(value: object) -> str | None:
    return value if isinstance(value, str) else None


def _moment_text(value: object) -> object:
    return value if moment(value) else None


def _counts(value: object) -> Json:
    counts = {key: whole(count) for key, count in mapping(value).items()}
    return {key: count for key, count in counts.items() if count is not None}


def _records(value: object) -> list[Json] | None:
    return objects(value) if isinstance(value, list) else None


def texts(value: object) -> list[str]:
    """The texts of a list; none for anything else."""
    return [each for each in value if isinstance(each, str)] if isinstance(value, list) else []


def _texts(value: object) -> list[str] | None:
    return texts(value) if isinstance(value, list) else None


# What is kept of a status' notifications: more than a job can have, and not what anybody may write.
_MOST_NOTIFICATIONS = 32
_LONGEST_TEXT = 1024
_OF_ONE = ("receiver", "state", "time", "message")
_OF_A_POOL = (
    "name", "state", "reason", "message", "driver", "pod", "job", "uid", "digest", "since",
)  # fmt: skip


def _notifications(value: object) -> list[Json] | None:
    """Those with a receiver and a state."""
    if not isinstance(value, list):
        return None
    read = [
        {key: each[key][:_LONGEST_TEXT] for key in _OF_ONE if isinstance(each.get(key), str)}
        for each in objects(value)[:_MOST_NOTIFICATIONS]
    ]
    return [each for each in read if "receiver" in each and "state" in each]


def _pool(value: object) -> Json | None:
    """Texts that are not too long, and the attempt."""
    found = mapping(value)
    read: Json = {
        key: found[key][:_LONGEST_TEXT] for key in _OF_A_POOL if isinstance(found.get(key), str)
    }
    attempt = _attempt(found.get("attempt"))
    return read | ({} if attempt is None else {"attempt": attempt}) or None


def _attempt(value: object) -> int | None:
    """Attempts are counted from 1, and each is one driver."""
    number = whole(value)
    return number if number is not None and 0 < number < _MOST_DRIVERS else None


def _lost(value: object) -> int | None:
    number = whole(value)
    return number if number is not None and 0 <= number < _MOST_DRIVERS else None


# How each field of a status is read; jobs and schedules have some each.
STATUS_FIELDS: dict[str, Reading] = {
    "activeCount": whole,
    "active": _texts,
    "attempt": _attempt,
    "baseline": lambda value: mapping(value) or None,
    "cases": _counts,
    "comparisons": _records,
    "completionTime": _moment_text,
    "conditions": conditions,
    "driver": _text,
    "failures": _records,
    "firstCaseTime": _moment_text,
    "lastPassed": lambda value: mapping(value) or None,
    "lastPassedTime": _moment_text,
    "lastScheduleTime": _moment_text,
    "lastSuccessfulTime": _moment_text,
    "ledger": _counts,
    "lostDrivers": _lost,
    "nextAttemptTime": _moment_text,
    "nextScheduleTime": _moment_text,
    "notifications": _notifications,
    "observedGeneration": whole,
    "phase": _text,
    "pool": _pool,
    "results": _text,
    "resumedFrom": lambda value: mapping(value) or None,
    "startTime": _moment_text,
    "verdict": _text,
}


def status(value: object) -> Json:
    """The fields of a job's or a schedule's status that are what they should be, and no other."""
    written = mapping(value)
    read = {key: reading(written[key]) for key, reading in STATUS_FIELDS.items() if key in written}
    return {key: value for key, value in read.items() if value is not None}
