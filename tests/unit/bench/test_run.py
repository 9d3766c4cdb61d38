"""`make bench` keeps what a bench measured, also outside of the checkout."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.bench import rows, run


@pytest.mark.parametrize("by_loads", [False, True])
def test_results_may_go_to_another_folder(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    by_loads: bool,
) -> None:
    found = [rows.Row("case", "metric", "s", [1.0], "peer", [2.0])]
    load = SimpleNamespace(name="load", rows=found, failure="")
    bench = (
        SimpleNamespace(about=lambda: ({}, "note"), loads=lambda: [load], kept=lambda: True)
        if by_loads
        else SimpleNamespace(measure=lambda: (found, {}, "note"))
    )
    monkeypatch.setitem(sys.modules, "tests.bench.fake", bench)
    monkeypatch.setattr(rows, "RESULTS", tmp_path)
    assert run.run("fake") == run.Outcome(missed=False, failed=False)
    assert (tmp_path / "fake.json").exists()
    assert f" {tmp_path}/fake.json" in capsys.readouterr().out
