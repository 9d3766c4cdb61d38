"""`bagpipe bisect`: each status is one that `git bisect run` reads as it is meant."""

import fnmatch
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from bagpipe.cli import bisect as module
from bagpipe.cli.__main__ import main
from bagpipe.cli.running import RunError, RunInterruptedError, RunTooLongError

SPEC = {
    "source": {"files": ["pvc://recordings/*.bin"]},
    "stack": {"image": "i", "command": ["true"], "engine": "exec"},
    "output": {"uri": "pvc://results/out"},
    "baseline": {"results": "pvc://results/earlier"},
    "quarantine": [{"cases": "*", "reason": "x", "until": "2026-12-31"}],
    "maxFailedCases": 0,
}


def step(folder: Path, *words: str, spec: Any = SPEC) -> tuple[int, str]:
    job = {
        "apiVersion": "sim.bagpipe.io/v1alpha1",
        "kind": "SimulationJob",
        "metadata": {"name": "lane"},
        "spec": spec,
    }
    (folder / "job.yaml").write_text(yaml.safe_dump(job))
    given = ["bisect", str(folder / "job.yaml"), "--results", str(folder / "kept"), *words]
    ended = CliRunner().invoke(main, given)
    return ended.exit_code, ended.output


def ran(monkeypatch: pytest.MonkeyPatch, *rounds: Any) -> list[Any]:
    """Each round's outcome, or what is raised; gives the jobs and wishes that were run."""
    asked: list[Any] = []

    def run_spec(_name: str, spec: Any, _marks: Any, wanted: Any, seconds: float) -> Any:
        found = rounds[len(asked)]
        asked.append((spec, wanted, seconds))
        if isinstance(found, BaseException):
            raise found
        case = {"case": "a-0", "outcome": found, "reason": "", "message": ""}
        return {"cases": [case], "counts": {"planned": 1}}

    monkeypatch.setattr(module, "run_spec", run_spec)
    return asked


@pytest.mark.parametrize(
    ("found", "status"),
    [
        ("passed", 0),
        ("failed", 1),
        ("invalid", 125),
        ("errored", 125),
        (RunError("there is no bagpipe-agent on this machine"), 125),
        (RunTooLongError("not ended within 1 s"), 125),
        (ZeroDivisionError("a fault of ours"), 125),
        (RunInterruptedError("interrupted"), 130),
        (KeyboardInterrupt(), 130),
    ],
)
def test_the_status_is_git_s(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, found: Any, status: int
) -> None:
    ran(monkeypatch, found)
    assert step(tmp_path, "--case", "a-0")[0] == status


@pytest.mark.parametrize(
    "words", [[], ["--cas", "a"], ["--case", "a", "--rounds", "0"], ["--case", "a", "b"]]
)
def test_a_mistake_in_the_command_line_stops_git(tmp_path: Path, words: list[str]) -> None:
    status, text = step(tmp_path, *words)
    assert (status, "Usage:" in text) == (129, True)


@pytest.mark.parametrize("words", [["job.yaml", "--case", "a"], []])
def test_where_nobody_reads_its_words_the_status_is_the_same(words: list[str]) -> None:
    """1 would name the commit a bad one."""
    command = [sys.executable, "-m", "bagpipe.cli", "bisect", *words]
    reading, writing = os.pipe()
    os.close(reading)
    with Path("/dev/full").open("wb") as full, os.fdopen(writing, "wb") as broken:
        ended = [
            subprocess.run(command, stdout=broken, stderr=each, timeout=60, check=False).returncode
            for each in (full, broken)
        ]
    assert ended == [125 if words else 129] * 2


def test_a_run_whose_words_nobody_reads_is_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran(monkeypatch, SystemExit(1))
    assert step(tmp_path, "--case", "a-0")[0] == 125


def test_a_number_is_a_name_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = ran(monkeypatch, "passed")
    status, _ = step(tmp_path, "--case", "17")
    assert (status, asked[0][1].cases) == (125, ("[1]7",))
    assert fnmatch.filter(["17", "1", "7"], "[1]7") == ["17"]


def test_a_job_that_is_refused_here_is_passed_over(tmp_path: Path) -> None:
    status, text = step(tmp_path, "--case", "a", spec=SPEC | {"playback": {"rate": 0}})
    assert status == 125
    assert "could not be run: " in text
    assert "spec.playback.rate" in text
    ended = CliRunner().invoke(main, ["bisect", str(tmp_path / "gone.yaml"), "--case", "a"])
    assert (ended.exit_code, "can't be read" in ended.output) == (125, True)


def test_the_job_runs_without_what_speaks_of_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = ran(monkeypatch, "passed", "passed")
    assert step(tmp_path, "--case", "a-*", "--rounds", "2", "--timeout", "90s")[0] == 0
    (spec, wanted, seconds), (_, second, _) = asked
    assert (spec.baseline, spec.quarantine, spec.max_failed_cases) == (None, [], None)
    assert (wanted.cases, wanted.replace, seconds) == (("a-*",), True, 90.0)
    assert (wanted.results.name, second.results.name) == ("round-0", "round-1")
    assert wanted.results.parent.parent == tmp_path / "kept"


def test_rounds_that_disagree_end_early_and_are_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = ran(monkeypatch, "passed", "failed", "passed")
    status, text = step(tmp_path, "--case", "a-0", "--rounds", "3")
    assert (status, len(asked)) == (125, 2)
    assert "1 of 2 rounds passed: it flakes here" in text


def test_all_rounds_are_run_before_a_commit_is_good(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = ran(monkeypatch, "passed", "passed", "failed")
    assert step(tmp_path, "--case", "a-0", "--rounds", "3")[0] == 125
    assert len(asked) == 3
