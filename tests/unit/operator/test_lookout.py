"""When the API server is asked why a pod waits, and how seldom."""

import pytest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.large_objects import LARGE, SIZE, trimmed
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import MOST_CLAIMS
from bagpipe_operator.jobs.troubles.lookout import MOST_PODS, Lookout
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import (
    Clock,
    PodBuilder,
    account,
    make_driver,
    make_executor,
    make_job,
)
from tests.unit.operator.fakes import FakeApi
from tests.unit.operator.world import World

MOUNT = {
    "metadata": {},
    "reason": "FailedMount",
    "message": 'MountVolume.SetUp failed for volume "config" : configmap "x-1" not found',
    "lastTimestamp": "2026-11-20T04:00:00Z",
}


def placed(pod: PodBuilder) -> PodBuilder:
    pod.node = "worker-1"
    return pod


async def test_a_volume_that_does_not_mount_is_reported_after_two_seconds() -> None:
    world = World()
    await world.reconcile()
    world.deliver(placed(make_driver("x").waiting("driver", "ContainerCreating")))
    world.api.events_about["uid-of-x-1-driver"] = [MOUNT]
    await world.reconcile()
    assert world.reason("Running") == "False/DriverPending"
    await world.reconcile(after=2)
    assert world.reason("Running") == "False/ConfigMapMissing"
    for _ in range(6):
        await world.reconcile(after=0.5)
    assert world.api.calls.count("events of uid-of-x-1-driver") == 1
    await world.reconcile(after=1)
    assert world.api.calls.count("events of uid-of-x-1-driver") == 2
    world.deliver(make_driver("x").running())
    await world.reconcile(after=1)
    assert world.reason("Running") == "False/Planning"


async def test_a_lasting_one_ends_the_job() -> None:
    world = World()
    await world.reconcile()
    world.deliver(placed(make_driver("x")))
    world.api.events_about["uid-of-x-1-driver"] = [MOUNT]
    for _ in range(17):
        await world.reconcile(after=2)
    assert world.reason("Failed") == "True/ConfigMapMissing"


async def test_a_claim_that_is_not_bound() -> None:
    world = World()
    await world.reconcile()
    pod = make_driver("x")
    pod.claims = ("recordings",)
    world.deliver(pod)
    claim = {"metadata": {"name": "recordings", "uid": "claim"}, "status": {"phase": "Pending"}}
    world.api.put("persistentvolumeclaims", claim)
    world.api.events_about["claim"] = [MOUNT | {"message": 'storageclass "fast" not found'}]
    await world.reconcile()
    await world.reconcile(after=2)
    assert world.reason("Running") == "False/VolumePending"
    assert 'storageclass "fast" not found' in world.message("Running")


async def test_a_question_that_fails_harms_nothing() -> None:
    world = World()
    await world.reconcile()
    world.deliver(placed(make_driver("x")))
    await world.reconcile()
    world.api.fail("events of uid-of-x-1-driver", ApiError(500, "InternalError", "no"))
    await world.reconcile(after=2)
    assert world.reason("Running") == "False/DriverPending"


async def test_many_pods_are_not_all_asked_about() -> None:
    world = World(make_job("x").with_executors(50))
    await world.reconcile()
    world.deliver(make_driver("x").running())
    world.deliver(*(placed(make_executor("x", n)) for n in range(50)))
    world.drivers.says = account()
    await world.reconcile()
    world.api.calls.clear()
    await world.reconcile(after=2)
    assert len([c for c in world.api.calls if c.startswith("events of")]) == MOST_PODS


async def test_of_a_pod_that_names_thousands_of_claims_a_few_are_asked_about() -> None:
    world = World()
    await world.reconcile()
    pod = make_driver("x")
    pod.claims = tuple(f"claim-{n}" for n in range(3_000))
    world.deliver(pod)
    await world.reconcile()
    world.api.calls.clear()
    await world.reconcile(after=2)
    asked = [call for call in world.api.calls if call.startswith("get persistentvolumeclaims")]
    assert len(asked) == MOST_CLAIMS


async def running_without_executors(world: World) -> None:
    await world.reconcile()
    world.deliver(make_driver("x").running())
    world.drivers.says = account(cases={"planned": 4, "running": 0})
    await world.reconcile()


QUOTA = ApiError(403, "Forbidden", 'pods "x" is forbidden: exceeded quota: small')
RESTRICTED = ApiError(403, "Forbidden", 'pods "x" is forbidden: violates PodSecurity "restricted"')


@pytest.mark.parametrize(
    ("error", "reason"), [(QUOTA, "QuotaExceeded"), (RESTRICTED, "ExecutorsRefused")]
)
async def test_executors_that_may_not_be_created(error: ApiError, reason: str) -> None:
    world = World()
    await running_without_executors(world)
    world.api.fail("try pods", error)
    await world.reconcile(after=3.9)
    assert world.reason("Running") == "False/ExecutorsPending"
    await world.reconcile(after=0.1)
    assert world.reason("Running") == f"False/{reason}"
    assert reason in world.api.event_reasons()
    await world.reconcile(after=4)
    assert world.reason("Running") == "False/ExecutorsPending"
    assert {shown["metadata"]["name"] for shown in world.api.shown} == {"x-1-exec-trial"}
    assert world.api.named("pods") == ["x-1-driver"]


DOWN = ApiError(500, "InternalError", 'failed calling webhook "pods.example": no endpoints')
HANGS = ApiError(504, "Timeout", "request did not complete within requested timeout")


@pytest.mark.parametrize("error", [DOWN, HANGS, ApiError(0, "Timeout", "no answer in time")])
async def test_a_webhook_that_does_not_answer_is_reported_and_ends_no_job(error: ApiError) -> None:
    world = World()
    await running_without_executors(world)
    for _ in range(20):
        world.api.fail("try pods", error)
    for _ in range(20):
        await world.reconcile(after=4)
    assert world.reason("Running") == "False/ExecutorsRefused"
    assert error.message in world.message("Running")
    assert world.status()["phase"] == "Running"


async def test_a_large_job_that_can_t_be_read_says_nothing_of_its_executors() -> None:
    world = World()
    await running_without_executors(world)
    entire = world.api.objects["jobs", "x"]
    world.view.put_job(JobView.from_object(trimmed(entire | {SIZE: LARGE + 1})))
    world.api.fail("get job", RESTRICTED, RESTRICTED)
    world.api.calls.clear()
    await world.reconcile(after=4)
    assert world.reason("Running") == "False/ExecutorsPending"
    assert "get job" in world.api.calls
    assert "try pods" not in world.api.calls


async def test_executors_that_are_all_there_are_not_asked_about() -> None:
    world = World()
    await running_without_executors(world)
    world.deliver(make_executor("x").running())
    world.api.calls.clear()
    await world.reconcile(after=10)
    await world.reconcile(after=10)
    assert "try pods" not in world.api.calls


async def test_a_thousand_jobs_without_executors_do_not_flood_the_api_server() -> None:
    api, clock = FakeApi(), Clock()
    lookout = Lookout(api, Settings(), clock.monotonic)
    jobs = [make_job(f"job-{number}").view() for number in range(1000)]

    async def visits(rounds: int) -> int:
        api.calls.clear()
        for _ in range(rounds):
            for job in jobs:
                assert await lookout.look(job, 1, (), cases_left=1) == ()
            clock.advance(2)
        return api.calls.count("try pods")

    assert await visits(4) == 1000  # each once, as soon as it has waited for four seconds
    assert await visits(40) == 0
    assert await visits(50) == 1000  # each once in 100 s
    for job in jobs[10:]:
        lookout.forget(job.uid)
    jobs = jobs[:10]
    assert await visits(10) == 10 * 5
