"""The page and the table of criteria with several bounds."""

import math
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from bagpipe.report.columns import Columns
from bagpipe.report.details import detail_of
from bagpipe.report.table import TableWriter
from tests.unit.bagpipe.jobs import make_row


def finding(distance: float, seconds: float) -> dict[str, Any]:
    figures = [
        {"outcome": "passed", "figure": distance, "unit": "m", "limit": "at least 2 m",
         "direction": "higher", "measures": "0f"},
        {"outcome": "passed", "figure": seconds, "unit": "s", "limit": "at least 1 s",
         "direction": "higher", "measures": "1e"},
    ]  # fmt: skip
    return {"name": "gap", "kind": "separation", "message": "m", "figures": figures} | figures[1]


LATER_KEYS = {"figures", "measures"}
EARLIER = {key: value for key, value in finding(0.0, 3.0).items() if key not in LATER_KEYS}
ROWS = [
    make_row("a", criteria=[finding(6.0, math.inf)]),
    make_row("b", criteria=[finding(7.0, 2.5)]),
    make_row("c", criteria=[EARLIER]),
]


def test_the_page_has_the_spread_of_each_figure() -> None:
    columns = Columns()
    for row in ROWS:
        columns.add(row)
    [criterion] = columns.as_json()["criteria"]
    [time] = criterion.pop("others")
    assert criterion == {
        "name": "gap", "kind": "separation", "outcomes": "PPP", "unit": "m",
        "limit": "at least 2 m", "low": 2.0, "high": None, "figures": [6.0, 7.0, None],
    }  # fmt: skip
    assert time == {
        "unit": "s", "limit": "at least 1 s", "low": 1.0, "high": None, "figures": [None, 2.5, 3.0],
    }  # fmt: skip


def test_units_without_number_leave_the_page_as_small() -> None:
    columns = Columns()
    for number in range(100):
        one = EARLIER | {"figure": 1.0, "unit": f"unit {number}"}
        columns.add(make_row(f"a-{number}", criteria=[one]))
    [criterion] = columns.as_json()["criteria"]
    assert len(criterion["others"]) == 3


def test_a_case_in_full_has_each_figure_and_bound_in_words() -> None:
    found = [detail_of(row)["criteria"][0] for row in ROWS]
    assert [each["limit"] for each in found] == ["at least 2 m; at least 1 s"] * 2 + [
        "at least 1 s"
    ]
    assert [each.get("figures") for each in found] == ["6.0 m; infinite s", "7.0 m; 2.5 s", None]


def test_the_table_has_all_figures(tmp_path: Path) -> None:
    writer = TableWriter(tmp_path / "results.parquet")
    for row in ROWS:
        writer.add(row)
    writer.finish()
    lines = pq.read_table(tmp_path / "results.parquet").to_pylist()
    several, one = lines[1]["criteria"][0], lines[2]["criteria"][0]
    assert (several["figures"], several["measures"]) == (finding(7.0, 2.5)["figures"], "1e")
    assert (one["figures"], one["measures"]) == (None, None)
