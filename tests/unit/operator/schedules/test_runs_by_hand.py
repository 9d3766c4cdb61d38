"""Runs between two moments, counted on the fingers."""

from datetime import UTC, datetime, timedelta

import pytest

from bagpipe_operator.schedules.cron import Cron, read_zone

START = datetime(2026, 11, 20, 4, 0, tzinfo=UTC)
MINUTE, SECOND = timedelta(minutes=1), timedelta(seconds=1)


def every(minutes: int) -> Cron:
    return Cron.parse(f"*/{minutes} * * * *", "Etc/UTC", read_zone("Etc/UTC"))


def test_of_runs_each_minute_the_latest_is_that_of_the_last_whole_one() -> None:
    cron = every(1)
    for count in range(1, 30):
        for late in (0, 1, 59):
            until = START + count * MINUTE + late * SECOND
            assert cron.latest_run(START, until) == START + count * MINUTE


@pytest.mark.parametrize(
    ("minutes", "latest"),
    [(9.9, None), (10, 10), (19.9, 10), (20, 20), (29.9, 20), (45, 40), (60, 60), (1439, 1430)],
)
def test_the_latest_run_may_be_the_moment_itself(minutes: float, latest: int | None) -> None:
    found = every(10).latest_run(START, START + minutes * MINUTE)
    assert found == (None if latest is None else START + latest * MINUTE)


def test_of_two_runs_a_minute_apart_the_second_is_the_latest() -> None:
    cron = Cron.parse("10,11 * * * *", "Etc/UTC", read_zone("Etc/UTC"))
    for minutes, latest in ((10.9, 10), (11, 11), (12, 11), (40, 11)):
        assert cron.latest_run(START, START + minutes * MINUTE) == START + latest * MINUTE


@pytest.mark.parametrize(
    ("minutes", "limit", "count"), [(9.9, 5, 0), (10, 5, 1), (50, 5, 5), (60, 5, 5), (60, 6, 6)]
)
def test_runs_are_counted_up_to_a_limit(minutes: float, limit: int, count: int) -> None:
    assert every(10).count_runs(START, START + minutes * MINUTE, limit) == count


def test_a_schedule_without_a_run_has_none_to_count() -> None:
    cron = Cron.parse("* * */20 * 1L", "Etc/UTC", read_zone("Etc/UTC"))
    until = START + timedelta(days=365)
    assert (cron.latest_run(START, until), cron.count_runs(START, until, 5)) == (None, 0)


@pytest.mark.parametrize("name", ["Etc/../../../etc/passwd", "Europe/\0", "America", "Mars/Base"])
def test_a_name_that_leads_to_no_zone_s_file_is_none(name: str) -> None:
    assert read_zone(name) is None
