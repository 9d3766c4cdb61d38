"""Whether a change of a job's status may wait while the API server is busy. Pure.

Urgent is everything but progress: counts that moved, and words in which nothing but numbers did.
A count of faults that leaves zero is urgent, and goes back as progress: a driver that counts to
and fro gets no more writes by it than one that counts up.
"""

import re
from collections.abc import Callable

from bagpipe_operator.api import readings
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.driver.progress import Progress

# Only these phases are visited again and again whatever happens: what waits is not forgotten.
_VISITED = frozenset({"Planning", "Running"})
_FAULTS = ("failed", "invalid", "errored", "crashed", "lost", "regressed")
_NUMBER = re.compile(r"\d+")


def is_urgent(written: Json, computed: Json) -> bool:
    """Whether what is computed must not wait to replace what is written."""
    if computed.get("phase") not in _VISITED:
        return True
    changed = (
        key
        for key in written.keys() | computed.keys()
        if key not in written or key not in computed or written[key] != computed[key]
    )
    return not all(
        key in written
        and key in computed
        and key in _PROGRESS
        and _PROGRESS[key](written[key], computed[key])
        for key in changed
    )


def is_news(taken: Progress | None, account: Progress | None) -> bool:
    """Whether a driver's account says more than the one that its job was last decided by."""
    if taken is None or account is None:
        return taken is not account
    return _words(taken) != _words(account) or is_urgent(_shown(taken), _shown(account))


def _words(account: Progress) -> tuple[object, ...]:
    sentences = (_NUMBER.sub("0", text) for text in (account.message, account.warning))
    return (account.phase, account.ended, account.reason, account.cases.begun, *sentences)


def _shown(account: Progress) -> Json:
    return account.as_status() | {"phase": account.phase}


def _cases(before: object, after: object) -> bool:
    old, new = readings.mapping(before), readings.mapping(after)
    return not any(new.get(fault) and not old.get(fault) for fault in _FAULTS)


def _ledger(before: object, after: object) -> bool:
    return isinstance(before, dict) and isinstance(after, dict)


def _failures(before: object, after: object) -> bool:
    return bool(before) or not after


def _comparisons(before: object, after: object) -> bool:
    def stated(found: object) -> list[tuple[object, object]]:
        return [(each.get("variant"), each.get("verdict")) for each in readings.objects(found)]

    return stated(before) == stated(after)


def _conditions(before: object, after: object) -> bool:
    return _stated(before) == _stated(after)


def _stated(conditions: object) -> list[Json]:
    """Conditions without the numbers of their sentences."""
    return [
        each | {"message": _NUMBER.sub("0", str(each.get("message")))}
        for each in readings.objects(conditions)
    ]


# Of each field that may hold progress, whether a change is nothing else.
_PROGRESS: dict[str, Callable[[object, object], bool]] = {
    "cases": _cases,
    "ledger": _ledger,
    "failures": _failures,
    "comparisons": _comparisons,
    "conditions": _conditions,
}
