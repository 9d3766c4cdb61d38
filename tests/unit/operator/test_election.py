"""The election against a fake Lease, with faults on order and clocks that the test moves.

A fake API server, since a real one can't lose a renewal when it is asked to;
tests/integration/control_plane runs whole operators against a real one.
"""

import asyncio
import copy
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.election import RETRY_SECONDS, Election, new_identity
from bagpipe_operator.cluster.fence import Fence, FencedApi, NotLeadingError
from bagpipe_operator.cluster.lease import Terms
from tests.unit.operator.fakes import FakeApi

DOWN = ApiError(0, "Unreachable", "connection refused")


@dataclass
class FakeLeases:
    """One Lease, with versions and 409s as the API server has them."""

    lease: Json | None = None
    version: int = 10
    faults: list[ApiError] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)
    hangs: bool = False
    lose_answers: int = 0
    before_replace: Callable[[], Awaitable[None]] | None = None

    async def get_lease(self, namespace: str, name: str) -> Json:
        await self._called(f"get {namespace}/{name}")
        if self.lease is None:
            raise ApiError(404, "NotFound", "no lease")
        return copy.deepcopy(self.lease)

    async def create_lease(self, manifest: Json) -> Json:
        await self._called("create")
        if self.lease is not None:
            raise ApiError(409, "AlreadyExists", "it exists")
        return self._write(manifest)

    async def replace_lease(self, manifest: Json) -> Json:
        await self._called("replace")
        before, self.before_replace = self.before_replace, None
        if before is not None:
            await before()
        if self.lease is None:
            raise ApiError(404, "NotFound", "no lease")
        if manifest["metadata"]["resourceVersion"] != self.lease["metadata"]["resourceVersion"]:
            raise ApiError(409, "Conflict", "it was modified")
        return self._write(manifest)

    def _write(self, manifest: Json) -> Json:
        self.version += 1
        self.lease = copy.deepcopy(manifest)
        self.lease["metadata"]["resourceVersion"] = str(self.version)
        if self.lose_answers:
            self.lose_answers -= 1
            raise DOWN
        return copy.deepcopy(self.lease)

    async def _called(self, call: str) -> None:
        self.calls.append(call)
        if self.hangs:
            await asyncio.Event().wait()
        if self.faults:
            raise self.faults.pop(0)


class Candidate:
    """One replica with a clock of its own, which another's need not agree with."""

    def __init__(self, api: FakeLeases, identity: str, started_at: float = 0.0) -> None:
        self.seconds = started_at
        self.led = 0
        self.fence = Fence(lambda: self.seconds)
        self.election = Election(
            api, self.fence, Terms(identity, 9), "system", "bagpipe", self._lead,
            clock=lambda: self.seconds, timestamp=lambda: "2026-11-20T04:00:00.000000Z",
        )  # fmt: skip

    def _lead(self) -> None:
        self.led += 1

    async def step(self, after: float = 0.0) -> float:
        self.seconds += after
        return await self.election.step()


@pytest.fixture
def api() -> FakeLeases:
    return FakeLeases()


def holder(api: FakeLeases) -> str:
    assert api.lease is not None
    return str(api.lease["spec"]["holderIdentity"])


@pytest.mark.looptime
async def test_a_candidate_campaigns_until_it_is_cancelled(api: FakeLeases) -> None:
    clock = asyncio.get_running_loop().time
    fence = Fence(clock)
    terms = Terms("a", 9)
    a = Election(api, fence, terms, "system", "bagpipe", lambda: None, clock=clock)
    campaign = asyncio.create_task(a.run())
    await asyncio.sleep(4.0)
    campaign.cancel()
    await asyncio.sleep(4.0)
    assert api.calls == ["get system/bagpipe", "create", "replace", "replace"]


async def test_the_first_leads_and_the_second_waits(
    api: FakeLeases, caplog: pytest.LogCaptureFixture
) -> None:
    a, b = Candidate(api, "a"), Candidate(api, "b", started_at=5000.0)
    with caplog.at_level(logging.WARNING):
        assert await a.step() == 1.8
        assert await b.step() == 1.8
    assert caplog.records == []  # who never led does not say that it leads no more
    assert (a.fence.leads(), b.fence.leads(), b.election.leader) == (True, False, "a")
    assert (a.led, b.led, holder(api)) == (1, 0, "a")


async def test_a_renewal_is_one_call_and_no_new_lead(api: FakeLeases) -> None:
    a = Candidate(api, "a")
    await a.step()
    api.calls.clear()
    for _ in range(5):
        await a.step(after=1.8)
    assert api.calls == ["replace"] * 5
    assert (a.led, a.fence.remaining()) == (1, 6.0)


async def test_a_dead_leader_is_followed_after_the_duration(api: FakeLeases) -> None:
    a, b = Candidate(api, "a"), Candidate(api, "b", started_at=5000.0)
    await a.step()
    waited, pauses = 0.0, []
    pause = await b.step()
    while not b.fence.leads():
        pauses.append(pause)
        waited += pause
        pause = await b.step(after=pause)
    assert waited == pytest.approx(9.0)
    assert pauses == pytest.approx([1.8] * 5)
    assert (b.led, holder(api)) == (1, "b")
    assert api.lease is not None
    assert api.lease["spec"]["leaseTransitions"] == 1


@pytest.mark.parametrize("rate", [0.9, 1.0, 1.2])
async def test_never_two_at_once_whatever_the_leader_meets(api: FakeLeases, rate: float) -> None:
    """The leader's clock may be slower or faster by a fifth; every renewal is lost."""
    a, b = Candidate(api, "a"), Candidate(api, "b", started_at=-300.0)
    await a.step()
    await b.step()
    gap = 0
    for _ in range(200):
        api.faults = [DOWN]
        await a.step(after=0.1 * rate)
        api.faults = []
        await b.step(after=0.1)
        assert not (a.fence.leads() and b.fence.leads())
        gap += not a.fence.leads() and not b.fence.leads()
        if b.fence.leads():
            break
    assert b.fence.leads()
    assert gap >= 20  # two seconds and more for what the old one still had under way


async def test_a_lost_renewal_or_two_are_tolerated(
    api: FakeLeases, caplog: pytest.LogCaptureFixture
) -> None:
    a = Candidate(api, "a")
    await a.step()
    api.faults = [DOWN, DOWN]
    with caplog.at_level(logging.WARNING):
        assert await a.step(after=1.8) == 0.3
        assert caplog.text.count("connection refused") == 1
        assert await a.step(after=0.3) == 0.3
    assert a.fence.leads()
    assert caplog.text.count("connection refused") == 1  # logged once
    assert await a.step(after=RETRY_SECONDS) == 1.8
    assert (a.led, a.fence.remaining()) == (1, 6.0)


async def test_a_renewal_whose_answer_was_lost_is_found_and_renewed(api: FakeLeases) -> None:
    a = Candidate(api, "a")
    await a.step()
    api.lose_answers = 1
    await a.step(after=1.8)
    assert a.fence.remaining() == pytest.approx(4.2)  # not counted: it is not known when it arrived
    await a.step(after=RETRY_SECONDS)
    assert a.fence.remaining() == 6.0
    assert a.led == 1


async def test_the_fence_falls_by_time_alone_and_a_new_lead_is_reported(api: FakeLeases) -> None:
    a = Candidate(api, "a")
    await a.step()
    a.seconds += 6.0
    assert not a.fence.leads()
    await a.step()  # nobody took it
    assert (a.fence.leads(), a.led) == (True, 2)


async def test_a_paused_leader_finds_another_and_steps_back(
    api: FakeLeases, caplog: pytest.LogCaptureFixture
) -> None:
    a, b = Candidate(api, "a"), Candidate(api, "b")
    await a.step()
    await b.step()
    await b.step(after=9.0)
    assert holder(api) == "b"
    assert await a.step() == RETRY_SECONDS  # its clock stood still: 409
    with caplog.at_level(logging.WARNING):
        await a.step()
        await a.step()
    assert (a.fence.leads(), a.election.leader, a.led) == (False, "b", 1)
    assert caplog.text.count("does not lead any more; the Lease is b's") == 1  # logged once


@pytest.mark.parametrize("status", [409, 500, 403])
async def test_whoever_loses_the_race_waits(api: FakeLeases, status: int) -> None:
    a, b = Candidate(api, "a"), Candidate(api, "b")
    await a.step()
    await a.election.release()
    api.calls.clear()

    async def overtaken() -> None:
        await a.step()
        raise ApiError(status, "", "no")

    api.before_replace = overtaken
    assert await b.step() == RETRY_SECONDS
    assert await b.step() == 1.8
    assert (b.fence.leads(), b.election.leader, holder(api)) == (False, "a", "a")


@pytest.mark.looptime
async def test_a_call_that_hangs_is_given_up() -> None:
    api = FakeLeases(hangs=True)
    a = Election(api, Fence(), Terms("a", 3), "system", "bagpipe", lambda: None)
    began = asyncio.get_running_loop().time()
    assert await a.step() == RETRY_SECONDS
    assert asyncio.get_running_loop().time() - began == pytest.approx(0.6)


async def test_given_back_is_taken_at_the_next_look(api: FakeLeases) -> None:
    a, b = Candidate(api, "a"), Candidate(api, "b")
    await a.step()
    await b.step()
    await a.election.release()
    assert (a.fence.leads(), holder(api)) == (False, "")
    await b.step(after=1.8)
    assert (b.fence.leads(), holder(api)) == (True, "b")


async def test_what_is_another_s_is_not_given_back(api: FakeLeases) -> None:
    a, b = Candidate(api, "a"), Candidate(api, "b")
    await a.step()
    await b.step()
    await b.step(after=9.0)
    await a.election.release()
    await b.election.release()
    await b.election.release()
    assert [call for call in api.calls if call == "replace"] == ["replace"] * 3
    assert holder(api) == ""


async def test_a_deleted_lease_is_made_again_when_its_holder_has_stopped(api: FakeLeases) -> None:
    a, b = Candidate(api, "a"), Candidate(api, "b")
    await a.step()
    await b.step()
    api.lease = None
    assert await b.step(after=1.0) == 1.8
    assert await a.step(after=1.0) == RETRY_SECONDS
    assert await a.step() == 1.8
    assert not a.fence.leads()
    await b.step(after=8.0)
    assert (b.fence.leads(), holder(api)) == (True, "b")


async def test_a_replica_without_rights_says_so(api: FakeLeases) -> None:
    a = Candidate(api, "a")
    assert a.election.trouble() == "the Lease system/bagpipe can't be used: not yet"
    api.faults = [ApiError(403, "Forbidden", "no right")]
    await a.step()
    assert a.election.trouble().endswith("can't be used: 403 Forbidden: no right")
    await a.step()
    assert a.election.trouble() == ""
    a.seconds += 26.9
    assert a.election.trouble() == ""
    a.seconds += 0.1
    assert a.election.trouble() != ""


async def test_a_lost_race_is_no_fault_to_warn_of(
    api: FakeLeases, caplog: pytest.LogCaptureFixture
) -> None:
    a = Candidate(api, "a")
    await a.step()
    api.faults = [ApiError(409, "Conflict", "it was modified")]
    with caplog.at_level(logging.WARNING):
        await a.step(after=1.8)
    assert caplog.records == []


async def test_a_renewal_that_took_longer_than_it_lets_work_is_no_lead(api: FakeLeases) -> None:
    a, b = Candidate(api, "a"), Candidate(api, "b")
    await b.step()
    await b.election.release()

    async def slow() -> None:
        a.seconds += 6.0

    api.before_replace = slow
    await a.step()
    assert (a.fence.leads(), a.led) == (False, 0)
    await a.step()
    assert (a.fence.leads(), a.led) == (True, 1)


async def test_a_lease_that_nobody_understands_leaves_no_replica_deaf(api: FakeLeases) -> None:
    a = Candidate(api, "a")
    api.lease = {"metadata": {}}
    assert await a.step() == 1.8
    assert a.election.trouble() != ""
    api.lease = None
    await a.step()
    assert (a.fence.leads(), a.election.trouble()) == (True, "")


async def test_a_lease_that_can_t_be_given_back_runs_out_by_itself(api: FakeLeases) -> None:
    a, b = Candidate(api, "a"), Candidate(api, "b")
    await a.step()
    await b.step()
    api.faults = [DOWN]
    await a.election.release()
    assert (a.fence.leads(), holder(api)) == (False, "a")
    await b.step(after=9.0)
    assert (b.fence.leads(), holder(api)) == (True, "b")


def test_no_two_candidates_have_one_name() -> None:
    assert len({new_identity() for _ in range(100)}) == 100


async def test_nothing_is_written_behind_the_fence() -> None:
    seconds = 0.0
    fence, api = Fence(lambda: seconds), FakeApi()
    fenced = FencedApi(api, fence)
    pod: Json = {"metadata": {"name": "p", "namespace": "lanes"}}
    for write in (
        lambda: fenced.create("pods", pod),
        lambda: fenced.delete_pod("lanes", "p", "u"),
        lambda: fenced.patch_status("lanes", "x", {}),
    ):
        with pytest.raises(NotLeadingError, match="does not lead any more"):
            await write()
    assert api.calls == []
    fence.open_until(5.0)
    await fenced.create("pods", pod)
    assert (await fenced.get("pods", "lanes", "p"))["metadata"]["name"] == "p"
    seconds = 5.0
    with pytest.raises(NotLeadingError):
        await fenced.delete_pod("lanes", "p", "uid-of-p")
    assert api.calls == ["create pods", "get pods"]


@pytest.mark.looptime
async def test_a_write_that_hangs_ends_with_the_lead() -> None:
    class Hanging(FakeApi):
        async def get_job(self, namespace: str, name: str) -> Json:
            await asyncio.Event().wait()
            return await super().get_job(namespace, name)

        async def delete_pod(
            self, namespace: str, name: str, uid: str, _grace_seconds: int | None = None
        ) -> bool:
            return bool(await self.get_job(namespace, f"{name} {uid}"))

    clock = asyncio.get_running_loop().time
    fence = Fence(clock)
    fence.open_until(clock() + 0.2)
    with pytest.raises(NotLeadingError):
        await FencedApi(Hanging(), fence).delete_pod("lanes", "p", "u")
    assert fence.remaining() == pytest.approx(0, abs=0.001)
