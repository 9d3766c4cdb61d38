"""Jobs that went while nobody watched are forgotten, and no other."""

from dataclasses import dataclass, field

import pytest

from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.census import Census
from bagpipe_operator.runtime.queue import WorkQueue
from tests.unit.operator.builders import make_driver, make_job
from tests.unit.operator.schedules.world import UID, World


@dataclass
class Register:
    """What the API server has, by namespace; and what happens while it is asked."""

    view: View
    there: dict[str | None, set[str]]
    created: list[str] = field(default_factory=list)
    fault: ApiError | None = None

    async def job_uids(self, namespace: str | None) -> set[str]:
        if self.fault:
            raise self.fault
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
