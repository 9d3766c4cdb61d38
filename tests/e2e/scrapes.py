"""The documented ways in which a Prometheus finds Bagpipe's pods, as its configuration."""

from typing import Any

from tests.e2e.installation import SYSTEM
from tests.unit.chart.test_chart import of_kind, rendered

_META = "__meta_kubernetes_pod"


def by_annotations(access: str, namespace: str) -> dict[str, Any]:
    """As the documentation of Prometheus shows it; `access` is a kubeconfig."""
    note = f"{_META}_annotation_prometheus_io"
    return {
        "job_name": "annotations", "kubernetes_sd_configs": [_pods(access, SYSTEM, namespace)],
        "relabel_configs": [
            {"action": "keep", "source_labels": [f"{note}_scrape"], "regex": "true"},
            {"source_labels": [f"{note}_path"], "target_label": "__metrics_path__"},
            {"source_labels": [f"{_META}_ip", f"{note}_port"], "separator": ":",
             "target_label": "__address__"},
            {"source_labels": [f"{_META}_label_sim_bagpipe_io_role"], "target_label": "role"},
        ],
    }  # fmt: skip


def by_the_monitors(access: str, namespace: str) -> list[dict[str, Any]]:
    """What a Prometheus operator makes of the chart's PodMonitors, each a job of its name."""
    monitors = of_kind(rendered("metrics.podMonitor.enabled=true"), "PodMonitor")
    return [_by_monitor(each, access, namespace) for each in monitors]


def _by_monitor(monitor: dict[str, Any], access: str, namespace: str) -> dict[str, Any]:
    spec = monitor["spec"]
    (endpoint,) = spec["podMetricsEndpoints"]
    underscored = str.maketrans("./-", "___")
    selected = [
        {"action": "keep", "source_labels": [f"{_META}_label_{name.translate(underscored)}"],
         "regex": value}
        for name, value in spec["selector"]["matchLabels"].items()
    ]  # fmt: skip
    port = [
        {"action": "keep", "source_labels": [f"{_META}_container_port_name"], "regex": name}
        for name in (endpoint.get("port"),) if name
    ]  # fmt: skip
    named = [
        {"source_labels": ["__meta_kubernetes_namespace"], "target_label": "namespace"},
        {"source_labels": [f"{_META}_container_name"], "target_label": "container"},
        {"source_labels": [f"{_META}_name"], "target_label": "pod"},
    ]
    own = [
        {"action": rule["action"], "source_labels": rule["sourceLabels"], "regex": rule["regex"]}
        for rule in endpoint.get("relabelings", [])
    ]
    over = {"action": "drop", "source_labels": [f"{_META}_phase"], "regex": "(Failed|Succeeded)"}
    # Without a selector a monitor is of its own namespace; of any other we look at the run's alone.
    where = namespace if "namespaceSelector" in spec else monitor["metadata"]["namespace"]
    return {
        "job_name": monitor["metadata"]["name"],
        "kubernetes_sd_configs": [_pods(access, where)],
        "metrics_path": endpoint["path"],
        "relabel_configs": [over, *selected, *port, *named, *own],
    }


def _pods(access: str, *namespaces: str) -> dict[str, Any]:
    return {"role": "pod", "kubeconfig_file": access, "namespaces": {"names": list(namespaces)}}
