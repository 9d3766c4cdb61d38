"""Events that wait for the API server: which are tried again, how many are kept, and of what."""

import logging

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.events import NORMAL, Note
from bagpipe_operator.cluster.untold import Untold
from tests.unit.operator.builders import make_job
from tests.unit.operator.fakes import FakeApi
from tests.unit.operator.world import UID

JOB = make_job("x").view()


def notes(*reasons: str) -> list[Note]:
    return [Note(NORMAL, reason, "said") for reason in reasons]


def manifest(note: Note) -> Json:
    return {"metadata": {"name": note.reason}, "reason": note.reason}


async def told(untold: Untold, api: FakeApi) -> list[str]:
    await untold.write(JOB, manifest)
    return api.event_reasons()


async def test_what_is_kept_is_told_once_and_in_its_order() -> None:
    api = FakeApi()
    untold = Untold(api)
    untold.add(UID, notes("One", "Two"))
    untold.add(UID, notes("Three"))
    assert await told(untold, api) == ["One", "Two", "Three"]
    await told(untold, api)
    assert len(api.calls) == 3


async def test_of_an_object_that_could_not_be_told_of_for_long_the_last_twenty_are_kept() -> None:
    api = FakeApi()
    untold = Untold(api)
    for number in range(25):
        untold.add(UID, notes(f"Reason{number}"))
    assert await told(untold, api) == [f"Reason{number}" for number in range(5, 25)]


@pytest.mark.parametrize("status", [0, 401, 409, 429, 500, 502, 503, 504])
async def test_a_fault_that_may_pass_loses_no_event(status: int) -> None:
    api = FakeApi()
    untold = Untold(api)
    untold.add(UID, notes("One", "Two"))
    api.fail("create events", ApiError(status, "", "not now"))
    with pytest.raises(ApiError, match="not now"):
        await told(untold, api)
    assert await told(untold, api) == ["One", "Two"]


@pytest.mark.parametrize("status", [400, 403, 404, 422])
async def test_an_event_that_is_refused_holds_up_none_after_it_and_is_logged(
    status: int, caplog: pytest.LogCaptureFixture
) -> None:
    api = FakeApi()
    untold = Untold(api)
    untold.add(UID, notes("One", "Two"))
    api.fail("create events", ApiError(status, "", "never"))
    with caplog.at_level(logging.WARNING):
        assert await told(untold, api) == ["Two"]
    (record,) = caplog.records
    assert "lanes/x: the event One was not written" in record.getMessage()


async def test_an_event_that_was_told_before_is_no_fault(caplog: pytest.LogCaptureFixture) -> None:
    api = FakeApi()
    untold = Untold(api)
    api.put("events", manifest(notes("One")[0]))
    untold.add(UID, notes("One", "Two"))
    with caplog.at_level(logging.WARNING):
        assert await told(untold, api) == ["One", "Two"]
    assert caplog.records == []


async def test_nothing_is_told_of_objects_that_are_gone() -> None:
    api = FakeApi()
    untold = Untold(api)
    untold.add(UID, notes("One"))
    untold.keep_only([UID, "another"])
    assert await told(untold, api) == ["One"]
    untold.add(UID, notes("Two"))
    untold.keep_only(["another"])
    assert await told(untold, api) == ["One"]
