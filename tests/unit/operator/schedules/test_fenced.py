"""Without leadership no write of a schedule reaches the API server; with it all do."""

from collections.abc import Awaitable, Callable

import pytest

from bagpipe_operator.cluster.fence import Fence, NotLeadingError
from bagpipe_operator.schedules.fenced import FencedScheduleApi
from tests.unit.operator.schedules.world import FakeApi, make_job, make_schedule, name_of

JOB = make_job(name_of(1))
PATCH = {"metadata": {"resourceVersion": "7"}, "status": {"activeCount": 0}}
WRITES: dict[str, Callable[[FencedScheduleApi], Awaitable[object]]] = {
    "create": lambda api: api.create_job(JOB),
    "delete": lambda api: api.delete_job("lanes", name_of(1), f"uid-of-{name_of(1)}"),
    "patch": lambda api: api.patch_schedule_status("lanes", "nightly", PATCH),
    "event": lambda api: api.create("events", {"metadata": {"namespace": "lanes"}}),
}


@pytest.mark.parametrize("write", WRITES)
async def test_a_write_needs_leadership(write: str) -> None:
    fake, fence = FakeApi(make_schedule()), Fence(lambda: 100.0)
    api = FencedScheduleApi(fake, fence)  # type: ignore[arg-type]
    with pytest.raises(NotLeadingError):
        await WRITES[write](api)
    assert fake.calls == []
    fence.open_until(110.0)
    await WRITES[write](api)
    assert [call.split()[0] for call in fake.calls] == [write]


async def test_reading_needs_none() -> None:
    fake = FakeApi(make_schedule())
    api = FencedScheduleApi(fake, Fence(lambda: 100.0))  # type: ignore[arg-type]
    assert await api.list_jobs("lanes", "a=b") == []
    assert (await api.get_schedule("lanes", "nightly"))["metadata"]["name"] == "nightly"
