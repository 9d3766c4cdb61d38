"""What spec.baseline.lastPassed was found to be, once for all of a job's drivers. Pure."""

from bagpipe_operator.api import readings
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.job_view import JobView

_PREFIX = "schedule/"


def followed_schedule(job: JobView) -> str:
    """The schedule whose last passed run the job is compared with; empty for any other job."""
    written = readings.mapping(job.spec.get("baseline")).get("lastPassed")
    return written.removeprefix(_PREFIX) if isinstance(written, str) else ""


def pinned_baseline(job: JobView) -> Json | None:
    """`schedule`, `job` and `results` of the status, the last two empty where none had passed.

    None where nothing is written, or not of this schedule.
    """
    found = readings.mapping(job.status.get("baseline"))
    pinned = {key: str(found.get(key) or "") for key in ("schedule", "job", "results")}
    schedule = followed_schedule(job)
    if (
        not schedule
        or pinned["schedule"] != schedule
        or bool(pinned["job"]) != bool(pinned["results"])
    ):
        return None
    return pinned


def none_yet(schedule: str) -> str:
    """The sentence for a schedule of which no run has passed."""
    return (
        f"nothing is compared: no earlier job of the schedule {schedule} has passed yet, so"
        " spec.baseline.lastPassed has no baseline and the verdict is that of the cases alone"
    )


def with_baseline(spec: Json, pinned: Json | None) -> Json:
    """The spec that a driver gets: with the results that were found, or without a baseline."""
    if pinned is None:
        return spec
    rest = {key: value for key, value in spec.items() if key != "baseline"}
    return rest | ({"baseline": {"results": pinned["results"]}} if pinned["job"] else {})
