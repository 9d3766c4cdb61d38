"""The demonstration ends with one case in real time, which decides nothing."""

import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.e2e import demo, first_verdict


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[list[str]]:
    """The commands in place of which nothing runs; each ends as one that failed."""
    commands: list[list[str]] = []

    def run(command: list[str], **_given: Any) -> "subprocess.CompletedProcess[bytes]":
        commands.append(command)
        return subprocess.CompletedProcess(command, 1)

    (tmp_path / "bag").write_bytes(b"bag")
    monkeypatch.setenv("BAGPIPE_CACHE", str(tmp_path))
    monkeypatch.setattr(first_verdict, "fetch", lambda: tmp_path / "bag")
    monkeypatch.setattr(subprocess, "run", run)
    return commands


def test_it_is_the_first_case_of_the_examples_job_in_real_time(
    called: list[list[str]], tmp_path: Path
) -> None:
    demo._show_real_time()
    (command,) = called
    assert command[1:5] == [
        "run", "docs/examples/robot-state-publisher/realtime.yaml", "--cases", "1",
    ]  # fmt: skip
    assert "mode: realtime" in (first_verdict.ROOT / command[2]).read_text()
    assert f"recordings={tmp_path}/demo/laptop/recordings" in command
    played = tmp_path / "demo/laptop/recordings/pr2/joint_states.bag"
    assert played.read_bytes() == b"bag"


def test_without_an_answer_the_demonstration_goes_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*_given: str | Path) -> int:
        raise subprocess.TimeoutExpired("bagpipe", 300)

    monkeypatch.setattr(first_verdict, "run", run)
    demo._show_real_time()
    assert "There is no play in real time to show: Command 'bagpipe' timed out" in (
        capsys.readouterr().out
    )
