"""A driver that has run a thousand jobs, none of which is deleted yet: one loop serves all tenants.

A thousand is what one driver takes.
"""

import asyncio
from collections.abc import Callable

import pytest

from bagpipe_operator.api import names
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import ContainerView, PodView
from bagpipe_operator.jobs.pools.standing import drivers_of_pools
from bagpipe_operator.jobs.view import View
from tests.unit.operator.pools.pool_world import World, pooled

GUESTS, EXECUTORS = 1_000, 500
MORNING, NOON = "2026-11-20T05:00:00Z", "2026-11-20T12:00:00Z"


def ended_job(name: str, pool: dict[str, object], at: str) -> JobView:
    done = [{"type": "Complete", "status": "True"}]
    status = {"pool": pool, "driver": "home-driver", "conditions": done, "completionTime": at}
    return JobView("ns", name, name, 1, "1", status=status)


def guest(number: int, at: str = MORNING) -> JobView:
    claim: dict[str, object] = {
        "name": "lane", "state": "Taken", "driver": "D", "pod": "home-driver", "job": "home",
        "uid": "home", "attempt": 1, "digest": "", "since": "2026-11-20T04:00:00Z",
    }  # fmt: skip
    return ended_job(f"g{number:04d}", claim, at)


def busy_pool(guests: int = GUESTS, executors: int = EXECUTORS) -> View:
    view = View()
    view.put_job(ended_job("home", {"name": "lane", "state": "Cold"}, "2026-11-20T04:00:00Z"))
    for number in range(guests):
        view.put_job(guest(number))
    runs = (ContainerView(names.CONTAINER_DRIVER, running=True),)
    view.put_pod(
        PodView("ns", "home-driver", "D", "home", "home", names.ROLE_DRIVER, 1, containers=runs,
                phase="Running", shape="s")
    )  # fmt: skip
    for number in range(executors):
        name = f"home-{number}"
        view.put_pod(PodView("ns", name, name, "home", "home", names.ROLE_EXECUTOR, 1))
    return view


def looks(monkeypatch: pytest.MonkeyPatch, act: Callable[[], object]) -> int:
    """How often a job is asked whether it has ended."""
    asked = 0
    plain = vars(JobView)["finished"].func

    def counting(job: JobView) -> bool:
        nonlocal asked
        asked += 1
        return bool(plain(job))

    with monkeypatch.context() as counts:
        counts.setattr(JobView, "finished", property(counting))
        act()
    return asked


def of_all(view: View) -> dict[str, int]:
    """How many pods each job has, as each sweep asks; without those that have none."""
    found = {job.uid: len(view.pods(job.uid)) for job in view.jobs()}
    return {uid: pods for uid, pods in found.items() if pods}


def drivers(view: View) -> object:
    return drivers_of_pools(view, "ns")


def shown(view: View) -> object:
    return [view.shown(pod) for pod in view.all_pods()]


@pytest.mark.parametrize("ask", [drivers, of_all, lambda view: view.pods("home"), shown])
def test_each_guest_is_looked_at_a_few_times_and_not_for_each_other(
    monkeypatch: pytest.MonkeyPatch, ask: Callable[[View], object]
) -> None:
    view = busy_pool()
    assert looks(monkeypatch, lambda: ask(view)) <= 5 * GUESTS


def test_jobs_of_another_namespace_s_pools_cost_a_waiting_driver_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its job is visited every two seconds, and others may have thousands that wait."""
    world = World(pooled("one"))
    asyncio.run(world.run_the_first())
    alone = looks(monkeypatch, lambda: asyncio.run(world.visit("one", after=2)))
    for number in range(1_000):
        status = {"pool": {"name": "lane", "state": "Cold"}, "driver": f"{number}-1-driver"}
        world.view.put_job(JobView("others", str(number), f"u{number}", 1, "1", status=status))
    assert looks(monkeypatch, lambda: asyncio.run(world.visit("one", after=2))) == alone
    assert world.pods() == ["one-1-driver", "one-1-exec-1"]


def test_the_pods_are_those_of_the_last_guest_whichever_comes_and_goes() -> None:
    view = busy_pool(guests=3, executors=4)
    assert of_all(view) == {"g0002": 5}
    view.put_job(guest(0, NOON))
    assert of_all(view) == {"g0000": 5}
    view.drop_job("g0000")
    assert of_all(view) == {"g0002": 5}
    for left in ("g0002", "g0001"):
        view.drop_job(left)
    assert of_all(view) == {"home": 5}
    view.put_job(guest(7))
    assert of_all(view) == {"g0007": 5}
