"""When runs are: properties against a plain count of minutes, and the clock's changes by hand."""

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bagpipe_operator.schedules.cron import Cron, UnusableScheduleError, read_zone

ZONES = ["Etc/UTC", "Europe/Berlin", "America/New_York", "Australia/Sydney", "Asia/Kolkata"]


def parsed(schedule: str, zone: str) -> Cron:
    return Cron.parse(schedule, zone, read_zone(zone))


def runs(schedule: str, zone: str, since: str, count: int) -> list[str]:
    """Runs after a moment of the zone's clock, as that clock shows them."""
    cron = parsed(schedule, zone)
    moment = datetime.fromisoformat(since).replace(tzinfo=ZoneInfo(zone)).astimezone(UTC)
    shown = []
    for _ in range(count):
        found = cron.next_run(moment)
        assert found is not None
        moment = found
        shown.append(moment.astimezone(cron.zone).strftime("%m-%d %H:%M %z"))
    return shown


@pytest.mark.parametrize(
    ("schedule", "expected"),
    [
        ("30 2 * * MON-FRI", ["11-20 02:30 +0000", "11-23 02:30 +0000"]),
        ("*/20 4 * * *", ["11-20 04:00 +0000", "11-20 04:20 +0000"]),
        ("0 0 1 1 *", ["01-01 00:00 +0000", "01-01 00:00 +0000"]),
        ("@daily", ["11-21 00:00 +0000", "11-22 00:00 +0000"]),
        ("@hourly", ["11-20 01:00 +0000", "11-20 02:00 +0000"]),
        ("0 12 13 * FRI", ["11-20 12:00 +0000", "11-27 12:00 +0000"]),  # either day, as in cron
    ],
)
def test_next_runs(schedule: str, expected: list[str]) -> None:
    assert runs(schedule, "Etc/UTC", "2026-11-20T00:00:00", 2) == expected


DAILY, QUARTERS, TWICE = "30 2 * * *", "*/30 2 * * *", "0,30 2 * * *"


@pytest.mark.parametrize(
    ("zone", "since", "schedule", "expected"),
    [
        # The north's spring: 02:00 becomes 03:00 on 29 March 2026.
        ("Europe/Berlin", "2026-03-28T12:00:00", DAILY,
         ["03-29 03:00 +0200", "03-30 02:30 +0200"]),
        ("Europe/Berlin", "2026-03-28T12:00:00", QUARTERS,
         ["03-30 02:00 +0200", "03-30 02:30 +0200"]),
        ("Europe/Berlin", "2026-03-28T12:00:00", TWICE,
         ["03-29 03:00 +0200", "03-30 02:00 +0200"]),
        # The north's autumn: 03:00 becomes 02:00 on 25 October 2026.
        ("Europe/Berlin", "2026-10-24T12:00:00", DAILY,
         ["10-25 02:30 +0200", "10-26 02:30 +0100"]),
        ("Europe/Berlin", "2026-10-24T12:00:00", QUARTERS,
         ["10-25 02:00 +0200", "10-25 02:30 +0200", "10-25 02:00 +0100", "10-25 02:30 +0100"]),
        # The south's spring: 02:00 becomes 03:00 on 4 October 2026.
        ("Australia/Sydney", "2026-10-03T12:00:00", DAILY,
         ["10-04 03:00 +1100", "10-05 02:30 +1100"]),
        ("Australia/Sydney", "2026-10-03T12:00:00", QUARTERS,
         ["10-05 02:00 +1100", "10-05 02:30 +1100"]),
        # The south's autumn: 03:00 becomes 02:00 on 5 April 2026.
        ("Australia/Sydney", "2026-04-04T12:00:00", DAILY,
         ["04-05 02:30 +1100", "04-06 02:30 +1000"]),
        ("Australia/Sydney", "2026-04-04T12:00:00", QUARTERS,
         ["04-05 02:00 +1100", "04-05 02:30 +1100", "04-05 02:00 +1000", "04-05 02:30 +1000"]),
        # Half an hour: 02:00 becomes 02:30 on 4 October 2026.
        ("Australia/Lord_Howe", "2026-10-03T12:00:00", "15 2 * * *",
         ["10-04 02:30 +1100", "10-05 02:15 +1100"]),
    ],
)  # fmt: skip
def test_the_clock_s_changes(zone: str, since: str, schedule: str, expected: list[str]) -> None:
    assert runs(schedule, zone, since, len(expected)) == expected


@pytest.mark.parametrize(
    ("zone", "changes"),
    [("Europe/Berlin", "2026-10-25"), ("Australia/Sydney", "2026-04-05")],
)
def test_from_within_the_repeated_hour_the_first_run_is_not_named_again(
    zone: str, changes: str
) -> None:
    second = datetime.fromisoformat(f"{changes}T02:10:00").replace(tzinfo=ZoneInfo(zone), fold=1)
    run = parsed(DAILY, zone).next_run(second.astimezone(UTC))
    assert run is not None
    assert run > second.astimezone(UTC) + timedelta(hours=23)


fields = st.tuples(
    st.sampled_from(["*", "*/7", "0", "5,35", "59"]),
    st.sampled_from(["*", "*/3", "2", "1-3", "0"]),
    st.sampled_from(["*", "1", "*/10", "25"]),
    st.just("*"),
    st.sampled_from(["*", "SUN", "1-5"]),
).map(" ".join)
# A year with all its changes, to the second.
moments = st.integers(0, 365 * 86400 - 1).map(
    lambda s: datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=s)
)


@given(fields, st.sampled_from(ZONES), moments)
@settings(max_examples=300, deadline=None)
def test_a_next_run_is_later_whole_and_without_another_before_it(
    schedule: str, zone: str, now: datetime
) -> None:
    cron = parsed(schedule, zone)
    run = cron.next_run(now)
    assert run is not None
    assert run > now
    assert (run.second, run.microsecond, run.utcoffset()) == (0, 0, timedelta(0))
    for part in (1, 2, 3):
        between = now + (run - now) * part / 4
        assert cron.next_run(between) == run


@given(
    st.sampled_from(["* * * * *", "*/15 2 * * *", "*/20 1-3 * * *", "* 2 * * SUN"]),
    st.sampled_from(ZONES),
    st.sampled_from(["2026-03-28", "2026-03-07", "2026-10-24", "2026-10-31", "2026-04-04"]),
    st.integers(0, 86400),
)
@settings(max_examples=100, deadline=None)
def test_with_a_star_runs_are_the_minutes_that_the_wall_s_clock_shows(
    schedule: str, zone: str, day: str, seconds: int
) -> None:
    cron = parsed(schedule, zone)
    now = datetime.fromisoformat(day).replace(tzinfo=UTC) + timedelta(seconds=seconds)
    found, moment = [], now
    while (run := cron.next_run(moment)) is not None and run <= now + timedelta(hours=30):
        found.append(run)
        moment = run
    start = now.replace(second=0, microsecond=0)
    shown = [start + timedelta(minutes=m) for m in range(1, 30 * 60 + 1)]
    assert found == [m for m in shown if matches(schedule, m.astimezone(cron.zone))]


def matches(schedule: str, wall: datetime) -> bool:
    """The few patterns above, understood by another way than the library's."""
    minute, hour, _, _, weekday = schedule.split()
    step = int(minute.removeprefix("*/")) if "/" in minute else 1
    first, _, last = hour.partition("-")
    hours = range(24) if hour == "*" else range(int(first), int(last or first) + 1)
    return (
        wall.minute % step == 0 and wall.hour in hours and (weekday == "*" or wall.weekday() == 6)
    )


@given(fields, st.sampled_from(ZONES), moments, st.integers(1, 200_000))
@example("30 2 * * *", "Europe/Berlin", datetime(2026, 3, 29, 0, 59, tzinfo=UTC), 60)
@settings(max_examples=200, deadline=None)
def test_the_latest_run_is_the_last_of_all(
    schedule: str, zone: str, since: datetime, seconds: int
) -> None:
    cron = parsed(schedule, zone)
    until = since + timedelta(seconds=seconds)
    every, moment = [], since
    while (run := cron.next_run(moment)) is not None and run <= until:
        every.append(run)
        moment = run
    assert cron.latest_run(since, until) == (every[-1] if every else None)
    assert cron.count_runs(since, until, 101) == min(len(every), 101)


def test_a_year_of_minutes_is_bisected_and_not_walked(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[datetime] = []
    plain = Cron.next_run

    def counted(cron: Cron, after: datetime) -> datetime | None:
        asked.append(after)
        return plain(cron, after)

    monkeypatch.setattr(Cron, "next_run", counted)
    cron = parsed("* * * * *", "Etc/UTC")
    now = datetime(2026, 11, 20, 4, 0, 30, tzinfo=UTC)
    assert cron.latest_run(now - timedelta(days=365), now) == now.replace(second=0)
    assert len(asked) < 30


@pytest.mark.parametrize(
    ("schedule", "words"),
    [
        ("60 * * * *", "Bad minute"),
        ("* * * *", "4 fields instead of 5"),
        ("0 0 2 * * *", "6 fields instead of 5"),
        ("0 0 31 2 *", "Bad day-of-month"),
        ("@reboot", "1 fields instead of 5"),
        ("", "0 fields instead of 5"),
    ],
)
def test_what_is_no_schedule(schedule: str, words: str) -> None:
    with pytest.raises(UnusableScheduleError, match=words) as caught:
        parsed(schedule, "Etc/UTC")
    assert caught.value.reason == "InvalidSchedule"
    assert 'for example "30 2 * * MON-FRI"' in str(caught.value)


@pytest.mark.parametrize(
    "zone",
    [
        "Europe/Nowhere",
        "America",
        "../../etc/passwd",
        "/etc/localtime",
        "localtime",
        "",
        "right/UTC",
    ],
)
def test_what_is_no_zone(zone: str) -> None:
    with pytest.raises(UnusableScheduleError, match="IANA time zone database") as caught:
        parsed("@daily", zone)
    assert caught.value.reason == "UnknownTimeZone"


def test_a_schedule_that_names_no_moment() -> None:
    # From the 20th on every 20th day, and the last Monday of the month.
    assert parsed("* * */20 * 1L", "Etc/UTC").next_run(datetime(2026, 1, 1, tzinfo=UTC)) is None
