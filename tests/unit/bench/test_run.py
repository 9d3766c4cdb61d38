"""`make bench` keeps what a bench measured, also outside of the checkout."""

import os
import subprocess
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


def test_each_bench_finds_what_it_imports() -> None:
    """As `make bench` starts it, where no test has put any folder on the path."""
    modules = [f"tests.bench.{run.MODULES.get(name, name)}" for name in run.benches()]
    program = (
        "import importlib, runpy; "
        f"runpy.run_path({str(run.ROOT / 'tests/bench/run.py')!r}, run_name='bench'); "
        f"[importlib.import_module(module) for module in {modules!r}]"
    )
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd="/", env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
