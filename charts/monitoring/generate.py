"""Writes what follows from the code: `python -m charts.monitoring.generate` in the checkout.

The chart's dashboards and rules, the runbook's pages, and the reference of all metrics.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from prometheus_client import CollectorRegistry, Metric
from prometheus_client.parser import text_string_to_metric_families

from bagpipe.driver.metrics import DriverMetrics
from bagpipe.driver.progress import Progress
from bagpipe.spec import JobFile
from bagpipe_operator.jobs.metrics import JobMetrics
from bagpipe_operator.jobs.view import View
from bagpipe_operator.notify.metrics import NotificationMetrics
from bagpipe_operator.runtime.queue import WorkQueue
from bagpipe_operator.schedules.metrics import ScheduleMetrics
from bagpipe_operator.schedules.view import Schedules
from charts.monitoring.alert import RUNBOOKS, rules_file
from charts.monitoring.alerts import ALERTS
from charts.monitoring.board import as_json
from charts.monitoring.boards import BOARDS

ROOT = Path(__file__).parents[2]
FILES = "charts/bagpipe/files"
AGENT_PAGE = "images/agent/crates/agent/metrics.txt"
_UNITS = {
    "per_second": "bytes per second", "seconds": "seconds", "bytes": "bytes", "ratio": "share",
}  # fmt: skip


def generated() -> dict[str, str]:
    """Every file by its path in the checkout."""
    files = {f"{FILES}/dashboards/{board.name}.json": as_json(board) for board in BOARDS}
    files[f"{FILES}/alerts.yaml"] = rules_file(ALERTS)
    files |= {f"{RUNBOOKS}/{alert.name}.md": alert.page() for alert in ALERTS}
    files[f"{RUNBOOKS}/README.md"] = _runbook()
    files["docs/reference/metrics.md"] = _reference()
    return files


def operator_registry() -> CollectorRegistry:
    """The metrics of an operator that has seen nothing yet."""
    metrics = JobMetrics(View(), WorkQueue())
    ScheduleMetrics(Schedules(), metrics.registry)
    NotificationMetrics([], metrics.registry)
    return metrics.registry


def driver_registry() -> CollectorRegistry:
    """The metrics of a driver that has run nothing yet."""
    job = JobFile.model_validate(
        {
            "name": "j", "namespace": "n", "uid": "u", "attempt": 1,
            "images": {"spark": "s", "agent": "a"},
            "spec": {
                "source": {"bags": ["pvc://r/*.bag"], "topics": ["/t"]},
                "stack": {"image": "s", "command": ["c"]},
                "record": {"topics": ["/o"]},
                "output": {"uri": "pvc://r/o"},
            },
        }
    )  # fmt: skip
    return DriverMetrics(Progress("pvc://r/o"), job).registry


def agent_families() -> list[Metric]:
    """The metrics of an agent that has run nothing yet; a test of its own compares its words."""
    return list(text_string_to_metric_families((ROOT / AGENT_PAGE).read_text()))


def _runbook() -> str:
    rows = "\n".join(
        f"| [{alert.name}]({alert.name}.md) | {alert.severity} | {alert.meaning} |"
        for alert in ALERTS
    )
    head = "| alert | severity | meaning |\n|---|---|---|"
    return f"# Alerts\n\nOne page for each rule of the chart.\n\n{head}\n{rows}\n"


def _reference() -> str:
    return (
        "# Metrics\n\nMade from the code by `python -m charts.monitoring.generate`; a test compares"
        " them. How to collect them is in [monitoring](../operations/monitoring.md). Those of"
        " `process_` are of the process itself, as prometheus_client exports them.\n\n"
        "No metric has a label for a job but `bagpipe_job_info`, of which each driver has one, and"
        " `bagpipe_schedule_job_info`, of which each schedule has one.\n"
        f"\n## Operator\n\nPort 8080, `/metrics`.\n\n{_table(_rows(operator_registry()))}"
        "\n## Driver\n\nPort 8080 of the driver's pod, `/metrics`, as long as the job runs. What"
        " the agent measures (pipes, replay, recorder, lock-step) comes with the result of each"
        f" case and is counted here.\n\n{_table(_rows(driver_registry()))}"
        "\n## Agent\n\nPort 9811 of the executors' pods, `/metrics`; the agent beside image n of a"
        " job with several ones has port 9811 + n. What happens now, and since the agent's start."
        f"\n\n{_table((family, _labels_of(family)) for family in agent_families())}"
    )


def _table(rows: Iterable[tuple[Metric, tuple[str, ...]]]) -> str:
    """Families and their labels."""
    lines = ["| metric | type | unit | labels | what it is |", "|---|---|---|---|---|"]
    for family, names in sorted(rows, key=lambda row: row[0].name):
        if family.name.startswith("process_"):
            continue
        labels = ", ".join(f"`{label}`" for label in names) or "-"
        name = f"{family.name}_total" if family.type == "counter" else family.name
        cells = (f"`{name}`", family.type, _unit(family.name), labels, family.documentation)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _rows(registry: CollectorRegistry) -> Iterable[tuple[Metric, tuple[str, ...]]]:
    return [(family, _labels(registry, family)) for family in registry.collect()]


def _labels_of(family: Metric) -> tuple[str, ...]:
    """By its samples, as the agent has each of its series from the beginning."""
    names = {label for sample in family.samples for label in sample.labels} - {"le"}
    return tuple(sorted(names))


def _labels(registry: CollectorRegistry, family: Metric) -> tuple[str, ...]:
    """A family made by a Collector knows its labels; that of a Counter leaves them with it."""
    collector: Any = registry._names_to_collectors.get(family.name)  # noqa: SLF001  no public way
    for owner in (family, collector):
        names = getattr(owner, "_labelnames", None)
        if names is not None:
            return tuple(names)
    return ()


def _unit(name: str) -> str:
    return next((unit for end, unit in _UNITS.items() if name.endswith(f"_{end}")), "count")


def main() -> None:
    """Writes all files, and removes those of dashboards and alerts that are gone."""
    files = generated()
    for folder in (f"{FILES}/dashboards", RUNBOOKS):
        for path in (ROOT / folder).glob("*"):
            if str(path.relative_to(ROOT)) not in files:
                path.unlink()
    for name, text in files.items():
        path = ROOT / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


if __name__ == "__main__":
    main()
