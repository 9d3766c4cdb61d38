"""The convention of bench results: better is larger, and a target is the least ratio."""

import json
import subprocess
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


def test_rows_of_other_loads_stay_with_their_own_date_and_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "RESULTS", tmp_path)
    monkeypatch.setattr(rows, "commit", lambda: "first")
    burst = Row("burst", "status age", "s", [6.0], "the promise", [5.0], 1.0)
    rows.merge("operator", [burst, Row("cycles", "left", "objects", [0.0], "", [])], {}, "")
    monkeypatch.setattr(rows, "commit", lambda: "second")
    again = Row("burst", "status age", "s", [4.0], "the promise", [5.0], 1.0)
    full = Row("full", "cold start", "s", [9.0], "the promise", [15.0], 1.0)
    path = rows.merge("operator", [full, again], {"kopf": "1.45.2"}, "read this")
    kept = json.loads(path.read_text())
    assert (kept["commit"], kept["versions"], kept["note"]) == (
        "second", {"kopf": "1.45.2"}, "read this",
    )  # fmt: skip
    assert [(row["case"], row["ours"], row["commit"]) for row in kept["rows"]] == [
        ("burst", [4.0], "second"),
        ("cycles", [0.0], "first"),
        ("full", [9.0], "second"),
    ]
    assert all(row["when"].endswith("+00:00") for row in kept["rows"])


def test_rows_of_before_get_the_date_of_their_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "RESULTS", tmp_path)
    rows.write("operator", [Row("old", "age", "s", [1.0], "", [])], {}, "")
    written = json.loads((tmp_path / "operator.json").read_text())
    rows.merge("operator", [], {}, "")
    (row,) = json.loads((tmp_path / "operator.json").read_text())["rows"]
    assert (row["when"], row["commit"]) == (written["when"], written["commit"])


def test_every_comparison_that_was_run_on_both_sides_gives_a_row() -> None:
    runs = {
        ("1 KB", "write", "bagpipe"): [2e6],
        ("1 KB", "write", "memcpy"): [4e6],
        ("plan 5 chunks", "open", "bagpipe"): [0.25],
    }
    units = {("1 KB", "write"): "msg/s", ("plan 5 chunks", "open"): "s"}
    made = bag.rows(runs, units)
    assert [(row.peer, row.ratio) for row in made] == [("memcpy", 0.5), ("the promise: 0.5 s", 2.0)]


def test_a_recording_that_is_not_here_is_left_out_with_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    there, missing = tmp_path / "there.bag", tmp_path / "missing.bag"
    there.touch()
    commands: list[object] = []

    def run(command: list[object], *, check: bool) -> None:
        commands.append((command, check))

    monkeypatch.setattr(subprocess, "run", run)
    monkeypatch.setattr(
        bag,
        "RECORDINGS",
        {"Luminar, lz4": (missing, there), "PR2 joint states, bz2": (missing,)},
    )
    listed = bag.list_bags(Path("ours"), tmp_path, "0.5")
    assert commands == [([Path("ours"), "--scale", "0.5", "shapes", tmp_path], True)]
    assert listed.read_text().splitlines() == [
        f"KITTI, 3 s\t{tmp_path}/kitti.bag",
        f"Udacity, 3 s\t{tmp_path}/udacity.bag",
        f"Autoware campus, 1.5 s, lz4\t{tmp_path}/autoware.bag",
        f"Luminar, lz4\t{there}",
    ]
    output = capsys.readouterr().err
    assert output == (
        "    left out: PR2 joint states, bz2, which is not here; "
        "`python -m tests.recording` fetches it\n"
    )


def test_lz4_is_wanted_twice_as_fast_in_every_shape() -> None:
    targets = {
        case: [target for *_, target in bag.COMPARISONS[case] if target]
        for case in ("KITTI, 3 s", "Autoware campus, 1.5 s, lz4", "Jackal, bz2", "Luminar, lz4")
    }
    assert targets == {
        "KITTI, 3 s": [],
        "Autoware campus, 1.5 s, lz4": [2.0, 2.0, 2.0],
        "Jackal, bz2": [],
        "Luminar, lz4": [2.0, 2.0, 2.0],
    }
