"""How many writes the fence lets through at once. Whether it lets any: test_election.py."""

# ruff: noqa: ARG002 - the fake has the real signatures

import asyncio
from dataclasses import dataclass, field

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.fence import (
    PROGRESS_AT_ONCE,
    WRITES_AT_ONCE,
    Fence,
    FencedApi,
    NotLeadingError,
)
from tests.unit.operator.fakes import FakeApi
from tests.waiting import PATIENCE


@dataclass
class HeldApi(FakeApi):
    """Answers a write only when the test says so."""

    under_way: int = 0
    most: int = 0
    answers: asyncio.Event = field(default_factory=asyncio.Event)

    async def patch_status(
        self, namespace: str, name: str, patch: Json, urgent: bool = True
    ) -> Json:
        self.under_way += 1
        self.most = max(self.most, self.under_way)
        await self.answers.wait()
        self.under_way -= 1
        return patch

    async def get(self, resource: str, namespace: str, name: str) -> Json:
        return {"metadata": {"name": name}}


async def begun(fenced: FencedApi, count: int) -> list["asyncio.Task[Json]"]:
    writes = [
        asyncio.create_task(fenced.patch_status("lanes", f"x-{number}", {}))
        for number in range(count)
    ]
    for _ in range(count):
        await asyncio.sleep(0)
    return writes


async def test_a_busy_api_server_is_not_given_more_writes_at_once() -> None:
    api, fence = HeldApi(), Fence()
    fence.open_until(float("inf"))
    fenced = FencedApi(api, fence)
    writes = await begun(fenced, 20)
    assert api.under_way == WRITES_AT_ONCE == 8
    assert await fenced.get("pods", "lanes", "p")  # who reads does not wait for writers
    api.answers.set()
    assert len(await asyncio.gather(*writes)) == 20
    assert (api.under_way, api.most) == (0, 8)


async def test_a_write_that_waits_is_not_made_when_the_lead_is_lost() -> None:
    api, fence = HeldApi(), Fence()
    fence.open_until(float("inf"))
    writes = await begun(FencedApi(api, fence), 10)
    fence.close()
    api.answers.set()
    done = await asyncio.gather(*writes, return_exceptions=True)
    assert [isinstance(answer, NotLeadingError) for answer in done] == [False] * 8 + [True] * 2


async def test_a_write_that_is_cancelled_gives_its_place_back() -> None:
    api, fence = HeldApi(), Fence()
    fence.open_until(float("inf"))
    fenced = FencedApi(api, fence)
    for write in await begun(fenced, 12):
        write.cancel()
        with pytest.raises(asyncio.CancelledError):
            await write
    api.answers.set()
    assert len(await asyncio.gather(*await begun(fenced, 8))) == 8


def test_a_fence_is_open_until_its_moment_and_no_longer() -> None:
    now = 10.0
    fence = Fence(lambda: now)
    assert (fence.leads(), fence.remaining()) == (False, float("-inf"))
    fence.open_until(12.5)
    assert (fence.leads(), fence.remaining()) == (True, 2.5)
    now = 12.25
    assert (fence.leads(), fence.remaining()) == (True, 0.25)
    now = 12.5
    assert (fence.leads(), fence.remaining()) == (False, 0.0)
    now = 13.0
    assert (fence.leads(), fence.remaining()) == (False, -0.5)
    fence.open_until(14.0)
    fence.close()
    assert (fence.leads(), fence.remaining()) == (False, float("-inf"))


@pytest.mark.parametrize(("remaining", "begun_"), [(0.0, 0), (-0.5, 0), (0.5, 1)])
async def test_a_write_is_begun_before_the_end_and_not_at_it(remaining: float, begun_: int) -> None:
    api, fence = HeldApi(), Fence(lambda: 100.0)
    fence.open_until(100.0 + remaining)
    (write,) = await begun(FencedApi(api, fence), 1)
    assert api.under_way == begun_
    api.answers.set()
    (answer,) = await asyncio.gather(write, return_exceptions=True)
    assert isinstance(answer, NotLeadingError) == (not begun_)


def test_who_lost_the_lead_may_try_again_as_after_a_lost_answer() -> None:
    assert (NotLeadingError().status, NotLeadingError().reason) == (0, "NotLeading")


# Promise: two-turns-free-of-progress
async def test_progress_leaves_turns_to_what_is_urgent_and_gets_its_own() -> None:
    """However much progress is to be written, and however slowly: two turns are free of it."""
    api, fence = HeldApi(), Fence()
    fence.open_until(float("inf"))
    fenced = FencedApi(api, fence)

    async def write(urgent: bool) -> Json:
        return await fenced.patch_status("lanes", "x", {"urgent": urgent}, urgent)

    progress = [asyncio.create_task(write(False)) for _ in range(40)]
    for _ in range(40):
        await asyncio.sleep(0)
    assert api.under_way == PROGRESS_AT_ONCE == 6
    urgent = [asyncio.create_task(write(True)) for _ in range(30)]
    for _ in range(30):
        await asyncio.sleep(0)
    assert api.under_way == WRITES_AT_ONCE
    api.answers.set()
    answered: list[Json] = [await each for each in asyncio.as_completed([*progress, *urgent])]
    assert len(answered) == 70
    # Of the forty that were there before no more than those with a turn come first.
    last_urgent = max(n for n, each in enumerate(answered) if each["urgent"])
    assert last_urgent < len(urgent) + 2 * PROGRESS_AT_ONCE


@pytest.mark.parametrize("urgent", [True, False])
async def test_slow_writes_of_one_namespace_leave_turns_to_others(urgent: bool) -> None:
    """As where a webhook hangs for all that is created in it."""
    fence, hangs = Fence(), asyncio.Event()

    class Slow(FakeApi):
        async def create(self, resource: str, manifest: Json) -> Json:
            await hangs.wait()
            return manifest

        async def patch_status(
            self, namespace: str, name: str, patch: Json, urgent: bool = True
        ) -> Json:
            if namespace == "slow":
                await hangs.wait()
            return patch

    fence.open_until(float("inf"))
    fenced = FencedApi(Slow(), fence)
    pod = {"metadata": {"namespace": "slow"}}
    slow = [asyncio.create_task(fenced.create("pods", pod)) for _ in range(40)]
    slow += [asyncio.create_task(fenced.patch_status("slow", "x", {}, urgent)) for _ in range(40)]
    await asyncio.sleep(0)
    others = [fenced.patch_status(f"lanes-{number}", "x", {}, urgent) for number in range(20)]
    async with asyncio.timeout(PATIENCE):
        assert await asyncio.gather(*others) == [{}] * 20
    hangs.set()
    await asyncio.gather(*slow)
