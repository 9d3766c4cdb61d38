"""What a schedule needs at one moment. Pure: the clock comes in from outside.

Levels, not edges: which runs are due follows from the last run that was started, so a restart of
the operator, a lost event or a second look change nothing. The rules are those of CronJob: of the
runs that were missed at most the latest is made up for, and only within startingDeadline.
"""

from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from enum import Enum
from zoneinfo import ZoneInfo

from bagpipe_operator.api import readings, reasons
from bagpipe_operator.schedules.cron import Cron, UnusableScheduleError
from bagpipe_operator.schedules.view import ScheduledJob, ScheduleView

# Past this many the rest is not counted: CronJob's own bound.
MISSED_LIMIT = 100
# A last run that is this much ahead was another replica's, and is caught up with: the runs until
# then may have been done, and their jobs be gone.
MOST_AHEAD = timedelta(minutes=10)
DEFAULT_TIME_ZONE = "Etc/UTC"
DEFAULT_SUCCESSFUL_HISTORY = 3
DEFAULT_FAILED_HISTORY = 1


class Verdict(Enum):
    """What becomes of the latest run that is due."""

    NOTHING_DUE = "nothing is due"
    START = "its job is to be started"
    WAIT = "it waits for an active job, since Forbid"
    TOO_LATE = "its deadline for starting has passed"


@dataclass(frozen=True)
class Decision:
    """What to do now, and when to look again."""

    verdict: Verdict
    run: datetime | None = None  # the latest run that is due
    due: int = 0  # runs that are due, counted up to MISSED_LIMIT + 1
    replaced: tuple[ScheduledJob, ...] = ()  # to be deleted before the run's job is made
    active: tuple[ScheduledJob, ...] = ()
    surplus: tuple[ScheduledJob, ...] = ()  # ended jobs beyond the history's limits
    last_run: datetime | None = None  # the latest run that has a job, or had one
    unwritten: bool = False  # its job is there and the status does not say so yet
    next_run: datetime | None = None
    unusable: UnusableScheduleError | None = None
    wake: datetime | None = None  # None: only a change of the schedule or its jobs matters


def time_zone_of(schedule: ScheduleView) -> str:
    """The name of the zone whose clock the runs go by."""
    return str(schedule.spec.get("timeZone") or DEFAULT_TIME_ZONE)


def decide(
    schedule: ScheduleView, jobs: tuple[ScheduledJob, ...], now: datetime, zone: ZoneInfo | None
) -> Decision:
    """The decision for a schedule, in its zone, and its jobs, the earliest first."""
    last_run = _last_run(schedule, jobs, now)
    seen = Decision(
        Verdict.NOTHING_DUE,
        active=tuple(job for job in jobs if not job.finished),
        surplus=_surplus(schedule, jobs),
        last_run=last_run,
        unwritten=last_run is not None and last_run != written_run(schedule),
    )
    try:
        expression = str(schedule.spec.get("schedule") or "")
        cron = Cron.parse(expression, time_zone_of(schedule), zone)
        next_run = _some_run(cron, now)
    except UnusableScheduleError as error:
        return replace(seen, unusable=error)
    if schedule.suspended:
        return seen
    seen = replace(seen, next_run=next_run, wake=next_run)
    if last_run is not None and last_run > now + MOST_AHEAD:
        # The clock was ahead when that was written, and the runs until then are still to come.
        seen = replace(seen, last_run=cron.latest_run(schedule.created, now), unwritten=False)
    since = seen.last_run or schedule.created
    run = cron.latest_run(since, now)
    if run is None and not seen.unwritten:
        return seen
    seen = replace(seen, run=run, due=_due(schedule, jobs, cron, run or since, now))
    return seen if run is None else _with_due_run(schedule, seen, run, now)


def _due(
    schedule: ScheduleView, jobs: tuple[ScheduledJob, ...], cron: Cron, latest: datetime,
    now: datetime,
) -> int:  # fmt: skip
    """How many runs are due up to the latest one, with it, of which the status says nothing.

    Those that have jobs were not missed.
    """
    written = written_run(schedule) or schedule.created
    runs = [job.run for job in jobs if job.run is not None and written < job.run < latest]
    return max(1, cron.count_runs(written, now, MISSED_LIMIT + 1) - len(runs))


def _with_due_run(schedule: ScheduleView, seen: Decision, run: datetime, now: datetime) -> Decision:
    seconds = readings.seconds(schedule.spec.get("startingDeadline"))
    deadline = None if seconds is None else run + timedelta(seconds=seconds)
    if deadline is not None and now > deadline:
        return replace(seen, verdict=Verdict.TOO_LATE)
    policy = schedule.spec.get("concurrencyPolicy") or "Allow"
    if policy == "Forbid" and seen.active:
        if deadline is not None and seen.wake is not None:
            # Just after the deadline the run is reported as missed.
            seen = replace(seen, wake=min(seen.wake, deadline + timedelta(seconds=1)))
        return replace(seen, verdict=Verdict.WAIT)
    replaced = seen.active if policy == "Replace" else ()
    return replace(seen, verdict=Verdict.START, replaced=replaced)


def _some_run(cron: Cron, now: datetime) -> datetime:
    run = cron.next_run(now)
    if run is None:
        raise UnusableScheduleError(
            reasons.INVALID_SCHEDULE,
            f"spec.schedule {cron.expression!r} names no moment in the next 50 years: write days "
            "that the months have.",
        )
    return run


def _last_run(
    schedule: ScheduleView, jobs: tuple[ScheduledJob, ...], now: datetime
) -> datetime | None:
    """The latest run that was started: as the status says, or as its job does.

    An operator that is killed between creating a job and writing the status leaves only the job.
    """
    runs = [job.run for job in jobs if job.run is not None and job.run <= now]
    written = written_run(schedule)
    return max(runs if written is None else [*runs, written], default=None)


def written_run(schedule: ScheduleView) -> datetime | None:
    """The last run that the schedule's status names."""
    return readings.moment(schedule.status.get("lastScheduleTime"))


def _limit(schedule: ScheduleView, field: str, default: int) -> int:
    limit = readings.whole(schedule.spec.get(field))
    return default if limit is None else limit


def _surplus(schedule: ScheduleView, jobs: tuple[ScheduledJob, ...]) -> tuple[ScheduledJob, ...]:
    """The earliest of the ended jobs beyond the limits, good and failed ones apart.

    Not those of whose end somebody is still to be notified, as only their statuses know.
    """
    limits = {
        True: _limit(schedule, "successfulJobsHistoryLimit", DEFAULT_SUCCESSFUL_HISTORY),
        False: _limit(schedule, "failedJobsHistoryLimit", DEFAULT_FAILED_HISTORY),
    }
    surplus: list[ScheduledJob] = []
    for complete, limit in limits.items():
        ended = [j for j in jobs if j.finished and not j.deleting and j.complete is complete]
        surplus += [j for j in ended[: max(0, len(ended) - limit)] if not j.owes]
    return tuple(surplus)
