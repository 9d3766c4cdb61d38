"""Schedules on a real API server with real watches, rights and garbage collection.

The operator's loop of schedules runs in the test, so that its clock can be moved by hours; two
tests run the whole operator as a process on the wall's clock.
"""

import asyncio
import json
import subprocess
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import kopf
import pytest
import yaml
from embedded.api import ApiError
from kubernetes.aio import config
from kubernetes.aio.client import ApiClient, Configuration

from bagpipe_operator.cluster.client import KubernetesApi
from bagpipe_operator.jobs import watch
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.schedules.loop import ScheduleLoop
from tests.integration.control_plane.client import Client, Object, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.due_schedules import (
    a_schedule,
    due_once,
    schedules,
    set_last_run,
    start_run,
)
from tests.integration.control_plane.operator_process import OperatorProcess
from tests.integration.control_plane.release import Installation
from tests.integration.control_plane.server import ControlPlane, binaries
from tests.waiting import PATIENCE, wait_until

SECONDS = PATIENCE
DAY = timedelta(days=1)
PUBLISHED = Path(__file__).parents[4] / "docs/examples/schedule/schedule.yaml"


@dataclass
class Bench:
    """A namespace, its schedule `nightly`, and the clock of the operators that look at it."""

    admin: Client
    namespace: str
    clock: datetime

    def now(self) -> datetime:
        return self.clock

    def create(self, **spec: Any) -> None:
        self.admin.create(schedules(self.namespace), a_schedule(**spec))

    @property
    def schedule(self) -> Object:
        return self.admin.get(schedules(self.namespace, "nightly"))

    @property
    def status(self) -> Object:
        found: Object = self.schedule.get("status", {})
        return found

    @property
    def names(self) -> list[str]:
        return sorted(job["metadata"]["name"] for job in self.admin.items(jobs(self.namespace)))

    def on_time(self) -> str:
        found = [c for c in self.status.get("conditions", []) if c["type"] == "OnTime"]
        return str(found[0]["reason"]) if found else ""

    def events(self) -> list[str]:
        found = self.admin.items(f"/api/v1/namespaces/{self.namespace}/events")
        return [e["reason"] for e in found if e["involvedObject"]["kind"] == "SimulationSchedule"]

    def next_run(self) -> datetime:
        return datetime.fromisoformat(self.status["nextScheduleTime"])

    def end(self, name: str, how: str = "Complete") -> None:
        """Says of a job what the job's own part of the operator would say."""
        ended = {
            "type": how,
            "status": "True",
            "reason": "AllCasesRan",
            "message": "It has ended.",
            "lastTransitionTime": "2026-11-20T04:00:00Z",
        }
        status = {"conditions": [ended], "completionTime": "2026-11-20T04:00:00Z"}
        self.admin.merge(jobs(self.namespace, name) + "/status", {"status": status})

    async def until(self, done: Callable[[], object], what: str) -> None:
        """Looks without keeping the operator, which runs in the same loop, from its work."""
        deadline = asyncio.get_running_loop().time() + SECONDS
        while not await asyncio.to_thread(done):
            if asyncio.get_running_loop().time() > deadline:
                shown = json.dumps(self.status, indent=1)
                raise AssertionError(f"{what} after {SECONDS} s: {self.names} {shown}")
            await asyncio.sleep(0.1)

    async def understood(self) -> None:
        await self.until(lambda: "nextScheduleTime" in self.status, "no next run")


@pytest.fixture
def bench(admin: Client, namespace: str) -> Bench:
    return Bench(admin, namespace, datetime.now(UTC))


@pytest.fixture
def operator(
    bench: Bench, installation: Installation, monkeypatch: pytest.MonkeyPatch
) -> Callable[[], Any]:
    """`async with operator():` runs the schedules' part, with the chart's rights."""
    monkeypatch.setenv("KUBECONFIG", str(installation.kubeconfig))

    @asynccontextmanager
    async def running() -> AsyncIterator[None]:
        configuration = Configuration()
        load: Any = config  # its functions carry no types
        await load.load_kube_config(
            config_file=str(installation.kubeconfig), client_configuration=configuration
        )
        async with ApiClient(configuration=configuration) as client:
            view, queue = View(), WorkQueue()
            metrics = JobMetrics(view, queue)
            loop = ScheduleLoop(KubernetesApi(client, 10.0), metrics, now=bench.now)
            registry = loop.register(watch.registry(watch.Watch(view, queue, metrics)))
            stop = asyncio.Event()
            watching = asyncio.create_task(
                kopf.operator(
                    registry=registry, clusterwide=False, namespaces=[bench.namespace],
                    standalone=True, stop_flag=stop,
                )
            )  # fmt: skip
            tasks = loop.start()
            yield
            stop.set()
            for task in tasks:
                task.cancel()
            with suppress(asyncio.CancelledError):
                await asyncio.gather(*tasks, watching, return_exceptions=True)

    return running


async def test_a_job_is_made_at_its_time_and_goes_with_its_schedule(
    bench: Bench, operator: Callable[[], Any]
) -> None:
    bench.create()
    async with operator():
        await bench.understood()
        run = bench.next_run()
        bench.clock = run - timedelta(seconds=1)
        await asyncio.sleep(1.5)  # three rings of the alarm
        assert bench.names == []
        bench.clock = run
        await bench.until(lambda: bench.names, "no job")
        name = f"nightly-{int(run.timestamp()) // 60}"
        await bench.until(lambda: bench.status.get("active") == [name], "the job is not reported")
        await bench.until(lambda: bench.events() == ["JobStarted"], "no event")
    assert bench.names == [name]
    job = bench.admin.get(jobs(bench.namespace, name))
    assert job["metadata"]["labels"] == {"team": "lanes", "sim.bagpipe.io/schedule": "nightly"}
    assert job["spec"]["stack"]["command"] == ["roslaunch", "lane"]
    assert bench.status["lastScheduleTime"] == run.strftime("%Y-%m-%dT%H:%M:%SZ")
    assert bench.next_run() - run in (DAY, DAY + timedelta(hours=1), DAY - timedelta(hours=1))
    bench.admin.delete(schedules(bench.namespace, "nightly"))
    await bench.until(lambda: bench.names == [], "the job outlived its schedule")


async def test_the_published_schedule_makes_its_job_at_half_past_two_in_berlin(
    bench: Bench, operator: Callable[[], Any]
) -> None:
    """docs/examples/schedule as it is, under the name that the bench looks for."""
    manifest = yaml.safe_load(PUBLISHED.read_text())
    manifest["metadata"]["name"] = "nightly"
    bench.admin.create(schedules(bench.namespace), manifest)
    async with operator():
        await bench.understood()
        bench.clock = bench.next_run()
        assert bench.clock.astimezone(ZoneInfo("Europe/Berlin")).strftime("%H:%M") == "02:30"
        await bench.until(lambda: bench.names, "no job")
    job = bench.admin.get(jobs(bench.namespace, bench.names[0]))
    assert job["spec"]["stack"]["engine"] == "exec"
    assert job["spec"]["source"]["files"] == ["pvc://recordings/scenarios/*.json"]


async def test_forbid_waits_and_replace_does_not(bench: Bench, operator: Callable[[], Any]) -> None:
    bench.create(concurrencyPolicy="Forbid")
    async with operator():
        await bench.understood()
        bench.clock = bench.next_run()
        await bench.until(lambda: len(bench.names) == 1, "no job")
        (first,) = bench.names
        await bench.until(lambda: bench.next_run() > bench.clock, "no next run")
        bench.clock = bench.next_run()
        await bench.until(lambda: bench.on_time() == "JobActive", "nobody waits")
        assert bench.names == [first]
        bench.end(first)
        await bench.until(lambda: len(bench.names) == 2, "the run that waited has no job")
        second = bench.names[-1]
        await bench.until(lambda: bench.status["active"] == [second], "it is not reported")
        bench.admin.merge(
            schedules(bench.namespace, "nightly"), {"spec": {"concurrencyPolicy": "Replace"}}
        )
        await bench.until(lambda: bench.status["observedGeneration"] == 2, "no second look")
        bench.clock = bench.next_run()
        await bench.until(lambda: bench.on_time() == "JobReplaced", "it was not replaced")
    assert second not in bench.names
    assert len(bench.names) == 2


async def test_an_operator_that_was_away_makes_up_for_the_latest_run(
    bench: Bench, operator: Callable[[], Any]
) -> None:
    bench.create()
    async with operator():
        await bench.understood()
        bench.clock = bench.next_run()
        await bench.until(lambda: bench.on_time() == "JobStarted", "no job")
    (first,) = bench.names
    bench.clock += 5 * DAY
    async with operator():
        await bench.until(lambda: bench.on_time() == "MissedStart", "no run was made up for")
    assert len(bench.names) == 2
    made = bench.admin.get(jobs(bench.namespace, first))["metadata"]["uid"]
    async with operator():
        await bench.understood()
    assert len(bench.names) == 2
    assert bench.admin.get(jobs(bench.namespace, first))["metadata"]["uid"] == made


async def test_the_history_is_kept_short(bench: Bench, operator: Callable[[], Any]) -> None:
    bench.create(successfulJobsHistoryLimit=1, failedJobsHistoryLimit=1)
    async with operator():
        made: list[str] = []

        def fresh() -> list[str]:
            return sorted(set(bench.names) - set(made))

        await bench.understood()
        for how in ("Complete", "Failed", "Complete", "Failed"):
            await bench.until(lambda: bench.next_run() > bench.clock, "no next run")
            bench.clock = bench.next_run()
            await bench.until(fresh, "no job")
            made += fresh()
            bench.end(made[-1], how)
        await bench.until(lambda: bench.names == made[2:], "the history is too long")
    assert bench.status["lastSuccessfulTime"] == "2026-11-20T04:00:00Z"


def test_the_operator_killed_makes_no_run_twice(
    bench: Bench, operator_process: StartOperator
) -> None:
    """SIGKILL at any moment between the job and its status; here with the status taken back."""
    bench.create(**due_once())
    set_last_run(bench.admin, bench.namespace, "nightly")
    process = operator_process()
    wait_until(lambda: bench.on_time() == "JobStarted", SECONDS, "no job")
    (name,) = bench.names
    uid = bench.admin.get(jobs(bench.namespace, name))["metadata"]["uid"]
    assert process.metric("bagpipe_schedule_jobs_started_total") == 1.0
    process.kill()
    set_last_run(bench.admin, bench.namespace, "nightly")
    process.start()
    last = f"{datetime.fromtimestamp(int(name.split('-')[1]) * 60, UTC):%Y-%m-%dT%H:%M:%SZ}"
    wait_until(lambda: bench.status["lastScheduleTime"] == last, SECONDS, "it was not put right")
    assert process.metric("bagpipe_schedule_jobs_started_total") == 0.0
    assert bench.names == [name]
    assert bench.admin.get(jobs(bench.namespace, name))["metadata"]["uid"] == uid
    driver = f"/api/v1/namespaces/{bench.namespace}/pods/{name}-1-driver"
    wait_until(lambda: bench.admin.exists(driver), SECONDS, "the job was not taken up")


def test_two_operators_make_one_job(bench: Bench, operator_process: StartOperator) -> None:
    operators = [operator_process(), operator_process()]
    for count in range(3):
        start_run(bench.admin, bench.namespace, f"nightly{count}")
    wait_until(lambda: len(bench.names) == 3, SECONDS, "not each has its job")
    # An operator counts a job once the API server has answered, which is after the job is listed.
    wait_until(lambda: jobs_started(operators) >= 3.0, SECONDS, "not each job is counted")
    assert jobs_started(operators) == 3.0
    assert len(bench.names) == 3


def jobs_started(operators: list[OperatorProcess]) -> float:
    name = "bagpipe_schedule_jobs_started_total"
    return sum(operator.metric(name) or 0.0 for operator in operators)


REFUSED: dict[str, tuple[Object, str, str]] = {
    "a long name": ({}, "s" * 32, "metadata.name must have at most 31 characters"),
    "a dotted name": ({}, "lane.1", "write for example lane-nightly"),
    "four fields": ({"schedule": "* * * *"}, "n", "schedule must have cron's five fields"),
    "seconds": ({"schedule": "0 0 2 * * *"}, "n", "without a time zone, seconds or a command"),
    "a zone in it": ({"schedule": "TZ=UTC 0 2 * * *"}, "n", "cron's five fields"),
    "an unknown macro": ({"schedule": "@reboot"}, "n", "cron's five fields"),
    "a path as zone": ({"timeZone": "../etc/passwd"}, "n", "write for example Europe/Berlin"),
    "the node's zone": ({"timeZone": "localtime"}, "n", "write for example Europe/Berlin"),
    "a policy": ({"concurrencyPolicy": "Queue"}, "n", 'supported values: "Allow", "Forbid"'),
    "a short deadline": ({"startingDeadline": "5s"}, "n", "a duration of at least 10s"),
    "no template": ({"jobTemplate": {}}, "n", "spec.jobTemplate.spec: Required value"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_bad_schedule_is_refused_with_what_to_write(
    admin: Client, namespace: str, case: str
) -> None:
    spec, name, sentence = REFUSED[case]
    with pytest.raises(ApiError) as caught:
        admin.create(schedules(namespace), a_schedule(name, **spec))
    assert caught.value.status == 422
    assert sentence in str(caught.value)


def test_a_template_is_refused_as_a_job_would_be_and_may_be_changed(
    admin: Client, namespace: str
) -> None:
    bad = a_schedule("bad")
    bad["spec"]["jobTemplate"]["spec"]["source"]["bags"] = ["pvc://recordings/../drive.bag"]
    with pytest.raises(ApiError, match=r"a bag's path must stay in its volume"):
        admin.create(schedules(namespace), bad)
    made = admin.create(schedules(namespace), a_schedule("good"))
    template = made["spec"]["jobTemplate"]["spec"]
    assert (template["backoffLimit"], template["spark"]["slots"]) == (3, 1)  # defaults too
    change = {"spec": {"jobTemplate": {"spec": {"stack": {"image": "example/lane:2"}}}}}
    changed = admin.merge(schedules(namespace, "good"), change)
    assert changed["spec"]["jobTemplate"]["spec"]["stack"]["image"] == "example/lane:2"
    assert changed["metadata"]["generation"] == 2


@pytest.mark.parametrize(
    ("path", "words"),
    [("spec.timeZone", "IANA time zone database"), ("spec.jobTemplate.spec.stack.remap", "player")],
)
def test_kubectl_explains_a_field(control_plane: ControlPlane, path: str, words: str) -> None:
    shown = subprocess.run(
        [str(Path(binaries()) / "kubectl"), "--kubeconfig", str(control_plane.kubeconfig),
         "explain", f"simschedule.{path}"],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert shown.returncode == 0, shown.stderr
    assert words in shown.stdout
