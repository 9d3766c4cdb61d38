"""Events that wait for the API server: which are tried again, how many are kept, and of what."""

import logging

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.event_backlog import EventBacklog
from bagpipe_operator.cluster.events import NORMAL, Note
from tests.unit.operator.builders import make_job
from tests.unit.operator.fakes import FakeApi
from tests.unit.operator.world import UID

JOB = make_job("x").view()


def notes(*reasons: str) -> list[Note]:
    return [Note(NORMAL, reason, "text") for reason in reasons]


def manifest(note: Note) -> Json:
    return {"metadata": {"name": note.reason}, "reason": note.reason}


async def written(backlog: EventBacklog, api: FakeApi) -> list[str]:
    await backlog.write(JOB, manifest)
    return api.event_reasons()


async def test_what_is_kept_is_written_once_and_in_its_order() -> None:
    api = FakeApi()
    backlog = EventBacklog(api)
    backlog.add(UID, notes("One", "Two"))
    backlog.add(UID, notes("Three"))
    assert await written(backlog, api) == ["One", "Two", "Three"]
    await written(backlog, api)
    assert len(api.calls) == 3


async def test_the_last_twenty_events_that_could_not_be_written_are_kept() -> None:
    api = FakeApi()
    backlog = EventBacklog(api)
    for number in range(25):
        backlog.add(UID, notes(f"Reason{number}"))
    assert await written(backlog, api) == [f"Reason{number}" for number in range(5, 25)]


@pytest.mark.parametrize("status", [0, 401, 409, 429, 500, 502, 503, 504])
async def test_a_fault_that_may_pass_loses_no_event(status: int) -> None:
    api = FakeApi()
    backlog = EventBacklog(api)
    backlog.add(UID, notes("One", "Two"))
    api.fail("create events", ApiError(status, "", "not now"))
    with pytest.raises(ApiError, match="not now"):
        await written(backlog, api)
    assert await written(backlog, api) == ["One", "Two"]


@pytest.mark.parametrize("status", [400, 403, 404, 422])
async def test_an_event_that_is_refused_holds_up_none_after_it_and_is_logged(
    status: int, caplog: pytest.LogCaptureFixture
) -> None:
    api = FakeApi()
    backlog = EventBacklog(api)
    backlog.add(UID, notes("One", "Two"))
    api.fail("create events", ApiError(status, "", "never"))
    with caplog.at_level(logging.WARNING):
        assert await written(backlog, api) == ["Two"]
    (record,) = caplog.records
    assert "lanes/x: the event One was not written" in record.getMessage()


async def test_an_event_that_was_written_before_is_no_fault(
    caplog: pytest.LogCaptureFixture,
) -> None:
    api = FakeApi()
    backlog = EventBacklog(api)
    api.put("events", manifest(notes("One")[0]))
    backlog.add(UID, notes("One", "Two"))
    with caplog.at_level(logging.WARNING):
        assert await written(backlog, api) == ["One", "Two"]
    assert caplog.records == []


async def test_nothing_is_written_for_objects_that_are_gone() -> None:
    api = FakeApi()
    backlog = EventBacklog(api)
    backlog.add(UID, notes("One"))
    backlog.keep_only([UID, "another"])
    assert await written(backlog, api) == ["One"]
    backlog.add(UID, notes("Two"))
    backlog.keep_only(["another"])
    assert await written(backlog, api) == ["One"]
