"""Whether and when a lost driver is replaced. Pure."""

from datetime import datetime

from bagpipe_operator.jobs.driver.ending import Ending
from bagpipe_operator.jobs.job_view import JobView

# A driver that is lost again and again is not helped by haste, and its node or its storage is.
FIRST_PAUSE_SECONDS = 10.0
LONGEST_PAUSE_SECONDS = 300.0
# More of them only make numbers that no float holds.
_MOST_DOUBLINGS = 10


def pausing(job: JobView, now: datetime) -> bool:
    """Whether the next driver is not to be created yet."""
    until = job.status.get("nextAttemptTime")
    if until is None:
        return False
    left = (datetime.fromisoformat(until) - now).total_seconds()
    # Twice as much is no pause, but a clock that was ahead: by days, maybe.
    return 0 < left <= 2 * LONGEST_PAUSE_SECONDS


def pause_seconds(lost: int) -> float:
    """How long to wait with the next driver after `lost` were lost, from 1 on."""
    doublings = min(lost - 1, _MOST_DOUBLINGS)
    return float(min(LONGEST_PAUSE_SECONDS, FIRST_PAUSE_SECONDS * 2**doublings))


def lost_drivers(job: JobView) -> int:
    """How many drivers were lost; a status of an earlier release counts attempts only."""
    lost = job.status.get("lostDrivers")
    return int(job.status.get("attempt") or 1) - 1 if lost is None else int(lost)


def may_be_replaced(job: JobView, ending: Ending, backoff_limit: int) -> bool:
    """Whether another driver takes over from one that was lost."""
    return ending.voluntary or lost_drivers(job) < backoff_limit
