"""Every expression of every panel and alert has data while jobs run, fail and end.

A real Prometheus asks a real operator, a real driver whose cases fail now and then, and a real
agent through which cases of a real node go.
"""

import random
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bagpipe_operator.api import names
from charts.monitoring.alerts import ALERTS
from charts.monitoring.boards import BOARDS, JOB
from charts.monitoring.generate import ROOT
from charts.monitoring.nights import NIGHTS
from tests.integration.conftest import RunningAgent
from tests.integration.control_plane.client import Client, Object, jobs
from tests.integration.control_plane.conftest import StartOperator
from tests.integration.control_plane.due_schedules import start_run
from tests.integration.control_plane.fake_driver import PORT, fake_driver
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.integration.control_plane.observe import await_phase, create_jobs
from tests.integration.control_plane.prometheus_server import Prometheus
from tests.integration.control_plane.questions import all_questions, without_data
from tests.integration.control_plane.server import DIES_WITH_US
from tests.integration.storage.servers import Server, listens
from tests.unit.operator.builders import account
from tests.waiting import PATIENCE, wait_until

# Of this run alone: another one on this machine has these ports as well.
_NETWORK = f"127.83.{random.randint(1, 250)}"  # noqa: S311
DRIVERS = {"drive": f"{_NETWORK}.2", "steps": f"{_NETWORK}.3"}
AGENT = f"{_NETWORK}.4:{names.METRICS_PORT}"
# What has no data in this minute, and why.
EXCUSED = {
    "BagpipeOperatorAbsent": "absent() has a value when there is no operator",
    "Nights, Over the nights: Criteria that fail": "these jobs have no criteria",
    "Nights, Over the nights: Criteria without evidence": "these jobs have no criteria",
    "Operator, Notifications: Time of a try": "these jobs notify nobody",
}
# One that is not there.
RECEIVERS = '[{"name": "team", "url": "http://127.0.0.1:1/"}]'


@pytest.fixture
def drivers(tmp_path: Path, namespace: str) -> Iterator[Server]:
    """The process of both drivers, killed after the test."""
    script = Path(__file__).with_name("driver_with_failures.py")
    named = [f"{name}={address}" for name, address in DRIVERS.items()]
    folder = tmp_path / "drivers"
    folder.mkdir()
    command = [*DIES_WITH_US, sys.executable, str(script), str(folder), namespace, *named]
    server = Server(command, tmp_path / "drivers.log", {"PYTHONPATH": str(ROOT)})
    server.start()
    yield server
    server.kill()


@pytest.fixture
def cases(tmp_path: Path, start_agent: Callable[..., RunningAgent]) -> Iterator[Server]:
    """The process of an agent's worker, killed after the test."""
    agent = start_agent(1, None, "--metrics", AGENT)
    script = ROOT / "tests/integration/agent_cases.py"
    folder = tmp_path / "cases"
    folder.mkdir()
    command = [*DIES_WITH_US, sys.executable, str(script), str(folder), str(agent.shared)]
    server = Server(command, tmp_path / "cases.log", {"PYTHONPATH": str(ROOT)})
    server.start()
    yield server
    server.kill()


@pytest.fixture
def prometheus(
    operator_process: StartOperator, drivers: Server, cases: Server, tmp_path: Path
) -> Iterator[Prometheus]:
    """One that reaches an operator, two drivers and an agent; killed after the test."""
    assert cases.log.exists()
    operator = operator_process(BAGPIPE_NOTIFICATIONS=RECEIVERS)
    drivers.await_ready(lambda: listens(PORT, DRIVERS["steps"]), PATIENCE)
    targets = [f"127.0.0.1:{operator.port}", AGENT, *(f"{ip}:{PORT}" for ip in DRIVERS.values())]
    rules = ROOT / "charts/bagpipe/files/alerts.yaml"
    made = Prometheus.started(tmp_path / "prometheus", targets, rules)
    try:
        wait_until(lambda: made.up() == 4, PATIENCE, "Prometheus does not reach its targets")
        yield made
    finally:
        made.server.kill()


def test_every_panel_and_every_alert_has_data(
    admin: Client, namespace: str, kubelet: FakeKubelet, prometheus: Prometheus, drivers: Server,
    cases: Server,
) -> None:  # fmt: skip
    run_jobs(admin, namespace, kubelet)
    asked = all_questions(namespace, list(DRIVERS))
    assert len(asked) > 100
    left = {name for name, _ in asked} - set(EXCUSED)
    excused: set[str] = set()

    def all_there() -> bool:
        # Seen once is enough: of busy targets each misses another scrape.
        left.intersection_update(without_data(prometheus, [one for one in asked if one[0] in left]))
        excused.clear()
        excused.update(without_data(prometheus, [one for one in asked if one[0] in EXCUSED]))
        return not left and excused == set(EXCUSED)

    try:
        # Spark starts within this, and on a busy machine it takes most of it.
        wait_until(all_there, 4 * PATIENCE, "")
    except AssertionError:
        logs = [process.log.read_text()[-1500:] for process in (drivers, cases)]
        assert (left, excused) == (set(), set(EXCUSED)), f"{sorted(left)}\n{logs}"
    assert_jobs_can_be_chosen(prometheus, namespace)
    assert_rules_are_judged(prometheus)
    assert_failures_are_seen(prometheus)


def run_jobs(admin: Client, namespace: str, kubelet: FakeKubelet) -> None:
    """Two jobs run, one ends well, one fails, and a schedule starts a fifth, which ends well."""
    create_jobs(admin, namespace, [*DRIVERS, "well", "broken"])
    await_phase(admin, namespace, "Pending", 4)
    for name, address in DRIVERS.items():
        kubelet.run(namespace, f"{name}-1-driver", ip=address)
    with fake_driver(account()) as driver:
        for name in ("well", "broken"):
            kubelet.run(namespace, f"{name}-1-driver", ip=driver.ip)
        await_phase(admin, namespace, "Running", 4)
    kubelet.end(namespace, "well-1-driver", 0, account("Complete", verdict="Passed"))
    kubelet.end(namespace, "broken-1-driver", 1, account("Failed", reason="StorageFailed"))
    await_phase(admin, namespace, "Complete", 1)
    await_phase(admin, namespace, "Failed", 1)
    status: Object = admin.get(jobs(namespace, "drive"))["status"]
    assert status["cases"]["planned"] == 10_000
    # Behind the counts of phases, which its job would change.
    start_run(admin, namespace, "nightly")
    await_phase(admin, namespace, "Pending", 1)
    found = [job["metadata"]["name"] for job in admin.items(jobs(namespace))]
    (night,) = [name for name in found if name.startswith("nightly-")]
    kubelet.end(namespace, f"{night}-1-driver", 0, account("Complete", verdict="Passed"))
    await_phase(admin, namespace, "Complete", 2)


def assert_jobs_can_be_chosen(prometheus: Prometheus, namespace: str) -> None:
    """The variables of the boards offer what there is, asked as Grafana asks label_values()."""
    wanted = {"namespace": [namespace], "job_name": sorted(DRIVERS)}
    offered = {}
    for name, query in JOB.variables.items():
        asked = re.fullmatch(r"label_values\((.+), (\w+)\)", query.replace("$namespace", namespace))
        assert asked is not None, query
        selector, label = asked.groups()
        offered[name] = prometheus.get(f"label/{label}/values", **{"match[]": selector})
    assert offered == wanted
    assert [board.title for board in BOARDS if board.variables] == [NIGHTS.title, JOB.title]
    schedules = prometheus.get("label/schedule/values", **{"match[]": "bagpipe_schedule_job_info"})
    assert schedules == ["nightly"]


def assert_rules_are_judged(prometheus: Prometheus) -> None:
    """Prometheus has judged each rule without an error."""

    def health() -> dict[str, str]:
        groups = prometheus.get("rules")["groups"]
        return {rule["name"]: rule["health"] for group in groups for rule in group["rules"]}

    wait_until(lambda: "unknown" not in health().values(), PATIENCE, "not each rule is judged")
    assert sorted(health()) == sorted(alert.name for alert in ALERTS)
    assert set(health().values()) == {"ok"}


def assert_failures_are_seen(prometheus: Prometheus) -> None:
    """What went wrong is in the figures, and only that.

    Asked over a while: a target that is too busy for one scrape has no figure at that moment.
    """
    faults = "sum by (reason) (max_over_time(bagpipe_case_faults_total[10m])) > 0"
    seen = {
        sample["metric"]["reason"] for sample in prometheus.get("query", query=faults)["result"]
    }
    assert seen == {"MachineBusy", "NeverSubscribed", "StackExited"}
    failed = 'max_over_time(bagpipe_jobs_ended_total{phase="Failed",verdict="None"}[10m])'
    # It is asked for once in a second.
    wait_until(lambda: prometheus.values(failed) not in ([], [0]), PATIENCE, "no job has failed")
    assert prometheus.values(failed) == [1]
    errored = 'sum(max_over_time(bagpipe_cases_ended_total{outcome="errored"}[10m]))'
    assert prometheus.values(errored)[0] >= 1
    # It waits for five minutes before it is sent, but is seen at once.
    wait_until(
        lambda: "BagpipeCasesErrored" in seen_alerts(prometheus), PATIENCE, "no alert of crashes"
    )
    wrong = {"BagpipeNoLeader", "BagpipeReconcileFaults", "BagpipeResultsNotKept"}
    # A leader that a busy machine held up for a Lease's time leads again, and the alert goes.
    wait_until(
        lambda: seen_alerts(prometheus).isdisjoint(wrong), PATIENCE, "an alert holds that must not"
    )


def seen_alerts(prometheus: Prometheus) -> set[str]:
    """The alerts that hold, sent already or not."""
    return {alert["labels"]["alertname"] for alert in prometheus.get("alerts")["alerts"]}
