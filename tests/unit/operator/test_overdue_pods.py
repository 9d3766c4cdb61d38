"""Pods of ended jobs that should be gone are asked for, a bounded number of them in a minute."""

import asyncio
from datetime import timedelta
from itertools import pairwise
from typing import Any

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.overdue_pods import OverduePods
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.fair_share import MOST_LOOKS_PER_SECOND
from tests.unit.operator import virtual_time
from tests.unit.operator.builders import START, make_executor, make_job
from tests.unit.operator.fakes import FakeApi


class Cluster(FakeApi):
    """Ended jobs whose executors are deleted and stay, by namespace; what is asked, and when."""

    def __init__(self) -> None:
        super().__init__()
        self.view = View()
        self.asked: list[tuple[float, str, str]] = []
        self.forbidden: set[str] = set()

    def put_job(self, namespace: str, name: str, executors: int, ended: bool = True) -> None:
        job = make_job(name)
        if ended:
            job.with_status(conditions=[{"type": "Complete", "status": "True"}])
        job.object["metadata"]["namespace"] = namespace
        self.view.put_job(JobView.from_object(job.object))
        for number in range(1, executors + 1):
            pod = make_executor(name, number).running().deleting().object()
            pod["metadata"]["namespace"] = namespace
            self.put("pods", pod)
            self.view.put_pod(PodView.from_object(pod))

    async def get(self, resource: str, namespace: str, name: str) -> Json:
        self.asked.append((asyncio.get_running_loop().time(), namespace, name))
        if namespace in self.forbidden:
            raise ApiError(403, "Forbidden", "no rights")
        return await super().get(resource, namespace, name)

    def names(self) -> list[str]:
        return sorted(pod.name for pod in self.view.all_pods())

    async def go_on(self, seconds: float, **fields: Any) -> None:
        now = asyncio.get_running_loop().time
        pods = OverduePods(
            self, self.view, now=lambda: START + timedelta(seconds=3600 + now()), **fields
        )
        running = asyncio.create_task(pods.run())
        await asyncio.sleep(seconds)
        running.cancel()


def test_a_pod_that_went_unseen_is_not_counted_for_long() -> None:
    cluster = Cluster()
    cluster.put_job("lanes", "x", 2)
    cluster.put_job("lanes", "y", 1, ended=False)
    del cluster.objects["pods", "x-1-exec-1"]
    virtual_time.run(cluster.go_on(3630))
    assert cluster.names() == ["x-1-exec-2", "y-1-exec-1"]
    # On a node that is cut off, it may be there for hours.
    assert sum(name == "x-1-exec-2" for *_, name in cluster.asked) == 60
    assert not any(name.startswith("y") for *_, name in cluster.asked)


def test_a_namesake_is_not_taken_for_a_pod_that_went() -> None:
    cluster = Cluster()
    cluster.put_job("lanes", "x", 1)
    cluster.objects["pods", "x-1-exec-1"]["metadata"]["uid"] = "uid-of-another"
    virtual_time.run(cluster.go_on(61))
    assert cluster.names() == []


@pytest.mark.parametrize("executors", [3000, 30_000])
def test_thousands_are_asked_for_in_turn(executors: int) -> None:
    """Of the first ones alone no round would come to what went."""
    cluster = Cluster()
    cluster.put_job("lanes", "x", executors)
    virtual_time.run(cluster.go_on(660))
    looks = len(cluster.asked)
    assert looks <= 660 * MOST_LOOKS_PER_SECOND
    names = [name for *_, name in cluster.asked]
    assert len(set(names)) == min(executors, looks) > 2999


def test_another_namespace_s_pods_are_asked_for_all_the_same() -> None:
    cluster = Cluster()
    cluster.put_job("aaa", "x", 2000)
    cluster.put_job("bbb", "y", 3)
    cluster.put_job("ccc", "z", 1)
    cluster.forbidden = {"bbb"}
    virtual_time.run(cluster.go_on(600))
    times = [at for at, namespace, _ in cluster.asked if namespace == "ccc"]
    assert max(after - before for before, after in pairwise(times)) <= 90
    # Where it may not ask, one answer is enough for a round, and each pod has its turn.
    refused = [name for _, namespace, name in cluster.asked if namespace == "bbb"]
    assert refused[:4] == ["y-1-exec-1", "y-1-exec-2", "y-1-exec-3", "y-1-exec-1"]


def test_who_does_not_lead_asks_for_nothing() -> None:
    cluster = Cluster()
    cluster.put_job("lanes", "x", 2)
    virtual_time.run(cluster.go_on(600, leads=lambda: False))
    assert cluster.asked == []
