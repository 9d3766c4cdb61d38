"""Dashboards and what else follows from the code: up to date, by Grafana's schema, nothing dead."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from grafana_foundation_sdk.cog.encoder import JSONEncoder
from grafana_foundation_sdk.cog.plugins import register_default_plugins
from grafana_foundation_sdk.models.dashboard import Dashboard
from prometheus_client import Metric

from charts.monitoring import generate
from charts.monitoring.alerts import ALERTS
from charts.monitoring.board import Board, as_json
from charts.monitoring.boards import BOARDS
from tests.unit.chart.test_chart import of_kind, rendered

NAMES = re.compile(r"\b(?:bagpipe|spark_executor|process)_[a-z_]+")
FOLDERS = ("charts/bagpipe/files/dashboards", "docs/operations/alerts")
UNITS = {"s", "bytes", "Bps", "percentunit", "short", "ops", "reqps"}


def known() -> set[str]:
    """Every series that the operator, a driver and an agent serve, by the code."""
    ends = {"counter": ["_total"], "histogram": ["_bucket", "_sum", "_count"]}
    return {each.name + end for each in families() for end in ends.get(each.type, [""])}


def families() -> list[Metric]:
    registries = (generate.operator_registry(), generate.driver_registry())
    found = [family for registry in registries for family in registry.collect()]
    return found + generate.agent_families()


def test_what_is_generated_is_up_to_date() -> None:
    """After a change: `python -m charts.monitoring.generate`, and read the diff."""
    files = generate.generated()
    assert {name: (generate.ROOT / name).read_text() for name in files} == files
    there = [path for folder in FOLDERS for path in (generate.ROOT / folder).iterdir()]
    assert {str(path.relative_to(generate.ROOT)) for path in there} <= set(files)


@pytest.mark.parametrize("board", BOARDS, ids=lambda board: board.name)
def test_grafanas_own_library_reads_all_of_it(board: Board) -> None:
    """What its schema does not know would be lost on the way through its types."""
    register_default_plugins()
    written = json.loads(as_json(board))
    read = Dashboard.from_json(written)
    again: Any = json.loads(json.dumps(read, cls=JSONEncoder))
    assert again == written
    titles = [panel["title"] for panel in written["panels"] if panel["type"] != "row"]
    assert titles == [panel.title for panel in board.panels]


def test_the_schema_does_lose_what_it_does_not_know() -> None:
    written = json.loads(as_json(BOARDS[0]))
    written["panels"][1]["fieldConfig"]["defaults"]["unitt"] = "s"
    register_default_plugins()
    assert json.loads(json.dumps(Dashboard.from_json(written), cls=JSONEncoder)) != written


@pytest.mark.parametrize("board", BOARDS, ids=lambda board: board.name)
def test_every_panel_says_what_it_shows_and_in_which_unit(board: Board) -> None:
    for panel in board.panels:
        assert panel.unit in UNITS, panel.title
        assert panel.description.endswith("."), panel.title
        assert panel.queries, panel.title
        assert all(legend for _, legend in panel.queries), panel.title


@pytest.mark.parametrize("board", [board for board in BOARDS if board.name == "nights"])
def test_the_engineers_board_says_what_is_normal(board: Board) -> None:
    shown = json.loads(as_json(board))["panels"]
    written = [panel["description"] for panel in shown if panel["type"] != "row"]
    assert len(written) == 14
    assert [text for text in written if " Normal: " not in text or not text.endswith(".")] == []


@pytest.mark.parametrize("board", BOARDS, ids=lambda board: board.name)
def test_every_link_leads_to_a_board_and_gives_it_what_it_asks(board: Board) -> None:
    written = json.loads(as_json(board))
    uids = {json.loads(as_json(each))["uid"]: each for each in BOARDS}
    addresses = [link["url"] for link in written.get("links") or []]
    for panel in board.panels:
        for _, url in panel.links:
            addresses.append(url)
            labels = re.findall(r"__field\.labels\.(\w+)", url)
            assert labels, panel.title
            # A label that the query does not leave is an empty variable of the other board.
            assert all(label in panel.queries[0][0] for label in labels), panel.title
    for url in addresses:
        path, _, given = url.partition("?")
        assert path.startswith("/d/")
        target = uids[path.removeprefix("/d/")]
        assert set(re.findall(r"&var-(\w+)=", given)) <= set(target.variables), url


def test_the_way_leads_from_the_fleet_to_a_job_and_its_report() -> None:
    leads = {board.name: set(board.leads_to) for board in BOARDS}
    assert {"nights", "job"} <= leads["fleet"]
    assert {"fleet", "job"} <= leads["nights"]
    linked = [panel.title for board in BOARDS for panel in board.panels if panel.links]
    assert linked == ["Jobs that run, by name", "Verdict", "Regressions", "Flakiest", "Slowest"]
    where = "https://r.example.com/<namespace>/<job>/report.html?a=1&b=2"
    objects = rendered("dashboards.enabled=true", f'dashboards.reports="{where}"')
    (held,) = [o for o in of_kind(objects, "ConfigMap") if "bagpipe-job.json" in o["data"]]
    shown = json.loads(held["data"]["bagpipe-job.json"])
    (job,) = [board for board in BOARDS if board.name == "job"]
    *others, report = shown.pop("links")
    plain = json.loads(as_json(job))
    assert others == plain.pop("links")
    assert shown == plain
    assert report["url"] == "https://r.example.com/${namespace}/${job_name}/report.html?a=1&b=2"
    assert {"namespace", "job_name"} == set(job.variables)


def test_nothing_asks_for_a_metric_that_nobody_serves() -> None:
    asked = [e for board in BOARDS for panel in board.panels for e, _ in panel.queries]
    asked += [query for board in BOARDS for query in board.variables.values()]
    asked += [alert.expression for alert in ALERTS]
    names = {name for expression in asked for name in NAMES.findall(expression)}
    assert names - known() == set()


def test_metrics_follow_prometheus_conventions() -> None:
    for family in families():
        assert family.name.startswith(("bagpipe_", "spark_executor_", "process_"))
        assert family.documentation.endswith(".")
        if family.type == "histogram":
            assert family.name.endswith(("_seconds", "_bytes", "_ratio", "_per_second"))


def test_the_chart_carries_them() -> None:
    on = ("dashboards.enabled=true", "alerts.configMap.enabled=true",
          "alerts.prometheusRule.enabled=true")  # fmt: skip
    objects = rendered(*on)
    maps = [o for o in of_kind(objects, "ConfigMap") if "dashboard" in o["metadata"]["name"]]
    held = [json.loads(text) for o in maps for text in o["data"].values()]
    written = [json.loads(as_json(board)) for board in BOARDS]
    assert sorted(held, key=str) == sorted(written, key=str)
    rules = yaml.safe_load(Path(generate.ROOT, "charts/bagpipe/files/alerts.yaml").read_text())
    (rule,) = of_kind(objects, "PrometheusRule")
    assert rule["spec"] == rules
    (plain,) = [
        o for o in of_kind(objects, "ConfigMap") if o["metadata"]["name"].endswith("alerts")
    ]
    assert yaml.safe_load(plain["data"]["bagpipe.rules.yaml"]) == rules
    assert of_kind(rendered(), "ConfigMap") == of_kind(rendered(), "PodMonitor") == []
