"""The loop's own promises: nothing blocks it, and its cache may be behind without doing harm."""

import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from kubernetes.aio import config
from kubernetes.aio.client import ApiClient, Configuration

from bagpipe_operator.cluster.client import ApiError, KubernetesApi
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.reconcile import Reconciler
from bagpipe_operator.jobs.view import View
from bagpipe_operator.settings import Settings
from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.due_schedules import a_schedule, schedules
from tests.integration.control_plane.fake_driver import fake_driver
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.integration.control_plane.observe import await_phase, create_jobs, statuses
from tests.integration.control_plane.release import Installation
from tests.unit.operator.builders import Clock, account
from tests.unit.operator.fakes import FakeDrivers
from tests.waiting import PATIENCE, wait_until

A_CONTAINER = {"name": "c", "image": "example/none:1"}
WATCHED = Path(__file__).with_name("watched_operator.py")


def test_nothing_blocks_the_loop(
    admin: Client, namespace: str, kubelet: FakeKubelet, operator_process: StartOperator
) -> None:
    """A whole job: created, planned, running with progress, ended, deleted; scraped meanwhile.

    And a schedule, whose time zone is a file.
    """
    operator = operator_process(start=False)
    operator.server.command[-1:] = [sys.executable, str(WATCHED)]
    operator.start()
    create_jobs(admin, namespace, ["a"])
    yearly = a_schedule(schedule="0 0 1 1 *", timeZone="Europe/Berlin")
    admin.create(schedules(namespace), yearly)
    await_phase(admin, namespace, "Pending", 1)
    path = schedules(namespace, "nightly")
    wait_until(
        lambda: admin.get(path).get("status", {}).get("nextScheduleTime", "").endswith("23:00:00Z"),
        PATIENCE,
        "the schedule's next run is not reported",
    )
    with fake_driver(account()) as driver:
        kubelet.run(namespace, "a-1-driver", ip=driver.ip)
        await_phase(admin, namespace, "Running", 1)
        assert statuses(admin, namespace)["a"]["cases"]["planned"] == 4
        wait_until(lambda: driver.asked >= 2, PATIENCE, "the driver was not asked again")
    kubelet.end(namespace, "a-1-driver", 0, account("Complete", verdict="Passed"))
    await_phase(admin, namespace, "Complete", 1)
    admin.delete(jobs(namespace, "a"))
    wait_until(
        lambda: operator.metric('bagpipe_jobs{phase="Complete"}') == 0, PATIENCE, "still there"
    )
    assert operator.terminate() == 0
    assert [line for line in operator.logged().splitlines() if line.startswith("BLOCKS")] == []


def test_what_blocks_a_loop_would_be_reported() -> None:
    program = (
        "import asyncio, sys, time, runpy, socket, bagpipe_operator.main as m\n"
        "async def blocking():\n"
        "    open('/dev/null').close()\n"
        "    time.sleep(0.01)\n"
        "    socket.getaddrinfo('127.0.0.1', 1)\n"
        "    await asyncio.to_thread(lambda: open('/dev/null').close())\n"
        "m.main = lambda: asyncio.run(blocking())\n"
        f"runpy.run_path({str(WATCHED)!r}, run_name='__main__')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    blocking = [line.split()[1] for line in done.stderr.splitlines() if line.startswith("BLOCKS")]
    assert blocking == ["open", "time.sleep", "socket.getaddrinfo"]


@asynccontextmanager
async def as_operator(installation: Installation) -> AsyncIterator[KubernetesApi]:
    """The operator's own client, with the chart's rights."""
    configuration = Configuration()
    load: Any = config  # its functions carry no types
    await load.load_kube_config(
        config_file=str(installation.kubeconfig), client_configuration=configuration
    )
    async with ApiClient(configuration=configuration) as client:
        yield KubernetesApi(client, PATIENCE)


class Behind:
    """An operator whose watch delivers nothing but what a test hands to it."""

    def __init__(self, api: KubernetesApi, job: Object) -> None:
        self.clock = Clock()
        self.view = View()
        self.view.put_job(JobView.from_object(job))
        self.uid = str(job["metadata"]["uid"])
        self.reconciler = Reconciler(
            api, self.view, FakeDrivers(), Settings(), monotonic=self.clock.monotonic
        )

    async def reconcile(self, after: float = 0.0) -> None:
        self.clock.advance(after)
        await self.reconciler.reconcile(self.uid)


async def test_a_late_end_of_a_namesake_does_not_end_a_healthy_driver(
    admin: Client, namespace: str, kubelet: FakeKubelet, installation: Installation
) -> None:
    """The first operator died between pod and status, somebody deleted the pod, the second made
    it again; the watch then reports to the second all that happened to the first pod.
    """
    create_jobs(admin, namespace, ["x"])
    unwritten = admin.get(jobs(namespace, "x"))
    path = core(namespace, "pods", "x-1-driver")
    async with as_operator(installation) as api:
        first = Behind(api, unwritten)
        await first.reconciler._starts.start(JobView.from_object(unwritten), 1)
        past = [admin.get(path)]
        kubelet.bind(namespace, "x-1-driver")
        admin.delete(path)
        past.append(admin.get(path))
        kubelet.remove(namespace, "x-1-driver")

        second = Behind(api, unwritten)
        await second.reconcile()
        healthy = admin.get(path)["metadata"]["uid"]
        for old in past:
            second.view.put_pod(PodView.from_object(old))
            await second.reconcile()
        second.view.drop_pod(PodView.from_object(past[-1]))
        await second.reconcile()
        await second.reconcile(after=60.0)
    assert admin.get(path)["metadata"]["uid"] == healthy
    status = statuses(admin, namespace)["x"]
    assert (status["phase"], status["attempt"], status["driver"]) == ("Pending", 1, "x-1-driver")


async def test_a_pod_that_has_another_s_name_keeps_neither_a_deletion_nor_a_start(
    admin: Client, namespace: str, installation: Installation
) -> None:
    """What the API server answers about the UID that was asked for, and about the trial's name."""
    create_jobs(admin, namespace, ["x"])
    pod = {"metadata": {"name": "x-1-exec-trial"}, "spec": {"containers": [A_CONTAINER]}}
    there = admin.create(core(namespace, "pods"), pod)["metadata"]["uid"]
    async with as_operator(installation) as api:
        await Behind(api, admin.get(jobs(namespace, "x"))).reconcile()
        assert statuses(admin, namespace)["x"]["driver"] == "x-1-driver"
        assert await api.delete_pod(namespace, "x-1-exec-trial", "uid-of-another") is False
        assert admin.get(core(namespace, "pods", "x-1-exec-trial"))["metadata"]["uid"] == there
        assert await api.delete_pod(namespace, "x-1-exec-trial", there) is True


async def test_a_driver_that_the_watch_has_not_reported_is_looked_for_before_it_is_lost(
    admin: Client, namespace: str, kubelet: FakeKubelet, installation: Installation
) -> None:
    create_jobs(admin, namespace, ["x"])
    async with as_operator(installation) as api:
        await Behind(api, admin.get(jobs(namespace, "x"))).reconcile()
        kubelet.run(namespace, "x-1-driver")
        successor = Behind(api, admin.get(jobs(namespace, "x")))
        await successor.reconcile()
        await successor.reconcile(after=3600.0)
        assert statuses(admin, namespace)["x"]["attempt"] == 1
        assert admin.exists(core(namespace, "pods", "x-1-driver"))
        # And one that is really gone is replaced, by the same way.
        admin.delete(core(namespace, "pods", "x-1-driver"))
        other = Behind(api, admin.get(jobs(namespace, "x")))
        await other.reconcile()
        await other.reconcile(after=60.0)
    assert statuses(admin, namespace)["x"]["attempt"] == 2


async def test_a_job_that_has_moved_on_is_read_again_and_not_overwritten(
    admin: Client, namespace: str, installation: Installation
) -> None:
    create_jobs(admin, namespace, ["x"])
    unwritten = admin.get(jobs(namespace, "x"))
    async with as_operator(installation) as api:
        await Behind(api, unwritten).reconcile()
        moved = {"status": {"phase": "Running", "attempt": 2, "driver": ""}}
        admin.merge(jobs(namespace, "x") + "/status", moved)
        late = Behind(api, unwritten)
        with pytest.raises(ApiError, match="409 Conflict"):
            await late.reconcile()
        assert statuses(admin, namespace)["x"]["attempt"] == 2
        await late.reconcile()
    assert statuses(admin, namespace)["x"]["driver"] == "x-2-driver"
    assert not admin.exists(core(namespace, "pods", "x-1-driver"))
