"""Whether a job is stuck: only a person could help, and none has for long enough. Pure."""

from bagpipe_operator.jobs.driver.ending import Ending
from bagpipe_operator.jobs.observation import Observation
from bagpipe_operator.jobs.troubles.trouble import Trouble


def stuck(seen: Observation, stuck_seconds: float) -> Ending | None:
    """The end of a job that only a person could help, after having waited for that person."""
    after = f"The job was ended after {stuck_seconds:g} s of this."
    if seen.refusal and seen.refusal.lasting and seen.refused_for >= stuck_seconds:
        return Ending(False, seen.refusal.reason, f"{seen.refusal.message} {after}")
    trouble = fatal(seen, stuck_seconds)
    return Ending(False, trouble.reason, f"{trouble.message} {after}") if trouble else None


def fatal(seen: Observation, stuck_seconds: float) -> Trouble | None:
    """The trouble that has lasted for long enough to end the job."""
    for trouble in seen.troubles:
        if trouble.lasting and seen.seen_for.get(trouble.key, 0.0) >= stuck_seconds:
            return trouble
    return None
