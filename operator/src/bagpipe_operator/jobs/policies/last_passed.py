"""The run that spec.baseline.lastPassed stands for: looked for once, before a job has a driver.

A run that passed is known by its job, and by its schedule's status before that job is gone.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

from bagpipe_operator.api import names, readings
from bagpipe_operator.api.objects import Json
from bagpipe_operator.api.runs import PassedRun, controller_of, kept_run, passed_run, run_of
from bagpipe_operator.cluster.client import Api, ApiError
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pods.pinned import followed_schedule
from bagpipe_operator.runtime.patience import Patience

# A schedule that has not named a run by then, such as one of a CRD without the field, never will.
MOST_SECONDS = 600.0
# A schedule keeps 200 that have ended. Anybody may give others its label, and each look would hold
# one of the operator's workers for as long as they are read.
MOST_LISTED = 1000


class CannotCompareError(ValueError):
    """There is nothing to follow; the message is a sentence for the user."""


async def find_last_passed(api: Api, job: JobView) -> Json:
    """`status.baseline` of a job that is compared with the last good run of a schedule.

    Raises CannotCompareError, and ApiError for faults that may pass.
    """
    name = followed_schedule(job)
    # In this order: a run whose job is not listed any more is in the status that is read then.
    label = f"{names.LABEL_SCHEDULE}={name}"
    listed = await api.list_jobs(job.namespace, label, MOST_LISTED + 1)
    if len(listed) > MOST_LISTED:
        raise CannotCompareError(
            f"More than {MOST_LISTED:,} jobs in namespace {job.namespace} have the label {label},"
            " and no more are looked at for the last that passed: delete those that the schedule"
            " did not make."
        )
    try:
        schedule = await api.get_schedule(job.namespace, name)
    except ApiError as error:
        if not error.is_gone(name):
            raise
        raise CannotCompareError(
            f"There is no SimulationSchedule {name} in namespace {job.namespace}, which"
            " spec.baseline.lastPassed names: correct the name, or create the schedule first."
        ) from None
    found = last_passed(job, schedule, listed)
    return {"schedule": name} | (found.as_status() if found else {})


def last_passed(job: JobView, schedule: Json, listed: list[Json]) -> PassedRun | None:
    """The latest run that passed; for a job of the same schedule, of those before its own."""
    uid = schedule["metadata"]["uid"]
    own = [each for each in listed if controller_of(each) == uid]
    runs = [passed_run(_name(each), readings.status(each.get("status"))) for each in own]
    runs.append(kept_run(readings.status(schedule.get("status"))))
    mine = any(each["metadata"]["uid"] == job.uid for each in own)
    until = run_of(job.name) if mine else None
    earlier = [run for run in runs if run and (until is None or run.run < until)]
    return max(earlier, default=None)


@dataclass
class Handover:
    """Keeps the job of a run that passed until the schedule's status names it, or a later one."""

    api: Api
    monotonic: Callable[[], float]
    _waiting: Patience = field(default_factory=Patience)

    async def waits(self, job: JobView) -> bool:
        """Whether an ended job has to stay for that; not for longer than MOST_SECONDS.

        Raises ApiError for faults that may pass.
        """
        seen = ["unnamed"] if await self._is_unnamed(job) else []
        seconds = self._waiting.observe(job.uid, seen, self.monotonic())
        return any(waited < MOST_SECONDS for waited in seconds.values())

    def forget(self, uid: str) -> None:
        """The job is gone."""
        self._waiting.forget(uid)

    async def _is_unnamed(self, job: JobView) -> bool:
        name, uid = job.schedule
        passed = passed_run(job.name, job.status)
        if not name or passed is None:
            return False
        try:
            schedule = await self.api.get_schedule(job.namespace, name)
        except ApiError as error:
            if not error.is_gone(name):
                raise
            return False
        kept = kept_run(readings.status(schedule.get("status")))
        ours = schedule["metadata"]["uid"] == uid
        return ours and (kept is None or kept.run < passed.run)


def _name(job: Json) -> str:
    return str(job["metadata"]["name"])
