"""When a schedule's runs are: cron's five fields in a time zone, as moments in UTC.

The clock's changes are treated as Debian's cron treats them:

- With numbers in both the minute and the hour field (`30 2 * * *`) a run falls on each day once. In
  the gap of spring it comes right after the gap; of the hour that autumn repeats, the first counts.
- With a `*` at the start of either (`*/15 2 * * *`) runs follow the clock on the wall: none in the
  gap, and in the repeated hour both times.
"""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from cronsim import CronSim, CronSimError

from bagpipe_operator.api import reasons

MACROS = {
    "@yearly": "0 0 1 1 *",
    "@annually": "0 0 1 1 *",
    "@monthly": "0 0 1 * *",
    "@weekly": "0 0 * * 0",
    "@daily": "0 0 * * *",
    "@midnight": "0 0 * * *",
    "@hourly": "0 * * * *",
}
FIELDS = 5
# Runs are whole minutes, so two moments within one have at most one run between them.
MINUTE = timedelta(minutes=1)


class UnusableScheduleError(ValueError):
    """`schedule` or `timeZone` says no time; `reason` is for the conditions."""

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason


@dataclass(frozen=True)
class Cron:
    """Five fields of cron in a time zone."""

    expression: str
    zone: ZoneInfo

    @classmethod
    def parse(cls, schedule: str, time_zone: str, zone: ZoneInfo | None) -> "Cron":
        """Reads spec.schedule and spec.timeZone, whose zone is `zone`, or None for no zone's name.

        Raises UnusableScheduleError.
        """
        expression = MACROS.get(schedule.strip().lower(), schedule.strip())
        try:
            if len(expression.split()) != FIELDS:
                raise CronSimError(f"{len(expression.split())} fields instead of {FIELDS}")
            CronSim(expression, datetime(2026, 1, 1, tzinfo=UTC))
        except CronSimError as error:
            raise UnusableScheduleError(
                reasons.INVALID_SCHEDULE,
                f"spec.schedule {schedule!r} is no cron expression: {error}. Write minute, hour, "
                'day of month, month and day of week, for example "30 2 * * MON-FRI".',
            ) from None
        if zone is None:
            raise UnusableScheduleError(
                reasons.UNKNOWN_TIME_ZONE,
                f"spec.timeZone {time_zone!r} is no zone of the IANA time zone database: write for "
                "example Europe/Berlin or Etc/UTC.",
            )
        return cls(expression, zone)

    def next_run(self, after: datetime) -> datetime | None:
        """The first run later than a moment, in UTC; None when there is none in 50 years."""
        for run in CronSim(self.expression, after.astimezone(self.zone)):
            moment = run.astimezone(UTC)
            # Within the repeated hour, and with two runs in one gap, cronsim goes by the clock on
            # the wall and may name a moment that is over.
            if moment > after:
                return moment
        return None

    def latest_run(self, after: datetime, until: datetime) -> datetime | None:
        """The last run in (after, until], found by bisection however many there are."""
        run = self.next_run(after)
        if run is None or run > until:
            return None
        early, late = run, until
        while late - early > MINUTE:
            middle = early + (late - early) / 2
            found = self.next_run(middle)
            if found is None or found > until:
                late = middle
            else:
                run = early = found
        following = self.next_run(early)
        return following if following is not None and following <= until else run

    def count_runs(self, after: datetime, until: datetime, limit: int) -> int:
        """How many runs lie in (after, until], counted up to `limit`."""
        count = 0
        run = self.next_run(after)
        while run is not None and run <= until and count < limit:
            count += 1
            run = self.next_run(run)
        return count


def read_zone(name: str) -> ZoneInfo | None:
    """The zone of that name, which is read from a file; None where there is none."""
    # Lower-case names are of files that lie beside the zones, such as right/ and localtime.
    if not name[:1].isupper():
        return None
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        return None
