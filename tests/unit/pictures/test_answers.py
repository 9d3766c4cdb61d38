"""What a picture of a dashboard is drawn from."""

import json
from pathlib import Path
from typing import Any, cast

from charts.monitoring.boards import BOARDS
from tests.integration.control_plane.prometheus_server import Prometheus
from tests.pictures.answers import answers

ROOT = Path(__file__).parents[3]


class Answering:
    """A stand-in for a Prometheus: the same two series to all questions, which it notes."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, dict[str, str]]] = []

    def get(self, path: str, **fields: str) -> Any:
        self.asked.append((path, fields))
        labels = [{"node": "a"}, {"other": "b"}]
        if path == "query":
            return {"result": [{"metric": each, "value": [9.0, "NaN"]} for each in labels]}
        points = [[1.0, "0.5"], [3.0, "+Inf"]]
        return {"result": [{"metric": each, "values": points} for each in labels]}


def test_lines_are_asked_for_a_while_and_numbers_for_its_end_and_each_series_has_its_legend() -> (
    None
):
    lines = {"expr": 'rate(x{n="$name"}[$__rate_interval])', "legendFormat": "{{ node }}/{{other}}"}
    number = {"expr": "max(x)", "legendFormat": "most", "instant": True}
    board = {"panels": [{"type": "row"}, {"targets": [lines]}, {"targets": [number]}]}
    prometheus = Answering()
    found = answers(cast("Prometheus", prometheus), board, {"name": "lane"}, 1, 9)
    assert prometheus.asked == [
        ("query_range", {"query": 'rate(x{n="lane"}[20s])', "start": "1", "end": "9", "step": "2"}),
        ("query", {"query": "max(x)", "time": "9"}),
    ]
    points = {"times": [1e3, 3e3], "values": [0.5, None]}
    most = {"name": "most", "times": [9e3], "values": [None]}
    assert found == {
        "from": 1e3,
        "to": 9e3,
        "panels": {
            "0": [],
            "1": [{"name": "a/"} | points, {"name": "/b"} | points],
            "2": [most, most],
        },
    }
    assert "NaN" not in json.dumps(found)


def test_each_dashboard_has_its_picture_in_the_documentation() -> None:
    page = (ROOT / "docs/operations/monitoring.md").read_text()
    for board in BOARDS:
        name = f"dashboard-{board.name}.png"
        assert f"(../pictures/{name})" in page
        assert (ROOT / "docs/pictures" / name).read_bytes()[:4] == b"\x89PNG"
