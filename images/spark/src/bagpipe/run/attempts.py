"""How often a case is run, and when again. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from bagpipe.faults import FaultPolicy
from bagpipe.run import out_of_memory

# Runs of a case that meets one fault of the machinery again and again.
ATTEMPTS = 3
# Seconds before each further try after a loss on a busy machine, which is no fault of anybody's and
# passes: at once, since most disturbances are short, then ever later, since some last a minute.
BUSY_MACHINE_PAUSES = (0.0, 2.0, 8.0, 16.0, 32.0)
# The number, from 0, of the Spark attempt that gives a case up instead of running it. Of the
# attempts before it at most one still runs (a speculative copy), so at least 3 executors were lost.
QUARANTINE_ATTEMPT = 4
# A case whose executors were taken away each time is given up all the same after so many starts: it
# may be what its nodes die of.
MOST_STARTS = 20
# Seconds before each further try while the volume is full: somebody has a minute to make room.
FULL_VOLUME_PAUSES = (1.0, 2.0, 4.0, 8.0, 16.0, 30.0)

# Faults of the machinery, where the same case may well succeed the next time.
_WORTH_ANOTHER_TRY = {
    "AgentDied",
    "ProtocolError",
    "RosMasterFailed",
    "SlotUnavailable",
    # Where storage did not answer: each try asks it as often and as long as the first.
    "StorageFailed",
}

_NO_POLICY = FaultPolicy([])


@dataclass(frozen=True)
class Again:
    """Run the case once more, after `seconds`; `about` as many, so that cases begin apart."""

    seconds: float = 0.0
    about: bool = False


def next_attempt(
    reason: str,
    discarded: Sequence[str],
    policy: FaultPolicy = _NO_POLICY,
    may_pass: bool = False,
) -> Again | None:
    """Whether a case whose try ended with `reason` is run again.

    `discarded` are the reasons of its earlier tries. Each fault has its own allowance: an agent
    that dies once does not end a case because its machine was busy some times before. What is the
    stack's is run again only where the job's `policy` asks for it: a crash or a loss that a second
    try hides is what a user wants to find. `may_pass` says of StorageFailed that storage did not
    answer: what it refuses or lacks it refuses again.
    """
    attempts = discarded.count(reason) + 1
    if reason in ("StorageFull", "MachineBusy"):
        busy = reason == "MachineBusy"
        pauses = BUSY_MACHINE_PAUSES if busy else FULL_VOLUME_PAUSES
        left = pauses[attempts - 1 : attempts]
        return Again(left[0], about=busy) if left else None
    if reason == "StorageFailed" and not may_pass:
        return None
    return Again() if attempts < _allowed(reason, policy) else None


def _allowed(reason: str, policy: FaultPolicy) -> int:
    if reason in _WORTH_ANOTHER_TRY:
        return ATTEMPTS
    retries = policy.retries(reason)
    # What the node has ended for lack of memory may have been another pod's, once.
    return 1 + (max(1, retries) if reason == out_of_memory.REASON else retries)
