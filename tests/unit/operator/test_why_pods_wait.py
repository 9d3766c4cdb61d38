"""What Lookout asks for one job's pods, when, and what it reports until it asks again."""

import asyncio
from typing import Any

import pytest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.large_objects import LARGE, SIZE, trimmed
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.troubles.lookout import Lookout
from bagpipe_operator.settings import Settings
from tests.unit.operator import virtual_time
from tests.unit.operator.builders import Clock, PodBuilder, make_driver, make_executor, make_job
from tests.unit.operator.fakes import FakeApi
from tests.unit.operator.world import UID

MOUNT = {
    "metadata": {},
    "reason": "FailedMount",
    "message": "mount failed: exit status 32",
    "lastTimestamp": "2026-11-20T04:00:00Z",
}
QUOTA = ApiError(403, "Forbidden", 'pods "x" is forbidden: exceeded quota: small')
RESTRICTED = ApiError(403, "Forbidden", 'pods "x" is forbidden: violates PodSecurity "restricted"')


class Lookouts:
    """One job, whose pods are looked at when the test says so."""

    def __init__(self, job: JobView | None = None) -> None:
        self.api, self.clock = FakeApi(), Clock()
        self.job = job or make_job("x").view()
        self.lookout = Lookout(self.api, Settings(), self.clock.monotonic)

    async def found(
        self, *pods: PodBuilder, after: float = 0.0, cases_left: int | None = None
    ) -> list[tuple[str, bool]]:
        """Reasons of what is reported, and whether each lasts."""
        self.clock.advance(after)
        reported = await self.lookout.look(self.job, 1, [pod.view() for pod in pods], cases_left)
        return [(trouble.reason, trouble.lasting) for trouble in reported]


def placed(pod: PodBuilder) -> PodBuilder:
    pod.node = "worker-1"
    return pod


def with_claims(*claims: str) -> PodBuilder:
    pod = make_driver("x")
    pod.claims = claims
    return pod


MOUNTS = [("VolumeNotMounted", False)]


async def test_a_pod_is_asked_about_once_it_has_waited_for_two_seconds() -> None:
    world, pod = Lookouts(), placed(make_driver("x"))
    world.api.events_about["uid-of-x-1-driver"] = [MOUNT]
    assert await world.found(pod) == []
    assert await world.found(pod, after=1.5) == []
    assert world.api.calls == []
    assert await world.found(pod, after=0.5) == MOUNTS


async def test_what_was_found_is_reported_for_four_seconds_and_asked_for_again() -> None:
    world, pod = Lookouts(), placed(make_driver("x"))
    world.api.events_about["uid-of-x-1-driver"] = [MOUNT]
    await world.found(pod)
    await world.found(pod, after=10)
    world.api.events_about.clear()
    assert await world.found(pod, after=3.5) == MOUNTS
    assert len(world.api.calls) == 1
    assert await world.found(pod, after=0.5) == []
    assert await world.found(pod, after=5) == []
    assert len(world.api.calls) == 3


@pytest.mark.parametrize("over", [True, False])
async def test_what_was_found_is_forgotten_with_the_wait(over: bool) -> None:
    world, pod = Lookouts(), placed(make_driver("x"))
    world.api.events_about["uid-of-x-1-driver"] = [MOUNT]
    await world.found(pod)
    assert await world.found(pod, after=2) == MOUNTS
    if over:
        world.lookout.forget(UID)
    else:
        assert await world.found(make_driver("x").running(), after=0.5) == []
    assert await world.found(pod, after=0.5) == []
    world.api.events_about.clear()
    assert await world.found(pod, after=2) == []
    assert len(world.api.calls) == 2


async def test_of_five_pods_that_wait_the_first_three_are_asked_about() -> None:
    world = Lookouts()
    pods = [placed(make_executor("x", number)) for number in range(1, 6)]
    await world.found(*pods)
    await world.found(*pods, after=2)
    assert world.api.calls == [f"events of uid-of-x-1-exec-{number}" for number in (1, 2, 3)]


async def test_of_many_claims_the_first_twenty_are_asked_about() -> None:
    world = Lookouts()
    pod = with_claims(*[f"claim-{number}" for number in range(30)])
    await world.found(pod)
    assert await world.found(pod, after=2) == [("VolumeMissing", True)] * 20


async def test_claims_that_are_not_bound_are_reported() -> None:
    world = Lookouts()
    pod = with_claims("bound", "unbound", "missing")
    for name, phase in (("bound", "Bound"), ("unbound", "Pending")):
        claim = {"metadata": {"name": name, "uid": f"uid-of-{name}"}, "status": {"phase": phase}}
        world.api.put("persistentvolumeclaims", claim)
    await world.found(pod)
    reported = [("VolumePending", False), ("VolumeMissing", True)]
    assert await world.found(pod, after=2) == reported
    assert "events of uid-of-bound" not in world.api.calls
    assert "events of uid-of-unbound" in world.api.calls


async def test_a_claim_that_can_t_be_read_is_not_reported_as_missing() -> None:
    world, pod = Lookouts(), with_claims("tapes")
    world.api.fail("get persistentvolumeclaims", ApiError(500, "InternalError", "no"))
    await world.found(pod)
    assert await world.found(pod, after=2) == []
    assert await world.found(pod, after=4) == [("VolumeMissing", True)]


async def test_executors_that_do_not_come_are_asked_about_after_four_seconds() -> None:
    world = Lookouts()
    world.api.fail("try pods", QUOTA)
    assert await world.found(cases_left=1) == []
    assert await world.found(cases_left=1, after=3.5) == []
    assert world.api.calls == []
    assert await world.found(cases_left=1, after=0.5) == [("QuotaExceeded", False)]
    assert await world.found(cases_left=1, after=4) == []
    assert world.api.calls == ["try pods"] * 2


@pytest.mark.parametrize(
    ("executors", "pods", "asked"),
    [
        (None, [], 1),
        (None, [make_executor("x").running()], 0),
        (1, [make_executor("x").running(), make_executor("x", 2).running()], 0),
        (2, [make_executor("x").running()], 1),
        (2, [make_executor("x").running(), make_executor("x", 2)], 0),
        (2, [make_executor("x").running(), make_executor("x", 2).ended(1)], 1),
        (2, [make_executor("x").running(), make_executor("x", 2).deleting()], 1),
        (2, [make_executor("x").running(), make_driver("x").running()], 1),
    ],
)
async def test_executors_are_asked_about_where_fewer_live_than_are_wanted(
    executors: int | None, pods: list[PodBuilder], asked: int
) -> None:
    job = make_job("x") if executors is None else make_job("x").with_executors(executors)
    world = Lookouts(job.view())
    for after in (0, 4):
        await world.found(*pods, cases_left=1, after=after)
    assert world.api.calls == ["try pods"] * asked


@pytest.mark.parametrize(
    ("slots", "cases", "alive", "asked"),
    [
        (1, 9, 3, 0),
        (1, 9, 2, 1),
        # Two went for lack of cases, and none is missing.
        (1, 1, 1, 0),
        (1, 2, 1, 1),
        (4, 4, 1, 0),
        (4, 5, 1, 1),
        # The least number is wanted to the end, and of a driver that says nothing of its cases.
        (1, 0, 0, 1),
        (1, 0, 1, 0),
    ],
)
async def test_of_executors_that_come_and_go_as_many_are_wanted_as_have_cases(
    slots: int, cases: int, alive: int, asked: int
) -> None:
    job = make_job("x").with_spec("spark", {"executors": {"min": 1, "max": 3}, "slots": slots})
    pods = [make_executor("x", number + 1).running() for number in range(alive)]
    world = Lookouts(job.view().kept())
    for after in (0, 4):
        await world.found(*pods, cases_left=cases, after=after)
    assert world.api.calls == ["try pods"] * asked


async def test_executors_are_not_asked_about_before_there_are_cases() -> None:
    world = Lookouts()
    for after in (0, 4, 4):
        assert await world.found(after=after) == []
    assert world.api.calls == []


@pytest.mark.parametrize("alone", [True, False])
async def test_a_refusal_of_executors_lasts_where_none_is_there(alone: bool) -> None:
    world = Lookouts(make_job("x").with_executors(2).view())
    world.api.fail("try pods", RESTRICTED)
    pods = [make_driver("x").running()]
    if not alone:
        pods.append(make_executor("x").running())
    await world.found(*pods, cases_left=1)
    reported = await world.found(*pods, cases_left=1, after=4)
    assert reported == [("ExecutorsRefused", alone)]


async def test_a_pod_that_waits_and_executors_that_do_not_come_are_reported_together() -> None:
    world = Lookouts(make_job("x").with_executors(2).view())
    world.api.events_about["uid-of-x-1-exec-1"] = [MOUNT]
    world.api.fail("try pods", QUOTA)
    pod = placed(make_executor("x"))
    await world.found(pod, cases_left=1)
    reported = await world.found(pod, cases_left=1, after=4)
    assert reported == [*MOUNTS, ("QuotaExceeded", False)]


async def test_a_refusal_that_may_pass_is_not_reported() -> None:
    world = Lookouts()
    world.api.fail("try pods", ApiError(500, "InternalError", "etcd has no leader"))
    await world.found(cases_left=1)
    assert await world.found(cases_left=1, after=4) == []


def unusable() -> JobView:
    return make_job("x").with_spec("stack.parameters", {"gain": 1}).view()


def too_large() -> JobView:
    entire: dict[str, Any] = make_job("x").object | {SIZE: LARGE + 1}
    return JobView.from_object(trimmed(entire))


@pytest.mark.parametrize("job", [unusable(), too_large()])
async def test_without_a_spec_that_can_be_read_no_executor_is_tried(job: JobView) -> None:
    world = Lookouts(job)
    world.api.fail("get job", ApiError(500, "InternalError", "no"))
    await world.found(cases_left=1)
    assert await world.found(cases_left=1, after=4) == []
    assert "try pods" not in world.api.calls


def test_a_look_takes_fifteen_seconds_at_most_and_reports_what_it_has_found_by_then() -> None:
    """There may be hundreds of Events about each of sixty claims, and a visit has 60 s in all."""

    async def look() -> None:
        world = Lookouts()
        pods = [placed(make_driver("x")), placed(make_executor("x"))]
        world.api.events_about["uid-of-x-1-driver"] = [MOUNT]
        about, begun = world.api.events_of, asyncio.get_running_loop().time()

        async def slowly(namespace: str, uid: str) -> list[Any]:
            await asyncio.sleep(10)
            return await about(namespace, uid)

        world.api.events_of = slowly  # type: ignore[method-assign]
        await world.found(*pods)
        assert await world.found(*pods, after=10) == MOUNTS
        assert asyncio.get_running_loop().time() - begun == 15
        # And it is not asked for again at once.
        assert await world.found(*pods, after=3) == MOUNTS
        assert asyncio.get_running_loop().time() - begun == 15

    virtual_time.run(look())
