"""The convention of bench results: better is larger, and a target is the least ratio."""

import json
from pathlib import Path

import pytest

from tests.bench import bag, rows
from tests.bench.rows import Row


def test_a_ratio_is_better_when_larger_in_every_unit() -> None:
    speed = Row("1 KB", "write", "msg/s", [4.0, 2.0, 6.0], "rosbag", [1.0, 2.0, 3.0])
    assert speed.ratio == 2.0
    time = Row("plan", "open", "s", [0.1], "the promise", [0.5], target=1.0)
    assert time.ratio == 5.0
    assert not time.missed
    assert Row("1 KB", "write", "msg/s", [1.0], "memcpy", [2.0], target=0.8).missed
    alone = Row("1 KB", "write", "msg/s", [1.0], "rosbag", [], target=10.0)
    assert alone.ratio is None
    assert not alone.missed


def test_results_hold_raw_runs_machine_versions_and_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "RESULTS", tmp_path)
    row = Row("1 KB", "write", "msg/s", [2.5e6, 2.4e6], "rosbag C++, disk", [2e5, 1e5], 10.0)
    path = rows.write("bag", [row], {"rosbags": "0.11"}, "scaled down")
    kept = json.loads(path.read_text())
    assert set(kept) == {"bench", "when", "commit", "machine", "versions", "note", "rows"}
    assert kept["rows"] == [
        {
            "case": "1 KB",
            "metric": "write",
            "unit": "msg/s",
            "ours": [2.5e6, 2.4e6],
            "peer": "rosbag C++, disk",
            "theirs": [2e5, 1e5],
            "ratio": pytest.approx(16.333, abs=0.001),
            "target": 10.0,
        }
    ]
    assert "2.45M msg/s (2.40M-2.50M)" in rows.table([row])


def test_every_comparison_that_was_run_on_both_sides_gives_a_row() -> None:
    runs = {
        ("1 KB", "write", "bagpipe"): [2e6],
        ("1 KB", "write", "memcpy"): [4e6],
        ("plan 5 chunks", "open", "bagpipe"): [0.25],
    }
    units = {("1 KB", "write"): "msg/s", ("plan 5 chunks", "open"): "s"}
    made = bag.rows(runs, units)
    assert [(row.peer, row.ratio) for row in made] == [("memcpy", 0.5), ("the promise: 0.5 s", 2.0)]
