"""What anybody wrote into a status, and what the operator takes it for."""

from datetime import UTC, datetime

import pytest

from bagpipe_operator.api import readings
from bagpipe_operator.jobs.driver.progress import parse
from bagpipe_operator.jobs.pods.job_config import UnusableSpecError, read_spec
from bagpipe_operator.jobs.policies.halt import halt_of
from bagpipe_operator.jobs.policies.ttl import expired
from bagpipe_operator.schedules.view import ScheduledJob
from tests.unit.operator.builders import START, account, make_driver, make_job
from tests.unit.operator.schedules import world as schedules
from tests.unit.operator.world import World

# The API server takes each of them for a date-time, and Python's datetime none.
FORGED = ["0000-01-01T00:00:00Z", "9999-12-31T23:59:59-23:59", "2026-11-20T04:00:00z"]


@pytest.mark.parametrize("text", [*FORGED, "", "now", "2026-11-20", "2026-11-20T04:00:00", None, 5])
def test_what_is_no_moment_is_absent(text: object) -> None:
    assert readings.moment(text) is None


def test_a_moment_is_read_in_utc() -> None:
    there = readings.moment("2026-11-20T05:00:00+01:00")
    assert there == START
    assert there is not None
    assert there.tzinfo is UTC


@pytest.mark.parametrize(
    ("value", "read"),
    [
        (5, 5),
        (5.0, 5),
        (0, 0),
        (5.5, None),
        (True, None),
        ("5", None),
        (1e308, None),
        (2**64, None),
    ],
)
def test_whole_numbers_are_those_that_64_bits_hold(value: object, read: int | None) -> None:
    assert readings.whole(value) == read


def test_a_status_keeps_the_fields_that_are_what_they_should_be() -> None:
    forged = {
        "attempt": "x", "lostDrivers": -1, "phase": ["Running"], "unknown": 1, "driver": "d",
        "cases": {"planned": 3, "lost": "x"}, "conditions": [5, {"type": "Running"}],
        "startTime": FORGED[0],
    }  # fmt: skip
    assert readings.status(forged) == {"cases": {"planned": 3}, "conditions": [], "driver": "d"}
    assert readings.status("no object") == {}


def test_a_condition_without_its_moment_is_as_old_as_can_be() -> None:
    [read] = readings.conditions([{"type": "Running", "status": "True", "reason": 5}])
    assert read["lastTransitionTime"] == "1970-01-01T00:00:00Z"
    assert (read["reason"], read["message"]) == ("", "")


@pytest.mark.parametrize("moment", FORGED)
async def test_a_job_with_forged_moments_goes_on(moment: str) -> None:
    condition = {"type": "Running", "status": "True", "reason": "x", "message": "y"}
    world = World(
        make_job("x").with_status(
            startTime=moment,
            nextAttemptTime=moment,
            completionTime=moment,
            lostDrivers=0,
            conditions=[condition | {"lastTransitionTime": moment}],
        )
    )
    await world.reconcile()
    assert world.status()["phase"] == "Pending"
    assert world.reason("Accepted") == "True/DriverCreated"


@pytest.mark.parametrize("moment", FORGED)
def test_a_pod_with_forged_moments_is_seen(moment: str) -> None:
    driver = make_driver("x").disrupted("x", "y").object()
    driver["status"]["conditions"][0]["lastTransitionTime"] = moment
    pod = type(make_driver("x").view()).from_object(driver)
    assert pod.disruption is not None
    assert pod.disruption.at is None


@pytest.mark.parametrize("moment", FORGED)
def test_a_schedule_s_job_with_forged_moments_is_seen(moment: str) -> None:
    job = schedules.make_job("nightly-1", "Complete", at=moment)
    assert ScheduledJob.from_object(job).completed is None


@pytest.mark.parametrize("forged", [2**63 - 1, "9" * 400 + "h", "292y", "\u0663s", "2562047h"])
def test_a_forged_deadline_is_none_and_stops_no_clock(forged: object) -> None:
    view = make_job("x").with_status(startTime="2026-11-20T04:00:00Z")
    view.with_spec("activeDeadline", forged).with_spec("startDeadline", forged)
    assert halt_of(view.view(), datetime(2026, 12, 1, tzinfo=UTC)) is None
    assert not expired(view.view(), START)


@pytest.mark.parametrize("size", [5, "x", [], {"memory": "x"}, {"memory": "9" * 400 + "Ti"}])
def test_a_size_that_no_heap_follows_from_is_refused(size: object) -> None:
    job = make_job("x").with_spec("spark.driver.resources", size)
    with pytest.raises(UnusableSpecError, match=r"spec\.spark\.driver\.resources"):
        read_spec(job.view())


def test_an_account_of_more_cases_than_the_api_server_counts_is_none() -> None:
    assert parse(account(cases={"planned": 2**63 - 1})) is not None
    assert parse(account(cases={"planned": 2**63})) is None


def test_a_number_beyond_all_numbers_is_refused() -> None:
    parts = [{"bag": "pvc://recordings/a.bag", "to": "9" * 400 + "h"}]
    job = make_job("x").with_spec("source", {"sequence": parts, "topics": ["/image"]})
    with pytest.raises(UnusableSpecError, match="is not a duration"):
        read_spec(job.view())
    job = make_job("x").with_spec(
        "source", {"simulator": {"step": "9" * 400 + "s", "duration": "9" * 400 + "s"}}
    )
    with pytest.raises(UnusableSpecError):
        read_spec(job.view())
