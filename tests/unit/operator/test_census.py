"""Jobs that went while nobody watched are forgotten, and no other."""

import asyncio
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.claim import Claim
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.census import Census
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.schedules.view import ScheduledJob, Schedules, ScheduleView
from tests.unit.operator import virtual_time
from tests.unit.operator.builders import make_driver, make_job
from tests.unit.operator.schedules.world import UID, World, make_schedule, name_of
from tests.unit.operator.schedules.world import make_job as made_by_schedule
from tests.waiting import PATIENCE


@dataclass
class Register:
    """What the API server has, by namespace; and what happens while it is asked."""

    view: View
    there: dict[str | None, set[str]]
    created: list[str] = field(default_factory=list)
    fault: ApiError | None = None
    forbidden: set[str | None] = field(default_factory=set)

    async def job_uids(self, namespace: str | None) -> set[str]:
        if self.fault:
            raise self.fault
        if namespace in self.forbidden:
            raise ApiError(403, "Forbidden", "no RoleBinding")
        for name in self.created:
            self.view.put_job(make_job(name).view())
        return self.there[namespace]


def viewing(*names: str) -> View:
    view = View()
    for name in names:
        view.put_job(make_job(name).with_status(conditions=[]).view())
    return view


def known(view: View) -> list[str]:
    return sorted(job.name for job in view.jobs())


@pytest.mark.parametrize("namespaces", [(None,), ("lanes", "drives")])
async def test_what_is_gone_is_forgotten(namespaces: tuple[str | None, ...]) -> None:
    view, queue = viewing("here", "gone"), WorkQueue()
    register = Register(view, {None: {"uid-of-here"}, "lanes": {"uid-of-here"}, "drives": set()})
    census = Census(view, queue, register.job_uids, namespaces)
    for name in ("here", "gone"):
        view.put_pod(make_driver(name).view())
    assert (await census.count(), known(view)) == (1, ["here"])
    assert [pod.name for pod in view.all_pods()] == ["here-1-driver"]
    # Whoever visits it finds nothing, and forgets what is kept of it elsewhere.
    assert (len(queue), await queue.get()) == (1, "uid-of-gone")
    assert await census.count() == 0


async def test_pods_that_went_without_a_word_after_their_job_are_forgotten() -> None:
    view, queue = viewing("here", "gone"), WorkQueue()
    for name in ("here", "gone"):
        view.put_pod(make_driver(name).view())
    view.drop_job("uid-of-gone")
    census = Census(view, queue, Register(view, {None: {"uid-of-here"}}).job_uids, (None,))
    assert await census.count() == 1
    assert [pod.name for pod in view.all_pods()] == ["here-1-driver"]
    assert await census.count() == 0


async def test_pods_that_run_another_job_outlast_the_job_that_they_were_made_for() -> None:
    """Its garbage collector was asked to leave them."""
    view, driver = viewing(), make_driver("host").running().view()
    view.put_pod(driver)
    now = datetime(2026, 11, 20, tzinfo=UTC)
    claim = Claim(driver.uid, now, "Taken", driver.name, "host", "uid-of-host")
    view.put_job(make_job("guest").with_status(pool=claim.as_status("lanes")).view())
    census = Census(view, WorkQueue(), Register(view, {None: {"uid-of-guest"}}).job_uids, (None,))
    assert await census.count() == 0
    assert [pod.name for pod in view.pods("uid-of-guest")] == [driver.name]


async def test_what_was_created_while_the_list_was_read_stays() -> None:
    view = viewing("here")
    register = Register(view, {None: {"uid-of-here"}}, created=["new"])
    assert await Census(view, WorkQueue(), register.job_uids, (None,)).count() == 0
    assert known(view) == ["here", "new"]


async def test_a_list_that_fails_forgets_nobody() -> None:
    view = viewing("here")
    register = Register(view, {}, fault=ApiError(410, "Expired", "the continue token is too old"))
    with pytest.raises(ApiError):
        await Census(view, WorkQueue(), register.job_uids, (None,)).count()
    assert known(view) == ["here"]


@pytest.mark.parametrize(
    "fault", [ApiError(410, "Expired", "the continue token is too old"), RuntimeError("a bug")]
)
async def test_a_fault_ends_no_census(fault: Exception) -> None:
    view, queue, faults = viewing("gone"), WorkQueue(), [fault]

    async def register(_: str | None) -> set[str]:
        if faults:
            raise faults.pop()
        return set()

    running = asyncio.create_task(Census(view, queue, register, (None,), period_seconds=0).run())
    async with asyncio.timeout(PATIENCE):
        assert await queue.get() == "uid-of-gone"
    running.cancel()
    assert known(view) == []


async def counted_at(relists: list[float], until: float, faults: int = 0) -> list[float]:
    """When a census counts, for watches that begin again at these moments."""
    loop, counts, left = asyncio.get_running_loop(), list[float](), [ApiError(0, "", "")] * faults

    async def register(_: str | None) -> set[str]:
        counts.append(loop.time())
        if left:
            raise left.pop()
        return set()

    census = Census(viewing(), WorkQueue(), register, (None,))
    for moment in relists:
        loop.call_at(moment, census.hasten)
    running = asyncio.create_task(census.run())
    await asyncio.sleep(until)
    running.cancel()
    return counts


@pytest.mark.parametrize(
    ("relists", "faults", "counts"),
    [
        ([], 0, [600, 1200]),
        ([100], 0, [100, 700, 1300]),
        ([10], 0, [60, 660, 1260]),
        # However often they begin again, no more than one a minute: each lists all that there is.
        ([float(second) for second in range(10, 200)], 0, [60, 120, 180, 240, 840]),
        # The API server that has just started again may not answer yet.
        ([100], 2, [100, 160, 220, 820]),
    ],
)
def test_a_watch_that_begins_again_brings_the_census_forward(
    relists: list[float], faults: int, counts: list[float]
) -> None:
    assert virtual_time.run(counted_at(relists, 1301, faults)) == counts


def test_a_namespace_that_is_not_listed_is_asked_for_alone_until_it_is() -> None:
    """Each list of all the others is much work for the API server."""

    async def lists() -> dict[str | None, list[float]]:
        asked: dict[str | None, list[float]] = {"drives": [], "lanes": []}

        async def register(namespace: str | None) -> set[str]:
            asked[namespace].append(asyncio.get_running_loop().time())
            if namespace == "drives" and len(asked[namespace]) < 25:
                raise ApiError(403, "Forbidden", "no RoleBinding")
            return set()

        view = viewing()
        census = Census(view, WorkQueue(), register, ("drives", "lanes"), unlisted={"drives"})
        running = asyncio.create_task(census.run())
        await asyncio.sleep(1000)
        for name, namespace in (("x", "drives"), ("y", "lanes")):
            view.put_job(replace(make_job(name).view(), namespace=namespace))
        asyncio.get_running_loop().call_later(30, census.hasten)
        await asyncio.sleep(460)
        assert known(view) == ["x"]
        view.put_job(replace(make_job("z").view(), namespace="lanes"))
        await asyncio.sleep(50)
        running.cancel()
        assert known(view) == ["z"]
        assert census.unlisted == set()
        return asked

    asked = virtual_time.run(lists())
    assert asked["drives"] == [60 * count for count in range(1, 26)]
    # After ten minutes, and since a watch has begun again.
    assert asked["lanes"] == [600, 1080]


async def test_a_namespace_that_can_t_be_listed_keeps_its_jobs_and_no_others() -> None:
    """Its RoleBinding is gone: what it has is not known, what others have is."""
    view, queue = viewing("gone"), WorkQueue()
    view.put_job(replace(make_job("unknown").view(), namespace="drives"))
    for name in ("unknown", "orphan"):
        view.put_pod(replace(make_driver(name).view(), namespace="drives"))
    register = Register(view, {"lanes": set()}, forbidden={"drives"})
    census = Census(view, queue, register.job_uids, ("drives", "lanes"))
    assert (await census.count(), known(view)) == (1, ["unknown"])
    assert sorted(pod.name for pod in view.all_pods()) == ["orphan-1-driver", "unknown-1-driver"]
    assert census.unlisted == {"drives"}
    register.there["drives"], register.forbidden = set(), set()
    assert (await census.count(), known(view)) == (2, [])
    assert census.unlisted == set()


async def test_trouble_is_reported_once_no_namespace_can_be_listed() -> None:
    view = viewing()
    register = Register(view, {"lanes": set(), "drives": set()}, forbidden={"drives"})
    census = Census(view, WorkQueue(), register.job_uids, ("drives", "lanes"))
    await census.count()
    assert census.trouble() == ""
    register.forbidden = {"drives", "lanes"}
    with pytest.raises(ApiError, match="no RoleBinding"):
        await census.count()
    assert census.trouble() == (
        "no list of jobs is answered in drives, lanes: has the operator its rights there?"
    )
    register.forbidden = {"lanes"}
    await census.count()
    assert census.trouble() == ""


@pytest.mark.parametrize("fault", [ApiError(0, "Timeout", "late"), ApiError(500, "", "busy")])
async def test_a_list_that_is_not_answered_in_time_is_no_lack_of_rights(fault: ApiError) -> None:
    register = Register(viewing(), {"lanes": set(), "drives": set()}, fault=fault)
    census = Census(viewing(), WorkQueue(), register.job_uids, ("drives", "lanes"))
    with pytest.raises(ApiError):
        await census.count()
    assert census.trouble() == ""
    register.fault, register.forbidden = None, {"drives"}
    await census.count()
    assert census.trouble() == ""


async def test_a_pod_in_another_namespace_keeps_no_job_that_is_gone() -> None:
    """Its label is anybody's to write."""
    view = viewing("gone")
    view.put_pod(replace(make_driver("gone").view(), namespace="drives"))
    register = Register(view, {"lanes": set()}, forbidden={"drives"})
    assert await Census(view, WorkQueue(), register.job_uids, ("drives", "lanes")).count() == 1
    assert known(view) == []


async def test_a_job_in_another_namespace_keeps_no_schedule_that_is_gone() -> None:
    view = Schedules()
    view.put_schedule(ScheduleView.from_object(make_schedule()))
    job = ScheduledJob.from_object(made_by_schedule(name_of(1)))
    view.put_job(replace(job, namespace="drives"))
    register = Register(View(), {"lanes": set()}, forbidden={"drives"})
    census = Census(view, WorkQueue(), register.job_uids, ("drives", "lanes"))
    assert (await census.count(), view.schedule(UID)) == (1, None)


async def test_schedules_of_a_namespace_that_can_t_be_listed_stay() -> None:
    view, schedule = Schedules(), make_schedule()
    view.put_schedule(ScheduleView.from_object(schedule))

    async def register(namespace: str | None) -> set[str]:
        if namespace == schedule["metadata"]["namespace"]:
            raise ApiError(403, "Forbidden", "no RoleBinding")
        return set()

    namespaces = (schedule["metadata"]["namespace"], "maps")
    assert await Census(view, WorkQueue(), register, namespaces).count() == 0
    assert view.schedule(UID) is not None


async def test_a_schedule_that_is_gone_is_forgotten() -> None:
    """A stalled one has no alarm, so that nobody else finds it gone, and is alerted of for ever."""
    world = World(schedule="61 * * * *")
    await world.at(1)
    assert 'bagpipe_schedules{state="Stalled"} 1.0' in world.exposed()
    queue, there = WorkQueue(), {UID}

    async def register(_: str | None) -> set[str]:
        return there

    census = Census(world.view, queue, register, (None,))
    assert await census.count() == 0
    there.clear()
    assert (await census.count(), await queue.get()) == (1, UID)
    assert 'bagpipe_schedules{state="Stalled"} 0.0' in world.exposed()


async def test_jobs_of_a_schedule_that_is_gone_are_forgotten() -> None:
    """The watch reported the schedule's deletion, and not that of its jobs."""
    view = Schedules()
    view.put_job(ScheduledJob.from_object(passed_job()))
    view.drop_schedule(UID)
    await Census(view, WorkQueue(), _none, (None,)).count()
    assert (view.jobs(UID), view.uids()) == ((), [])


async def test_the_last_run_that_passed_is_forgotten_with_its_schedule() -> None:
    """Its job was removed before: schedules that come and go would fill the memory."""
    view, schedule, job = Schedules(), make_schedule(), ScheduledJob.from_object(passed_job())
    view.put_schedule(ScheduleView.from_object(schedule))
    view.put_job(job)
    view.drop_job(job)
    assert view.last_passed(UID) == job.passed_run is not None
    view.drop_schedule(UID)
    await Census(view, WorkQueue(), _none, (None,)).count()
    assert view.uids() == []


def passed_job() -> Json:
    job = made_by_schedule(name_of(1), "Complete")
    job["status"]["results"] = "s3://results/a"
    job["status"]["conditions"].append({"type": "Passed", "status": "True"})
    return job


async def _none(_: str | None) -> set[str]:
    return set()
