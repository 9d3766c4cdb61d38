"""Whatever happens in whatever order, a job's status keeps its promises."""

import asyncio
import os
from dataclasses import replace

from hypothesis import example, given, settings
from hypothesis import strategies as st

from bagpipe_operator.api import names
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.policies.places import living
from bagpipe_operator.jobs.view import View
from tests.unit.operator.builders import PodBuilder, account, make_driver, make_executor, make_job
from tests.unit.operator.test_life import edit, gone
from tests.unit.operator.test_unseen import vanish
from tests.unit.operator.world import UID, World

DONE = account("Complete", cases={"planned": 4, "passed": 4})
BROKEN = account("Failed", reason="BagUnreadable", message="drive.bag ends.")
KUBELET = [
    "driver runs", "driver dies", "driver completes", "driver fails", "executor comes",
    "driver is drained", "driver completes beside a proxy", "driver dies beside a proxy",
]  # fmt: skip
CALLS = ["create configmaps", "create pods", "try pods", "get pods", "get configmaps", "get job",
         "patch status"]  # fmt: skip
LOSABLE = ["create configmaps", "create pods", "delete pod", "patch status"]
EVENTS = [
    *KUBELET, "suspend", "resume", "pods go", "operator restarts", "pods are seen",
    "wait 2", "wait 40", "wait 700", "driver vanishes unseen", "executor vanishes unseen",
    "label", "deadline", "release", "quota fills", "driver is silent", "driver answers",
    *(f"fails: {call}" for call in CALLS), *(f"lost: {call}" for call in LOSABLE),
]  # fmt: skip
# So many histories at each run of the tests; BAGPIPE_HISTORIES=10000 for a long look.
HISTORIES = int(os.environ.get("BAGPIPE_HISTORIES", "300"))
QUOTA = ApiError(403, "Forbidden", "exceeded quota: pods, requested: pods=1, used: pods=5")


def attempt_of(world: World) -> int:
    return int(world.status().get("attempt") or 1)


def backoff_of(world: World) -> int:
    return int(world.api.objects["jobs", "x"]["spec"]["backoffLimit"])


def kubelet(world: World, event: str) -> None:
    """The kubelet speaks only of a pod that exists; executors come only from a driver."""
    driver = make_driver("x", attempt_of(world))
    pods: dict[str, PodBuilder] = {
        "driver runs": driver.running(),
        "driver dies": make_driver("x", attempt_of(world)).ended(137),
        "driver completes": make_driver("x", attempt_of(world)).ended(0, DONE),
        "driver fails": make_driver("x", attempt_of(world)).ended(1, BROKEN),
        "executor comes": make_executor("x", 1, attempt_of(world)).running(),
        "driver is drained": make_driver("x", attempt_of(world))
        .ended(143)
        .disrupted("EvictionByEvictionAPI", "Eviction API: evicting"),
        "driver completes beside a proxy": beside_a_proxy(driver, world, 0, DONE),
        "driver dies beside a proxy": beside_a_proxy(driver, world, 137, ""),
    }
    if ("pods", driver.name) in world.api.objects:
        world.deliver(pods[event])


def beside_a_proxy(driver: PodBuilder, world: World, code: int, message: str) -> PodBuilder:
    """The driver's container has ended, and another one of its pod does not."""
    at = world.clock.now().isoformat()
    ended = {"exitCode": code, "message": message, "finishedAt": at}
    pod = make_driver("x", driver.attempt).running().with_container("proxy", {"running": {}})
    return pod.with_container(names.CONTAINER_DRIVER, {"terminated": ended})


def happen(world: World, event: str) -> None:
    """One event, without the reconcile that follows it."""
    match event.split():
        case ["pods", "go"]:
            left = world.api.objects
            gone(world, *[p.name for p in world.view.pods(UID) if ("pods", p.name) not in left])
        case ["operator", "restarts"]:
            fresh = View()
            fresh.put_job(JobView.from_object(world.api.objects["jobs", "x"]))
            world.view = fresh
            world.reconciler = world.restarted(fresh)
        case [role, "vanishes", "unseen"]:
            vanish(world, *[pod.name for pod in world.view.pods(UID) if pod.role == role])
        case ["pods", "are", "seen"]:
            for (kind, _), pod in list(world.api.objects.items()):
                if kind == "pods":
                    world.view.put_pod(PodView.from_object(pod))
        case ["wait", seconds]:
            world.clock.advance(float(seconds))
        case ["suspend" | "resume" | "label" | "deadline" | "release"]:
            edited(world, event)
        case _ if event in KUBELET:
            kubelet(world, event)
        case _:
            fault(world, event)


def edited(world: World, event: str) -> None:
    """Somebody changes what may be changed while a job waits or runs."""
    match event:
        case "suspend" | "resume":
            edit(world, suspend=event == "suspend")
        case "label":
            world.api.objects["jobs", "x"]["metadata"]["labels"] = {"at": str(world.clock.now())}
            edit(world)
        case "deadline":
            edit(world, activeDeadline="100000s")
        case _:
            settings = world.reconciler.settings
            newer = f"{settings.spark_image}+"
            world.reconciler.settings = replace(settings, spark_image=newer)


def fault(world: World, event: str) -> None:
    """A call to come fails, or takes effect without an answer; or the driver can't be reached."""
    kind, _, call = event.partition(" ")
    if kind == "driver":
        world.drivers.says = account() if call == "answers" else None
        return
    if kind == "fails:":
        world.api.fail(call, ApiError(0, "Unreachable", "no"))
    elif kind == "lost:":
        world.api.lost.add(call)
    else:
        world.api.fail("create pods", QUOTA)


async def step(world: World, event: str) -> None:
    happen(world, event)
    try:
        await world.reconcile()
    except ApiError as error:
        # 409: an answer was lost, and what it would have stated is looked at before the next try.
        assert error.status in {0, 409}


def check(world: World, reported: set[str], late: bool = False) -> None:
    status = world.status()
    true = {c["type"] for c in status.get("conditions") or [] if c["status"] == "True"}
    assert not {"Complete", "Failed"} <= true
    ended = true & {"Complete", "Failed"}
    assert bool(ended) == ("completionTime" in status)
    if ended:
        assert status["startTime"] <= status["completionTime"]
        (why,) = [c for c in status["conditions"] if c["type"] in ended and c["status"] == "True"]
        assert why["reason"]
        assert why["message"]
        assert "Suspended" not in true
    if "Suspended" in true:
        assert "startTime" not in status
        if not late:
            assert living(world.view.pods(UID), world.clock.now()) == ()
    drivers = [n for n in world.api.named("pods") if n.endswith("-driver") and _lives(world, n)]
    assert len(drivers) <= 1, drivers
    assert int(status.get("lostDrivers") or 0) <= backoff_of(world)
    assert not reported or reported == ended  # an end is for good
    reported |= ended


@settings(max_examples=HISTORIES, deadline=None)
@example(
    ["driver runs", "driver dies beside a proxy", "operator restarts", "wait 40"], 1, None, False
)
@example(
    ["driver runs", "lost: create pods", "driver dies beside a proxy", "wait 40"], 1, None, False
)
@given(
    st.lists(st.sampled_from(EVENTS), max_size=40),
    st.integers(min_value=0, max_value=2),
    st.sampled_from([None, "60s", "10m"]),
    st.booleans(),
)
def test_no_sequence_of_events_breaks_a_promise(
    events: list[str], backoff: int, deadline: str | None, suspended: bool
) -> None:
    job = make_job("x").with_spec("backoffLimit", backoff).with_spec("suspend", suspended)
    if deadline is not None:
        job.with_spec("activeDeadline", deadline)
    world = World(job)
    world.drivers.says = account()

    async def live() -> None:
        reported: set[str] = set()
        for event in events:
            await step(world, event)
            # A pod that the watch shows only now is met by the next reconcile.
            check(world, reported, late=event == "pods are seen" and bool(world.api.faults))
        world.api.faults.clear()
        world.api.lost.clear()
        # And a job left suspended has no living pod in the end, also if no watch reports it.
        happen(world, "suspend")
        happen(world, "pods are seen")
        for _ in range(12):
            await world.reconcile(after=10)
        check(world, reported)
        assert [n for n in world.api.named("pods") if _lives(world, n)] == []
        assert world.status()["phase"] in {"Suspended", "Complete", "Failed"}

    asyncio.run(live())


def _lives(world: World, name: str) -> bool:
    return bool(world.api.objects["pods", name].get("status", {}).get("phase") not in
                {"Succeeded", "Failed"})  # fmt: skip
