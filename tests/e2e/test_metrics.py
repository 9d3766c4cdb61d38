"""A Prometheus on the cluster finds drivers and executors in both documented ways, and sees a job.

By the pods' annotations, as plain configurations do, and by the ports' names, as the chart's
PodMonitors have a Prometheus operator do.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from embedded import builds

from charts.monitoring.boards import DATA_PLANE
from charts.monitoring.generate import ROOT
from tests.e2e import jobs
from tests.e2e import kubectl as k
from tests.e2e.storage_servers import NODE
from tests.integration.control_plane.prometheus_server import Prometheus
from tests.recording import MESSAGES
from tests.unit.chart.test_chart import of_kind, rendered

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.usefixtures("recordings")]

_META = "__meta_kubernetes_pod"
_PORT = 21990  # below those that connections take by themselves
_ROLE = {"source_labels": [f"{_META}_label_sim_bagpipe_io_role"], "target_label": "role"}
_LOCKSTEP = "of lock-step, and this job plays in real time"
EXCUSED = {"Each wait in lock-step": _LOCKSTEP}


def by_annotations(pods: dict[str, Any]) -> dict[str, Any]:
    """As the documentation of Prometheus shows it."""
    note = f"{_META}_annotation_prometheus_io"
    return {
        "job_name": "annotations", "kubernetes_sd_configs": [pods],
        "relabel_configs": [
            {"action": "keep", "source_labels": [f"{note}_scrape"], "regex": "true"},
            {"source_labels": [f"{note}_path"], "target_label": "__metrics_path__"},
            {"source_labels": [f"{_META}_ip", f"{note}_port"], "separator": ":",
             "target_label": "__address__"},
            _ROLE,
        ],
    }  # fmt: skip


def by_the_monitor(pods: dict[str, Any]) -> dict[str, Any]:
    """What a Prometheus operator makes of the chart's PodMonitor of executors."""
    monitors = of_kind(rendered("metrics.podMonitor.enabled=true"), "PodMonitor")
    spec = next(m for m in monitors if m["metadata"]["name"].endswith("executors"))["spec"]
    (endpoint,) = spec["podMetricsEndpoints"]
    underscored = str.maketrans("./-", "___")
    labels = [
        {"action": "keep", "source_labels": [f"{_META}_label_{name.translate(underscored)}"],
         "regex": value}
        for name, value in spec["selector"]["matchLabels"].items()
    ]  # fmt: skip
    own = [
        {"action": rule["action"], "source_labels": rule["sourceLabels"], "regex": rule["regex"]}
        for rule in endpoint["relabelings"]
    ]
    return {
        "job_name": "monitor", "kubernetes_sd_configs": [pods],
        "metrics_path": endpoint["path"], "relabel_configs": [*labels, *own, _ROLE],
    }  # fmt: skip


@pytest.fixture
def prometheus(namespace: str, tmp_path: Path) -> Iterator[Prometheus]:
    """One in the network of the cluster's first node, for the run's own namespace."""
    settings = yaml.safe_load(k.kubectl("config", "view", "--raw"))
    access = tmp_path / "access.yaml"
    access.write_text(yaml.safe_dump(settings))
    pods = {
        "role": "pod", "kubeconfig_file": str(access), "namespaces": {"names": [namespace]},
    }  # fmt: skip
    scrapes = [by_annotations(pods), by_the_monitor(pods)]
    rules = ROOT / "charts/bagpipe/files/alerts.yaml"
    # Debian's is built without Kubernetes' discovery.
    program = str(builds.ensure(builds.PROMETHEUS) / "prometheus")
    made = Prometheus.configured(tmp_path / "prometheus", scrapes, rules, NODE, _PORT, program)
    yield made
    made.server.kill()


def awaited(prometheus: Prometheus, expression: str, seconds: float) -> list[float]:
    """The numbers of an expression, once there are any."""

    def look() -> list[float]:
        return prometheus.values(expression)

    return k.await_that(expression, look, seconds)


def test_executors_and_drivers_are_found_and_tell_what_happens_now(
    namespace: str, prometheus: Prometheus
) -> None:
    job = jobs.make_job("watched", playback={"mode": "realtime", "rate": 0.5})
    ways = 'up{role="%s", job="%s"} == 1'
    panels = {p.title: p for p in DATA_PLANE.rows["Now, by the agents in the executors"]}
    with jobs.applied(namespace, job) as name:
        for role, way in (("driver", "annotations"), ("executor", "annotations"),
                          ("executor", "monitor")):  # fmt: skip
            assert awaited(prometheus, ways % (role, way), 120) == [1]
        half = 'bagpipe_agent_played_messages_total{job="monitor"} > 100'
        (played,) = awaited(prometheus, half, 60)
        assert played < MESSAGES
        assert prometheus.values('bagpipe_agent_slots_busy{job="monitor"}') == [1]
        assert_panels_have_data(prometheus, panels)
        # Spark's own figures of the executor, told by the driver: 1 is its first executor.
        for figure in ("active_tasks", "tasks_max", "jvm_heap_peak_bytes"):
            awaited(prometheus, f'spark_executor_{figure}{{executor="1"}}', 30)
        ended = jobs.ended(namespace, name, 120)
        assert ended["status"]["verdict"] == "Passed"
        assert ended["status"]["ledger"]["sent"] == MESSAGES
        counted = 'max_over_time(bagpipe_agent_played_messages_total{job="annotations"}[5m])'
        # On a busy machine a stack with a short queue is played to again.
        _, (row,) = k.results(namespace, ended["status"]["results"])
        assert played < prometheus.values(counted)[0] <= MESSAGES * row["attempts"]


def assert_panels_have_data(prometheus: Prometheus, panels: dict[str, Any]) -> None:
    """The dashboard's row of what happens now."""

    def without() -> set[str]:
        return {
            title for title, panel in panels.items() for expression, _ in panel.queries
            if not prometheus.values(expression.replace("$__rate_interval", "20s"))
        }  # fmt: skip

    k.await_that("panels without data", lambda: without() <= set(EXCUSED), 20)
