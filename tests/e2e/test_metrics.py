"""A Prometheus on the cluster finds all pods in both documented ways, and sees what happens.

By the pods' annotations, as plain configurations do, and by the ports' names, as the chart's
PodMonitors have a Prometheus operator do.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from embedded import builds

from charts.monitoring.alerts import ALERTS
from charts.monitoring.generate import ROOT
from tests.e2e import failing_jobs, fleet, jobs, scrapes
from tests.e2e import kubectl as k
from tests.e2e.storage_servers import NODE
from tests.integration.control_plane.prometheus_server import Prometheus
from tests.integration.control_plane.questions import all_questions, without_data
from tests.recording import MESSAGES

pytestmark = [
    pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(1200),
    pytest.mark.usefixtures("recordings"),
]  # fmt: skip

_PORT = 21990  # below those that connections take by themselves
# What has no data while jobs run and fail on one healthy node, and why.
EXCUSED = {
    "BagpipeOperatorAbsent": "absent() has a value when there is no operator",
}
START = Callable[[list[dict[str, Any]]], Prometheus]


@pytest.fixture
def access(tmp_path: Path) -> str:
    """A kubeconfig with all that it needs in one file."""
    settings = yaml.safe_load(k.kubectl("config", "view", "--raw"))
    path = tmp_path / "access.yaml"
    path.write_text(yaml.safe_dump(settings))
    return str(path)


@pytest.fixture
def start_prometheus(tmp_path: Path) -> Iterator[START]:
    """Starts one in the network of the cluster's first node."""
    with ExitStack() as running:

        def start(found: list[dict[str, Any]]) -> Prometheus:
            rules = ROOT / "charts/bagpipe/files/alerts.yaml"
            # Debian's is built without Kubernetes' discovery.
            program = str(builds.ensure(builds.PROMETHEUS) / "prometheus")
            folder = tmp_path / "prometheus"
            made = Prometheus.configured(folder, found, rules, NODE, _PORT, program)
            running.callback(made.server.kill)
            return made

        yield start


@contextmanager
def scheduled(namespace: str) -> Iterator[None]:
    """A schedule has started a job of one short case, which has ended well."""
    job = fleet.make_job("each-minute")
    job["spec"]["source"] = {"files": [f"pvc://recordings/{fleet.FOLDER}/000.bin"]}
    job["spec"]["spark"] |= {"executors": 1, "slots": 1}
    template = {"metadata": {"labels": {"by": "the-clock"}}, "spec": job["spec"]}
    spec = {"schedule": "* * * * *", "jobTemplate": template, "successfulJobsHistoryLimit": 9}
    jobs.apply(namespace, job | {"kind": "SimulationSchedule", "spec": spec})
    schedule = ("simschedule", "each-minute")
    try:
        made = k.await_that(
            "a minute's job", lambda: k.items(namespace, "simjob", "-l", "by=the-clock"), 90
        )
        rest = ("--type=merge", "-p", '{"spec":{"suspend":true}}')
        k.kubectl("-n", namespace, "patch", *schedule, *rest)
        ended = jobs.ended(namespace, made[0]["metadata"]["name"], 240)
        assert ended["status"]["verdict"] == "Passed"
        yield
    finally:
        k.kubectl("-n", namespace, "delete", *schedule, "--wait=true", "--timeout=60s")


def awaited(prometheus: Prometheus, expression: str, seconds: float) -> list[float]:
    """The numbers of an expression, once there are any."""

    def look() -> list[float]:
        return prometheus.values(expression)

    return k.await_that(expression, look, seconds)


def test_all_pods_are_found_and_executors_report_what_happens_now(
    namespace: str, access: str, start_prometheus: START
) -> None:
    ways = [scrapes.by_annotations(access, namespace), *scrapes.by_the_monitors(access, namespace)]
    prometheus = start_prometheus(ways)
    job = failing_jobs.watched()
    agent = 'job="bagpipe-operator-executors"'
    with jobs.applied(namespace, job) as name:
        for target in ('job="annotations",role="driver"', 'job="bagpipe-operator-drivers"',
                       'job="annotations",role="executor"', agent,
                       'job="annotations",role=""', 'job="bagpipe-operator"'):  # fmt: skip
            assert awaited(prometheus, f"up{{{target}}} == 1", 120) == [1]
        half = f"bagpipe_agent_played_messages_total{{{agent}}} > 100"
        (played,) = awaited(prometheus, half, 60)
        assert played < MESSAGES
        assert prometheus.values(f"bagpipe_agent_slots_busy{{{agent}}}") == [1]
        # Spark's own figures of the executor, reported by the driver: 1 is its first executor.
        for figure in ("active_tasks", "tasks_max", "jvm_heap_peak_bytes"):
            awaited(prometheus, f'spark_executor_{figure}{{executor="1"}}', 30)
        ended = jobs.ended(namespace, name, 400)
        assert ended["status"]["verdict"] == "Passed"
        assert ended["status"]["ledger"]["sent"] == MESSAGES
        counted = 'max_over_time(bagpipe_agent_played_messages_total{job="annotations"}[5m])'
        assert played < prometheus.values(counted)[0] <= MESSAGES


def test_every_panel_and_every_alert_has_data_while_jobs_fail(
    namespace: str, access: str, start_prometheus: START
) -> None:
    fleet.put_files(namespace)
    prometheus = start_prometheus(scrapes.by_the_monitors(access, namespace))
    # One after the other: on a small machine drivers that start together take minutes.
    with scheduled(namespace), ExitStack() as existing:
        lost = existing.enter_context(jobs.applied(namespace, failing_jobs.given_up()))
        take_executors(namespace, prometheus, lost, 4)
        ended = jobs.ended(namespace, lost, 240)
        assert jobs.condition(ended, "Failed")["reason"] == "ExecutorLost"
        run = []
        for job in (failing_jobs.paced(), failing_jobs.stepped()):
            run.append(existing.enter_context(jobs.applied(namespace, job)))
            await_ended_cases(namespace, run[-1])
        asked = all_questions(namespace, run)
        assert len(asked) > 100
        await_data(prometheus, asked)
        assert_failures_are_seen(prometheus)
    assert_rules_are_judged(prometheus)


def await_ended_cases(namespace: str, name: str) -> None:
    """Some cases of the job have passed, and it is far from its end."""

    def look() -> bool:
        status = k.get(namespace, "simjob", name).get("status", {})
        return bool(status.get("cases", {}).get("passed", 0) >= 2)

    k.await_that(f"the first cases of {name}", look, 240)


def take_executors(namespace: str, prometheus: Prometheus, job: str, times: int) -> None:
    """Delete the job's only executor as often, each while a case runs in it."""
    agents = f'bagpipe_agent_slots_busy{{pod=~"{job}-.*"}} == 1'
    seen: set[str] = set()

    def another() -> str | None:
        busy = prometheus.get("query", query=agents)["result"]
        return next((s["metric"]["pod"] for s in busy if s["metric"]["pod"] not in seen), None)

    for _ in range(times):
        pod = k.await_that("an executor with a case", another, 240)
        seen.add(pod)
        k.kubectl("-n", namespace, "delete", "pod", pod, "--grace-period=1", "--wait=true")


def await_data(prometheus: Prometheus, asked: list[tuple[str, str]]) -> None:
    """All of it has an answer at one moment but what is excused."""
    left: set[str] = set()

    def look() -> bool:
        left.clear()
        left.update(without_data(prometheus, asked))
        return left == set(EXCUSED)

    try:
        k.await_that("every panel to have data", look, 180)
    except TimeoutError:
        assert left == set(EXCUSED)


def assert_failures_are_seen(prometheus: Prometheus) -> None:
    """What went wrong is in the figures, a job's that has ended too."""
    faults = "sum by (reason) (max_over_time(bagpipe_case_faults_total[10m])) > 0"
    wanted = {*failing_jobs.REASONS.values(), "ExecutorLost"}

    def seen() -> bool:
        found = prometheus.get("query", query=faults)["result"]
        return wanted <= {sample["metric"]["reason"] for sample in found}

    k.await_that(f"faults of all of {wanted}", seen, 120)
    assert prometheus.values('sum(bagpipe_cases_ended_total{outcome="failed"})')[0] >= 1
    awaited(prometheus, 'bagpipe_jobs_ended_total{phase="Failed",verdict="None"} > 0', 30)
    awaited(prometheus, 'bagpipe_jobs_ended_total{phase="Complete",verdict="Passed"} > 0', 120)
    firing = {alert["labels"]["alertname"] for alert in prometheus.get("alerts")["alerts"]}
    assert "BagpipeCasesErrored" in firing
    wrong = {"BagpipeNoLeader", "BagpipeReconcileFaults", "BagpipeResultsNotKept"}
    assert firing.isdisjoint(wrong | set(EXCUSED))


def assert_rules_are_judged(prometheus: Prometheus) -> None:
    """Prometheus has judged each rule without an error."""
    groups = prometheus.get("rules")["groups"]
    health = {rule["name"]: rule["health"] for group in groups for rule in group["rules"]}
    assert health == dict.fromkeys((alert.name for alert in ALERTS), "ok")
