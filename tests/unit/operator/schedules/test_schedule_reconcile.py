"""Schedules over a fake API server and a fake clock: what is started when, and what is reported."""

import asyncio
import copy
from dataclasses import replace
from datetime import timedelta
from typing import Any

import pytest

from bagpipe_operator.api import names
from bagpipe_operator.api.nesting import is_deep
from bagpipe_operator.api.objects import Json
from bagpipe_operator.api.runs import run_of
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.schedules.alarms import Alarms
from bagpipe_operator.schedules.view import ScheduledJob, ScheduleView
from tests.unit.operator import virtual_time
from tests.unit.operator.schedules.world import (
    UID,
    World,
    make_job,
    make_schedule,
    minute,
    name_of,
)
from tests.waiting import PATIENCE


async def test_before_the_first_run_only_the_status_is_written() -> None:
    world = World()
    await world.at(0, 40)
    assert world.names == []
    assert world.status["nextScheduleTime"] == "2026-11-20T04:01:00Z"
    assert "lastScheduleTime" not in world.status
    assert world.condition("Ready") == ("True", "Scheduled")
    assert world.condition("Stalled") == ("False", "Scheduled")
    assert world.condition("Suspended") == ("False", "NotSuspended")
    assert world.condition("OnTime") == ("True", "NoRunYet")
    assert world.events() == []
    world.api.calls.clear()
    await world.at(0, 50)
    assert world.api.calls == []


async def test_a_run_makes_one_job_however_often_it_is_looked_at() -> None:
    world = World()
    for seconds in (0, 0.5, 1, 30, 59):
        await world.at(1, seconds)
    assert world.names == [name_of(1)]
    assert run_of(name_of(1)) == minute(1)
    assert world.status["lastScheduleTime"] == "2026-11-20T04:01:00Z"
    assert world.status["nextScheduleTime"] == "2026-11-20T04:02:00Z"
    assert (world.status["activeCount"], world.status["active"]) == (1, [name_of(1)])
    assert world.condition("OnTime") == ("True", "JobStarted")
    assert world.events() == ["Normal/JobStarted"]
    assert world.api.calls == ["list", "list", "get", f"create {name_of(1)}", "patch", "event"]


async def test_the_job_is_the_template_s_and_the_schedule_s() -> None:
    world = World()
    await world.at(1)
    job = world.api.jobs[name_of(1)]
    meta = job["metadata"]
    assert (job["kind"], meta["namespace"]) == ("SimulationJob", "lanes")
    assert meta["labels"] == {"team": "lanes", names.LABEL_SCHEDULE: "nightly"}
    assert meta["annotations"] == {
        "why": "regression",
        names.ANNOTATION_SCHEDULED_AT: "2026-11-20T04:01:00Z",
    }
    (owner,) = meta["ownerReferences"]
    assert (owner["kind"], owner["name"], owner["uid"]) == ("SimulationSchedule", "nightly", UID)
    assert owner["controller"] is True
    assert job["spec"] == {"source": {"bags": ["pvc://recordings/drive.bag"]}}


async def test_the_alarm_is_set_to_the_next_run() -> None:
    world = World()
    await world.at(1)
    world.clock = minute(2) - timedelta(seconds=1)
    assert world.alarms.ring() == 0
    world.clock = minute(2)
    assert world.alarms.ring() == 1


async def test_of_missed_runs_the_latest_is_made_up_for() -> None:
    world = World()
    await world.at(1)
    world.restart()
    await world.at(7, 20)
    assert world.names == [name_of(1), name_of(7)]
    assert world.condition("OnTime") == ("False", "MissedStart")
    assert "5 runs were missed" in world.message("OnTime")
    assert world.events() == ["Normal/JobStarted", "Warning/MissedStart"]
    await world.at(8)
    assert world.condition("OnTime") == ("True", "JobStarted")


@pytest.mark.parametrize("later", [7, 8])
@pytest.mark.parametrize("call", ["create", "patch"])
async def test_missed_runs_are_reported_also_where_the_start_had_no_answer(
    call: str, later: int
) -> None:
    """The job is found afterwards, by this operator or the next one."""
    world = World()
    await world.at(1)
    if call == "create":
        world.api.lost["create"] = ApiError(0, "Unreachable", "no answer")
    else:
        world.api.fail("patch", ApiError(0, "Unreachable", "killed"))
    with pytest.raises(ApiError, match="Unreachable"):
        await world.at(7)
    world.restart()
    await world.at(later, 20)
    assert world.names == [name_of(count) for count in (1, *range(7, later + 1))]
    assert world.condition("OnTime") == ("False", "MissedStart")
    assert "5 runs were missed" in world.message("OnTime")
    started = ["Normal/JobStarted"] * (later - 6)
    assert world.events() == [*started, "Warning/MissedStart"]


@pytest.mark.parametrize(("gap", "reason"), [(100, "MissedStart"), (101, "TooManyMissedStarts")])
async def test_a_hundred_missed_runs_and_more_have_different_reasons(gap: int, reason: str) -> None:
    world = World()
    await world.at(1)
    await world.at(1 + gap)
    assert world.names == sorted([name_of(1), name_of(1 + gap)])
    assert world.condition("OnTime") == ("False", reason)


async def test_a_clock_that_is_set_back_stops_no_schedule() -> None:
    """It was a day ahead, and a run of that day has been started."""
    world = World()
    await world.at(1)
    await world.at(1441)
    assert world.alarms.ring() == 0
    world.clock = minute(2) + timedelta(seconds=30)
    assert world.alarms.ring() == 1
    await world.at(2, 30)
    assert world.alarms.ring() == 0
    assert world.status["lastScheduleTime"] == "2026-11-20T04:02:00Z"
    assert world.status["nextScheduleTime"] == "2026-11-20T04:03:00Z"
    world.clock = minute(3)
    assert world.alarms.ring() == 1
    await world.at(3)
    assert world.names == [name_of(1), name_of(3), name_of(1441)]
    assert world.events() == [
        "Normal/JobStarted",
        "Warning/TooManyMissedStarts",
        "Normal/JobStarted",
    ]


async def test_a_schedule_that_rests_after_a_fault_is_visited_by_a_clock_that_was_set_back() -> (
    None
):
    world = World()
    seconds = [0.0]
    queue = WorkQueue(lambda: seconds[0])
    alarms = Alarms(queue, world.now)
    world.clock = minute(1441)
    alarms.set(UID, world.now())
    alarms.ring()
    assert await queue.get() == UID
    queue.retry(UID)
    world.clock = minute(2)
    for seconds[0] in (0.1, 60.0):
        alarms.ring()
    assert len(queue) == 1
    # Once it was visited, its alarm is of the new clock.
    assert await queue.get() == UID
    alarms.set(UID, minute(3))
    queue.done(UID)
    alarms.ring()
    assert len(queue) == 0


async def test_a_run_that_waits_asks_for_the_jobs_also_by_a_clock_that_was_set_back() -> None:
    world = World(concurrencyPolicy="Forbid")
    await world.at(1441)
    await world.at(2)
    del world.api.jobs[name_of(1441)]
    for seconds in (0, 31):
        await world.at(3, seconds)
    assert world.names == [name_of(3)]


async def test_a_replica_whose_clock_is_minutes_behind_makes_no_run_again() -> None:
    """Its job has ended and is kept no longer, so that only the status knows of it."""
    world = World(successfulJobsHistoryLimit=0)
    for count in range(1, 6):
        await world.at(count)
        world.end(name_of(count))
        await world.at(count, 1)
    world.restart()
    for count in (2, 3, 4, 5):
        await world.at(count, 30)
    assert (world.names, world.status["lastScheduleTime"]) == ([], "2026-11-20T04:05:00Z")
    await world.at(6)
    assert world.names == [name_of(6)]


async def test_a_replica_whose_clock_is_behind_starts_no_run_again() -> None:
    world = World()
    await world.at(1)
    world.restart()
    await world.at(0, 58)
    assert world.status["lastScheduleTime"] == "2026-11-20T04:01:00Z"
    await world.at(1, 1)
    assert world.names == [name_of(1)]
    assert world.events() == ["Normal/JobStarted"]


async def test_after_its_deadline_a_run_is_missed() -> None:
    world = World(schedule="0 * * * *", startingDeadline="20s")
    await world.at(60, 21)
    assert world.names == []
    assert world.condition("OnTime") == ("False", "MissedStart")
    assert "within startingDeadline (20s)" in world.message("OnTime")
    for seconds in (22, 40):
        await world.at(60, seconds)
    assert world.events() == ["Warning/MissedStart"]
    assert "lastScheduleTime" not in world.status
    await world.at(120, 20)
    assert world.names == [name_of(120)]


async def test_a_run_whose_job_was_made_without_an_answer_is_not_missed() -> None:
    """Its deadline is over before the watch has brought the job."""
    world = World(schedule="0 * * * *", startingDeadline="20s")
    world.api.lost["create"] = ApiError(0, "Unreachable", "no answer")
    with pytest.raises(ApiError, match="no answer"):
        await world.at(60, 20)
    await world.at(60, 21)
    assert world.condition("OnTime") == ("True", "JobStarted")
    assert (world.names, world.events()) == ([name_of(60)], ["Normal/JobStarted"])


async def test_forbid_waits_for_the_active_job_and_starts_the_latest() -> None:
    world = World(concurrencyPolicy="Forbid")
    await world.at(1)
    for count in (2, 3, 4):
        await world.at(count)
    assert world.names == [name_of(1)]
    assert world.condition("OnTime") == ("False", "JobActive")
    assert world.events() == ["Normal/JobStarted", "Normal/JobActive"]
    world.end(name_of(1))
    await world.at(4, 30)
    assert world.names == [name_of(1), name_of(4)]
    assert world.condition("OnTime") == ("False", "MissedStart")


async def test_forbid_asks_the_server_when_the_watch_has_not_brought_the_jobs() -> None:
    """A new operator that knows no jobs yet must not start a second one."""
    world = World(concurrencyPolicy="Forbid")
    await world.at(1)
    world.restart()
    await world.at(2)
    assert world.names == [name_of(1)]
    world.view.replace_jobs(UID, [])
    await world.at(2, 1)
    assert world.names == [name_of(1)]


async def test_forbid_does_not_wait_for_a_job_that_went_unseen() -> None:
    """Its deletion fell between two watches: only the API server knows."""
    world = World(schedule="0 * * * *", concurrencyPolicy="Forbid")
    await world.at(60)
    await world.at(120)
    assert world.condition("OnTime") == ("False", "JobActive")
    del world.api.jobs[name_of(60)]
    await world.at(120, 29)
    assert (world.names, world.alarms.ring()) == ([], 0)
    world.clock = minute(120) + timedelta(seconds=30)
    assert world.alarms.ring() == 1
    await world.at(120, 30)
    assert world.names == [name_of(120)]


async def test_a_run_that_waits_asks_for_the_jobs_every_thirty_seconds_and_no_more() -> None:
    world = World(schedule="0 * * * *", concurrencyPolicy="Forbid")
    await world.at(60)
    world.api.calls.clear()
    for seconds in range(100):
        await world.at(120, seconds)
    assert world.api.calls.count("list") == 4
    assert world.names == [name_of(60)]
    world.end(name_of(60))
    await world.at(120, 100)
    assert world.names == [name_of(60), name_of(120)]


async def test_a_waiting_run_is_looked_at_again_when_its_deadline_is_over() -> None:
    world = World(schedule="0 * * * *", concurrencyPolicy="Forbid", startingDeadline="60s")
    await world.at(60)
    await world.at(120)
    world.clock = minute(121) + timedelta(seconds=1)
    assert world.alarms.ring() == 1
    await world.at(121, 1)
    assert world.condition("OnTime") == ("False", "MissedStart")
    world.end(name_of(60))
    await world.at(122)
    assert world.names == [name_of(60)]


async def test_replace_deletes_before_it_creates() -> None:
    world = World(concurrencyPolicy="Replace")
    await world.at(1)
    world.api.calls.clear()
    await world.at(2)
    assert world.api.calls.index(f"delete {name_of(1)}") < world.api.calls.index(
        f"create {name_of(2)}"
    )
    assert world.names == [name_of(2)]
    assert world.condition("OnTime") == ("True", "JobReplaced")
    assert name_of(1) in world.message("OnTime")


async def test_what_is_refused_replaces_nothing() -> None:
    world = World(concurrencyPolicy="Replace")
    await world.at(1)
    world.api.fail(f"try {name_of(2)}", ApiError(422, "Invalid", "spec.stack: Required value"))
    with pytest.raises(ApiError, match="Required value"):
        await world.at(2)
    assert world.names == [name_of(1)]
    assert world.condition("OnTime") == ("False", "CreationRefused")
    # Mended: the run is made up for, and replaces the one before.
    await world.at(2, 30)
    assert world.names == [name_of(2)]


@pytest.mark.parametrize("status", [404, 409, 429, 500, 504])
async def test_what_a_webhook_denies_replaces_nothing_whatever_code_it_chose(status: int) -> None:
    """With 409 the job that ran was deleted, none was made, and the status named it as made."""
    words = 'admission webhook "jobs.example" denied the request: frozen'
    world = World(concurrencyPolicy="Replace")
    await world.at(1)
    for second in (0, 10, 20):
        world.api.fail(f"try {name_of(2)}", ApiError(status, "Conflict", words))
        with pytest.raises(ApiError, match="frozen"):
            await world.at(2, second)
    assert world.names == [name_of(1)]
    assert world.condition("OnTime") == ("False", "CreationRefused")
    assert words in world.message("OnTime")
    assert [event["reason"] for event in world.api.written_events].count("CreationRefused") == 1


@pytest.mark.parametrize(
    "passing",
    [
        ApiError(409, "Conflict", 'Operation cannot be fulfilled on resourcequotas "jobs"'),
        # Of what is replaced.
        ApiError(403, "Forbidden", "exceeded quota: jobs, used: 1, limited: 1"),
    ],
    ids=["conflict", "quota"],
)
async def test_what_passes_when_the_one_before_is_gone_keeps_no_run_from_its_start(
    passing: ApiError,
) -> None:
    world = World(concurrencyPolicy="Replace")
    await world.at(1)
    world.api.fail(f"try {name_of(2)}", passing)
    await world.at(2)
    assert world.names == [name_of(2)]


async def test_a_name_that_is_taken_replaces_nothing() -> None:
    world = World(concurrencyPolicy="Replace")
    await world.at(1)
    world.api.jobs[name_of(2)] = make_job(name_of(2), uid="uid-of-another")
    with pytest.raises(ApiError, match="does not belong to this schedule"):
        await world.at(2)
    assert world.names == [name_of(1), name_of(2)]
    assert world.condition("OnTime") == ("False", "NameTaken")
    del world.api.jobs[name_of(2)]
    await world.at(2, 30)
    assert world.names == [name_of(2)]


async def test_a_webhook_that_can_t_be_tried_keeps_no_run_from_its_start() -> None:
    world = World(concurrencyPolicy="Replace")
    await world.at(1)
    text = 'admission webhook "jobs.example" does not support dry run'
    world.api.fail(f"try {name_of(2)}", ApiError(400, "BadRequest", text))
    await world.at(2)
    assert world.names == [name_of(2)]


async def test_allow_runs_side_by_side_and_names_ten() -> None:
    world = World()
    for count in range(1, 14):
        await world.at(count)
    assert world.status["activeCount"] == 13
    assert world.status["active"] == [name_of(count) for count in range(4, 14)]


async def test_while_suspended_nothing_runs_and_afterwards_the_latest() -> None:
    world = World(suspend=True)
    await world.at(5)
    assert world.names == []
    assert "nextScheduleTime" not in world.status
    assert world.condition("Suspended") == ("True", "SuspendedBySpec")
    world.change(suspend=False)
    await world.at(6, 10)
    assert world.names == [name_of(6)]
    assert world.events()[0] == "Normal/SuspendedBySpec"
    assert "Normal/NotSuspended" in world.events()
    world.change(suspend=True)
    await world.at(6, 20)
    assert "nextScheduleTime" not in world.status
    assert world.status["observedGeneration"] == 3


async def test_the_history_keeps_the_latest_of_each_kind() -> None:
    world = World(successfulJobsHistoryLimit=2, failedJobsHistoryLimit=1)
    for count, how in enumerate(["Complete", "Failed", "Complete", "Failed", "Complete"], 1):
        await world.at(count)
        world.end(name_of(count), how, at=f"2026-11-20T04:0{count}:30Z")
    await world.at(5, 40)
    assert world.names == [name_of(3), name_of(4), name_of(5)]
    assert world.status["lastSuccessfulTime"] == "2026-11-20T04:05:30Z"
    world.change(successfulJobsHistoryLimit=0, failedJobsHistoryLimit=0)
    await world.at(5, 50)
    assert world.names == []
    await world.at(5, 55)
    assert world.status["lastSuccessfulTime"] == "2026-11-20T04:05:30Z"


async def test_a_job_whose_pods_may_run_another_stays_until_they_have_ended() -> None:
    world = World(successfulJobsHistoryLimit=0)
    name = name_of(1)
    for pool in ({"name": "lane", "state": "Cold"}, {}):
        job = world.api.jobs[name] = make_job(name, "Complete")
        job["status"] |= {"pool": pool, "driver": f"{name}-1-driver", "attempt": 1}
        labels = {names.LABEL_JOB_UID: f"uid-of-{name}"}
        pod: Json = {"metadata": {"labels": labels}, "status": {"phase": "Running"}}
        world.api.pods[f"{name}-1-driver"] = pod
        world.restart()
        await world.at(1)
        assert (name in world.names) is bool(pool)
        pod["status"]["phase"] = "Succeeded"
        await world.at(1, 40)
        assert name not in world.names


async def test_a_job_that_was_made_and_not_written_down_is_not_made_again() -> None:
    """Killed between the two: the next operator finds the job and writes what happened."""
    world = World(successfulJobsHistoryLimit=0)
    world.api.fail("patch", ApiError(0, "Unreachable", "killed"))
    with pytest.raises(ApiError):
        await world.at(1)
    world.restart()
    world.end(name_of(1))
    await world.at(1, 20)
    assert world.names == []
    assert world.api.calls.count(f"create {name_of(1)}") == 1
    assert world.status["lastScheduleTime"] == "2026-11-20T04:01:00Z"
    assert world.condition("OnTime") == ("True", "JobStarted")
    assert world.events() == ["Normal/JobStarted"]


async def test_a_second_operator_that_comes_late_finds_the_job_made() -> None:
    world = World()
    world.api.fail(f"create {name_of(1)}", ApiError(409, "AlreadyExists", "exists"))
    world.api.fail("list", *[])
    await world.at(0, 45)
    world.api.jobs[name_of(1)] = make_job(name_of(1))
    world.api.jobs[name_of(1)]["metadata"]["labels"] = {}  # out of the list's sight until then
    with pytest.raises(ApiError, match="does not belong to this schedule"):
        await world.at(1)
    assert world.condition("OnTime") == ("False", "NameTaken")
    world.api.jobs[name_of(1)]["metadata"]["labels"] = {names.LABEL_SCHEDULE: "nightly"}
    await world.at(1, 5)
    assert world.condition("OnTime") == ("True", "JobStarted")
    assert world.names == [name_of(1)]


async def test_a_stale_schedule_starts_nothing() -> None:
    """The user suspended it, and the watch has not delivered that yet."""
    world = World()
    await world.at(0, 45)
    world.change_unseen(suspend=True)
    await world.at(1)
    assert world.names == []
    assert world.condition("Suspended") == ("True", "SuspendedBySpec")


async def test_a_refused_job_is_reported_and_tried_again() -> None:
    world = World(schedule="0 * * * *")
    refusal = ApiError(403, "Forbidden", "exceeded quota: count/simulationjobs=1")
    world.api.fail(f"create {name_of(60)}", refusal, refusal)
    for seconds in (0, 5):
        with pytest.raises(ApiError, match="the namespace's quota is full"):
            await world.at(60, seconds)
    assert world.condition("OnTime") == ("False", "QuotaExceeded")
    assert "lastScheduleTime" not in world.status
    assert world.alarms.ring() == 1
    await world.at(60, 90)
    assert world.names == [name_of(60)]
    assert "90 s late" in world.message("OnTime")
    assert world.events() == ["Warning/QuotaExceeded", "Normal/JobStarted"]


async def test_a_webhook_that_is_down_is_reported() -> None:
    world = World(schedule="0 * * * *")
    text = 'Internal error occurred: failed calling webhook "jobs.example": no endpoints available'
    world.api.fail(f"create {name_of(60)}", ApiError(500, "InternalError", text))
    with pytest.raises(ApiError, match=r"jobs\.example"):
        await world.at(60)
    assert world.condition("OnTime") == ("False", "CreationRefused")
    assert 'webhook "jobs.example"' in world.message("OnTime")
    await world.at(60, 5)
    assert world.names == [name_of(60)]
    assert world.events() == ["Warning/CreationRefused", "Normal/JobStarted"]


@pytest.mark.parametrize("made", [False, True])
async def test_a_webhook_that_hangs_is_reported_and_the_run_has_one_job(made: bool) -> None:
    world = World(schedule="0 * * * *")
    text = "Timeout: request did not complete within requested timeout - context deadline exceeded"
    if made:  # what was given up is done after all
        world.api.lost["create"] = ApiError(504, "Timeout", text)
    else:
        world.api.fail(f"create {name_of(60)}", ApiError(504, "Timeout", text))
    with pytest.raises(ApiError, match="an admission webhook hangs"):
        await world.at(60)
    assert world.condition("OnTime") == ("False", "CreationRefused")
    assert text in world.message("OnTime")
    await world.at(60, 5)
    assert world.names == [name_of(60)]
    assert world.condition("OnTime") == ("True", "JobStarted")


async def test_a_job_of_somebody_else_s_is_left_alone() -> None:
    world = World(successfulJobsHistoryLimit=0)
    world.api.jobs[name_of(1)] = make_job(name_of(1), "Complete", uid="uid-of-another")
    with pytest.raises(ApiError, match="does not belong to this schedule"):
        await world.at(1)
    assert world.names == [name_of(1)]


@pytest.mark.parametrize(
    ("spec", "reason"),
    [
        ({"schedule": "61 * * * *"}, "InvalidSchedule"),
        ({"schedule": "* * */20 * 1L"}, "InvalidSchedule"),
        ({"timeZone": "Europe/Nowhere"}, "UnknownTimeZone"),
    ],
)
async def test_what_can_t_be_understood_is_stalled_until_it_is_changed(
    spec: dict[str, str], reason: str
) -> None:
    world = World(**spec)
    await world.at(5)
    assert world.condition("Ready") == ("False", reason)
    assert world.condition("Stalled") == ("True", reason)
    assert "nextScheduleTime" not in world.status
    assert world.events() == [f"Warning/{reason}"]
    world.clock = minute(10_000)
    assert world.alarms.ring() == 0
    world.change(schedule="* * * * *", timeZone="Europe/Berlin")
    await world.at(6)
    assert world.condition("Stalled") == ("False", "Scheduled")
    assert world.names == [name_of(6)]


async def test_a_deleted_schedule_is_left_to_the_garbage_collector() -> None:
    world = World()
    await world.at(0, 45)
    world.api.schedule = None
    await world.at(1)
    assert world.names == []
    await world.at(2)
    assert world.alarms.ring() == 0


@pytest.mark.parametrize("call", ["get", "patch"])
async def test_a_404_that_is_not_the_schedule_s_forgets_no_schedule(call: str) -> None:
    """As of a proxy, or while the CRD is replaced."""
    world = World()
    world.api.fail(call, ApiError(404, "Unknown", "404 page not found"))
    with pytest.raises(ApiError, match="404 page not found"):
        await world.at(1)
    assert world.view.schedule(UID) is not None
    await world.at(1, 1)
    assert world.names == [name_of(1)]
    assert world.condition("OnTime") == ("True", "JobStarted")
    assert world.events() == ["Normal/JobStarted"]


async def test_a_conflict_is_read_again_and_nothing_is_made_twice() -> None:
    world = World()
    world.api.fail("patch", ApiError(409, "Conflict", "modified"))
    with pytest.raises(ApiError):
        await world.at(1)
    await world.at(1, 1)
    assert world.names == [name_of(1)]
    assert world.status["lastScheduleTime"] == "2026-11-20T04:01:00Z"


def test_names_and_views() -> None:
    job = ScheduledJob.from_object(make_job(name_of(1), "Failed"))
    assert (job.finished, job.failed, job.complete, job.schedule_uid) == (True, True, False, UID)
    assert [run_of(name) for name in ("nightly", "nightly-", "n-12345678901", "n-x1")] == [None] * 4
    assert len(f"{'s' * 31}-{int(minute(0).timestamp()) // 60}") == 40


def test_an_older_schedule_is_not_taken() -> None:
    world = World()
    view = world.view.schedule(UID)
    assert view is not None
    older = ScheduleView(**{**vars(view), "resource_version": "6"})
    assert not world.view.put_schedule(older)
    assert world.view.schedule(UID) == view


@pytest.mark.parametrize("levels", [28, 29, 60])
async def test_a_job_s_nested_parameters_are_as_the_schedule_says_or_the_job_is_refused(
    levels: int,
) -> None:
    nested: list[Any] = []
    for _ in range(levels - 1):
        nested = [nested]
    template = copy.deepcopy(make_schedule()["spec"]["jobTemplate"])
    template["spec"].setdefault("stack", {})["parameters"] = {"/x": nested}
    world = World(jobTemplate=template)
    await world.at(1)
    (job,) = world.api.jobs.values()
    whole = job["spec"]["stack"]["parameters"] == {"/x": nested}
    assert whole or is_deep(job["spec"])
    assert is_deep(job["spec"]) == (levels > 28)


async def test_of_large_schedules_one_is_started_at_a_time() -> None:
    world = World()
    schedule = replace(ScheduleView.from_object(make_schedule()), large=True)
    decision = await world.reconciler._decided(schedule, minute(1))
    create_job, at_once, most = world.api.create_job, 0, 0

    async def counted(manifest: dict[str, Any]) -> dict[str, Any]:
        nonlocal at_once, most
        at_once += 1
        most = max(most, at_once)
        await asyncio.sleep(0)
        at_once -= 1
        return await create_job(manifest)

    world.api.create_job = counted  # type: ignore[method-assign]
    runs = [replace(decision, run=minute(n)) for n in range(1, 5)]
    await asyncio.gather(*(world.reconciler._carried_out(schedule, each) for each in runs))
    assert (most, len(world.names)) == (1, 4)
    small = replace(schedule, large=False)
    runs = [replace(decision, run=minute(n)) for n in range(5, 9)]
    await asyncio.gather(*(world.reconciler._carried_out(small, each) for each in runs))
    assert (most, len(world.names)) == (4, 8)


async def test_a_job_that_is_slow_to_go_keeps_no_other_large_schedule_from_its_start() -> None:
    world = World(concurrencyPolicy="Replace")
    await world.at(1)
    large = replace(ScheduleView.from_object(make_schedule()), large=True)
    replacing = replace(large, spec=large.spec | {"concurrencyPolicy": "Replace"})
    begun, hanging = asyncio.Event(), asyncio.Event()

    async def delete_job(*_: str) -> None:
        begun.set()
        await hanging.wait()

    world.api.delete_job = delete_job  # type: ignore[assignment]
    decision = await world.reconciler._decided(replacing, minute(2))
    slow = asyncio.create_task(world.reconciler._carried_out(replacing, decision))
    other = replace(decision, run=minute(3), replaced=())
    async with asyncio.timeout(PATIENCE):
        await begun.wait()
        await world.reconciler._carried_out(large, other)
    assert world.names == [name_of(1), name_of(3)]
    hanging.set()
    await slow
    assert name_of(2) in world.names


def test_a_large_schedule_of_another_namespace_passes_a_creation_that_is_slow() -> None:
    """One at a time would let a webhook that hangs in one make the runs of all late."""

    async def late() -> float:
        world = World()
        large = replace(ScheduleView.from_object(make_schedule()), large=True)
        decision = await world.reconciler._decided(large, minute(1))
        create_job = world.api.create_job

        async def create(manifest: dict[str, Any]) -> dict[str, Any]:
            await asyncio.sleep(10 if manifest["metadata"]["namespace"] == "lanes" else 0)
            return await create_job(manifest)

        world.api.create_job = create  # type: ignore[method-assign]
        runs = [replace(decision, run=minute(n)) for n in range(1, 4)]
        slow = [asyncio.create_task(world.reconciler._carried_out(large, run)) for run in runs]
        await asyncio.sleep(0)
        other = replace(large, namespace="drives", name="hourly", uid="uid-of-hourly")
        await world.reconciler._carried_out(other, decision)
        at = asyncio.get_running_loop().time()
        await asyncio.gather(*slow)
        assert asyncio.get_running_loop().time() == 30
        return at

    assert virtual_time.run(late()) == 1


async def test_a_run_that_passed_is_known_though_its_job_was_removed_at_once() -> None:
    """As by ttlAfterFinished: 0s, or as the history's limit does."""
    world = World(successfulJobsHistoryLimit=0)
    await world.at(1)
    ended = make_job(name_of(1), "Complete")
    ended["status"]["conditions"].append({"type": "Passed", "status": "True"})
    ended["status"]["results"] = "pvc://results/1"
    job = ScheduledJob.from_object(ended)
    world.view.put_job(job)
    world.view.drop_job(job)
    del world.api.jobs[name_of(1)]
    await world.at(2)
    assert world.status["lastPassed"] == {
        "job": name_of(1), "results": "pvc://results/1", "scheduleTime": "2026-11-20T04:01:00Z",
    }  # fmt: skip
    await world.at(2, seconds=5)
    world.end(name_of(2), "Complete")  # without the condition Passed
    world.restart()
    await world.at(2, seconds=9)
    assert name_of(2) not in world.names
    assert world.status["lastPassed"]["job"] == name_of(1)
