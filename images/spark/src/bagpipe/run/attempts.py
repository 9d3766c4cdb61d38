"""How often a case is run, and when again. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

# What holds where spec.stackBackoffLimit is not written.
ATTEMPTS = 3
# A node with a short queue loses messages while its machine is busy, which passes.
REALTIME_ATTEMPTS = 10
# Seconds before each further try while the volume is full: somebody has a minute to make room.
FULL_VOLUME_PAUSES = (1.0, 2.0, 4.0, 8.0, 16.0, 30.0)

# Faults of the machinery or of timing, where the same case may well succeed the next time.
_WORTH_ANOTHER_TRY = {
    "AgentDied",
    "DeliveryIncomplete",
    "ProtocolError",
    "RosMasterFailed",
    "SlotUnavailable",
    # Where storage did not answer: each try asks it as often and as long as the first.
    "StorageFailed",
}

# Faults of the stack itself: run again only where spec.stackBackoffLimit asks for it, since a
# crash that is hidden by a second try is what a user wants to find.
_OF_THE_STACK = {
    "CaseDeadlineExceeded",
    "NeverSubscribed",
    "StackAborted",
    "StackExited",
    "StackNeverExited",
    "StackStoppedReading",
}

# Every reason of Bagpipe's own for a run of a case that does not pass.
REASONS = frozenset(
    _WORTH_ANOTHER_TRY
    | _OF_THE_STACK
    | {"BagCut", "BagEmpty", "BagMissing", "BagNotIndexed", "BagUnreadable", "FileMissing"}
    | {"CriteriaFailed", "CriterionFailed", "NoMatchingTopics", "NotEnoughEvidence"}
    | {"NothingPlayed", "NothingRecorded", "ProgramFailed", "ProgramInvalid", "UnknownOutcome"}
    | {"ExecutorLost", "Internal", "RecorderBudgetExceeded", "StackProtocolError"}
    | {"StorageFull"}
)


@dataclass(frozen=True)
class Again:
    """Run the case once more, after `seconds`."""

    seconds: float = 0.0


def next_attempt(
    reason: str,
    discarded: Sequence[str],
    mode: str,
    limit: int | None = None,
    may_pass: bool = False,
) -> Again | None:
    """Whether a case whose try ended with `reason` is run again.

    `discarded` are the reasons of its earlier tries. Each fault has its own allowance: an agent
    that dies once does not end a case because its node was lossy some times before.
    `limit` is spec.stackBackoffLimit: how many tries may follow the first. `may_pass` says of
    StorageFailed that storage did not answer: what it refuses or lacks it refuses again.
    """
    attempts = discarded.count(reason) + 1
    if reason == "StorageFull":
        left = FULL_VOLUME_PAUSES[attempts - 1 : attempts]
        return Again(left[0]) if left else None
    if reason == "StorageFailed" and not may_pass:
        return None
    return Again() if attempts < _allowed(reason, mode, limit) else None


def quarantine_attempt(limit: int | None) -> int:
    """The number, from 0, of the Spark attempt that gives a case up instead of running it.

    Of the attempts before it at most one still runs (a speculative copy), so the executors of at
    least `limit` + 1 were lost.
    """
    return (ATTEMPTS if limit is None else limit + 1) + 1


def _allowed(reason: str, mode: str, limit: int | None) -> int:
    if limit is not None:
        return limit + 1 if reason in _WORTH_ANOTHER_TRY | _OF_THE_STACK else 1
    if reason == "DeliveryIncomplete" and mode == "realtime":
        return REALTIME_ATTEMPTS
    return ATTEMPTS if reason in _WORTH_ANOTHER_TRY else 1
