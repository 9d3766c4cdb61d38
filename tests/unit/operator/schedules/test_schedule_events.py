"""Each Event of a schedule is written once, whatever the API server answers, and delays no run."""

from datetime import timedelta

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from tests.unit.operator.schedules.world import World, minute, name_of


@pytest.mark.parametrize("status", [0, 429, 500, 503])
async def test_an_event_that_is_not_taken_is_written_later_and_holds_no_run_up(status: int) -> None:
    world = World()
    world.api.fail("event", *[ApiError(status, "", "not now")] * 3)
    await world.at(1)
    assert (world.names, world.events()) == ([name_of(1)], [])
    world.clock = minute(1) + timedelta(seconds=1)
    assert world.alarms.ring() == 1
    await world.at(1, 1)
    await world.at(2)
    assert (world.names, world.events()) == ([name_of(1), name_of(2)], [])
    await world.at(2, 30)
    assert world.events() == ["Normal/JobStarted"] * 2
    messages = [event["message"] for event in world.api.written_events]
    assert messages == sorted(messages)
    world.clock = minute(3) - timedelta(seconds=1)
    assert world.alarms.ring() == 0


async def test_an_event_whose_answer_was_lost_is_not_written_twice() -> None:
    world = World()
    world.api.lost["event"] = ApiError(0, "Unreachable", "no answer")
    await world.at(1)
    await world.at(1, 30)
    await world.at(2)
    assert world.events() == ["Normal/JobStarted"] * 2
    assert world.api.calls.count("event") == 3


@pytest.mark.parametrize("watch_is_behind", [False, True])
async def test_a_status_whose_answer_was_lost_is_reported_all_the_same(
    watch_is_behind: bool,
) -> None:
    """The write has happened, and nothing is left to be written at the next visit."""
    world = World()
    world.api.lost["patch"] = ApiError(0, "Unreachable", "no answer")
    with pytest.raises(ApiError, match="no answer"):
        await world.at(1)
    if not watch_is_behind:
        world.deliver()
    for seconds in (1, 2):
        await world.at(1, seconds)
    assert (world.names, world.events()) == ([name_of(1)], ["Normal/JobStarted"])


async def test_a_status_that_arrives_late_is_reported_all_the_same() -> None:
    """The API server has given up its answer, and writes it after it was asked whether it had."""
    world = World()
    write, late = world.api.patch_schedule_status, list[Json]()

    async def slow(namespace: str, name: str, patch: Json) -> Json:
        if not late:
            late.append(patch)
            raise ApiError(0, "Unreachable", "no answer")
        if len(late) == 1:
            late.append(await write(namespace, name, late[0]))
        return await write(namespace, name, patch)

    world.api.patch_schedule_status = slow  # type: ignore[method-assign]
    for seconds, text in ((0, "no answer"), (1, "has been modified")):
        with pytest.raises(ApiError, match=text):
            await world.at(1, seconds)
    for seconds in (2, 3):
        await world.at(1, seconds)
    assert (world.names, world.events()) == ([name_of(1)], ["Normal/JobStarted"])


@pytest.mark.parametrize("policy", ["Allow", "Forbid"])
async def test_a_start_is_reported_also_when_another_run_is_due_before_it_is_written(
    policy: str,
) -> None:
    world = World(concurrencyPolicy=policy)
    world.api.fail("patch", ApiError(0, "Unreachable", "no"))
    with pytest.raises(ApiError, match="Unreachable"):
        await world.at(1)
    for seconds in (1, 2):
        await world.at(2, seconds)
    then = "JobStarted" if policy == "Allow" else "JobActive"
    assert world.events() == ["Normal/JobStarted", f"Normal/{then}"]
    assert world.api.written_events[0]["message"].startswith(f"{name_of(1)} was started")


async def test_a_missed_run_that_is_started_by_a_longer_deadline_is_reported_twice() -> None:
    """Of both the reason is MissedStart, since a run before it was missed."""
    world = World(schedule="*/2 * * * *", startingDeadline="20s")
    await world.at(4, 30)
    assert world.events() == ["Warning/MissedStart"]
    world.change(startingDeadline="60s")
    await world.at(4, 40)
    assert (world.names, world.events()) == ([name_of(4)], ["Warning/MissedStart"] * 2)
    assert world.api.written_events[1]["message"].startswith(f"{name_of(4)} was started")


async def test_a_write_that_did_not_happen_is_reported_once_when_it_has() -> None:
    world = World(suspend=True)
    world.api.fail("patch", ApiError(0, "Unreachable", "no answer"))
    with pytest.raises(ApiError, match="no answer"):
        await world.at(1)
    for seconds in (1, 2):
        await world.at(1, seconds)
    assert world.events() == ["Normal/SuspendedBySpec"]


async def test_an_event_that_is_refused_is_let_go() -> None:
    world = World()
    world.api.fail("event", ApiError(403, "Forbidden", "no"))
    await world.at(1)
    await world.at(1, 30)
    assert world.events() == []
    assert world.api.calls.count("event") == 1


async def test_each_suspension_has_an_event_of_its_own() -> None:
    world = World(schedule="0 * * * *")
    for number, suspend in enumerate([False, True, False, True]):
        world.change(suspend=suspend)
        await world.at(5, number)
    assert world.events() == [
        "Normal/SuspendedBySpec",
        "Normal/NotSuspended",
        "Normal/SuspendedBySpec",
    ]
