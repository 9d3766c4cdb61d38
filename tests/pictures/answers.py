"""What a Prometheus answers to the panels of a dashboard, as Grafana would ask it."""

import math
import re
from collections.abc import Mapping
from typing import Any

from tests.integration.control_plane.prometheus_server import Prometheus

# Seconds between two points of a line.
STEP = 2


def answers(
    prometheus: Prometheus, board: dict[str, Any], variables: Mapping[str, str],
    begun: float, ended: float,
) -> dict[str, Any]:  # fmt: skip
    """Each panel's series by its place in the board, from one moment to another (Unix seconds)."""
    panels = {}
    for place, panel in enumerate(board["panels"]):
        targets = panel.get("targets", [])
        series = [one for t in targets for one in _series(prometheus, t, variables, begun, ended)]
        panels[str(place)] = series
    return {"from": begun * 1e3, "to": ended * 1e3, "panels": panels}


def _series(
    prometheus: Prometheus, target: dict[str, Any], variables: Mapping[str, str],
    begun: float, ended: float,
) -> list[dict[str, Any]]:  # fmt: skip
    expression = target["expr"]
    for name, value in {"__rate_interval": "20s", **variables}.items():
        expression = expression.replace(f"${name}", value)
    if target.get("instant"):
        found = prometheus.get("query", query=expression, time=str(ended))["result"]
        found = [sample | {"values": [sample["value"]]} for sample in found]
    else:
        span = {"start": str(begun), "end": str(ended), "step": str(STEP)}
        found = prometheus.get("query_range", query=expression, **span)["result"]
    return [
        {
            "name": _named(target.get("legendFormat", ""), sample["metric"]),
            "times": [moment * 1e3 for moment, _ in sample["values"]],
            "values": [_number(value) for _, value in sample["values"]],
        }
        for sample in found
    ]


def _named(legend: str, labels: Mapping[str, str]) -> str:
    return re.sub(r"\{\{\s*(\w+)\s*\}\}", lambda found: labels.get(found[1], ""), legend)


def _number(text: str) -> float | None:
    """JSON has no numbers that are none."""
    value = float(text)
    return value if math.isfinite(value) else None
