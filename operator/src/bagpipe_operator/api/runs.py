"""The runs of a schedule, as their jobs' names and statuses show them. Pure."""

from dataclasses import dataclass
from datetime import UTC, datetime

from bagpipe_operator.api import conditions, names, readings
from bagpipe_operator.api.objects import Json


def run_of(name: str) -> datetime | None:
    """The moment that a job of this name was made for; None for a name of another shape."""
    _, _, minutes = name.rpartition("-")
    # Ten digits of minutes are twenty thousand years, which datetime does not know.
    if not minutes.isdecimal() or not minutes.isascii() or len(minutes) > 9:
        return None
    return datetime.fromtimestamp(int(minutes) * 60, UTC)


@dataclass(frozen=True, order=True)
class PassedRun:
    """A run whose job passed and left results; the later run is the greater."""

    run: datetime  # the moment that it was made for, in UTC
    job: str
    results: str

    def as_status(self) -> Json:
        """As a status has it."""
        return {
            "job": self.job, "results": self.results, "scheduleTime": conditions.timestamp(self.run)
        }  # fmt: skip


def passed_run(name: str, status: Json) -> PassedRun | None:
    """That of a job of a schedule; None where it has not passed, or has no results."""
    run, results = run_of(name), str(status.get("results") or "")
    found = conditions.find(status.get("conditions") or [], conditions.PASSED)
    if run is None or not results or found is None or found.get("status") != "True":
        return None
    return PassedRun(run, name, results)


def kept_run(schedule_status: Json) -> PassedRun | None:
    """The last one that a schedule's status names; its job may be gone."""
    kept = readings.mapping(schedule_status.get("lastPassed"))
    run, job, results = (
        readings.moment(kept.get("scheduleTime")), kept.get("job"), kept.get("results")
    )  # fmt: skip
    if run is None or not isinstance(job, str) or not isinstance(results, str):
        return None
    return PassedRun(run, job, results) if job and results else None


def controller_of(job: Json) -> str:
    """The UID of the schedule that made a job; empty where none did."""
    return str(_controller(job).get("uid") or "")


def schedule_of(job: Json) -> tuple[str, str]:
    """The name and the UID of the schedule that made a job; both empty where none did."""
    owner = _controller(job)
    if owner.get("kind") != names.SCHEDULE_KIND or not owner.get("name"):
        return "", ""
    return str(owner["name"]), str(owner.get("uid") or "")


def _controller(job: Json) -> Json:
    owners = readings.objects(job["metadata"].get("ownerReferences"))
    return next((owner for owner in owners if owner.get("controller")), {})
