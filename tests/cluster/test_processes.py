"""A pid that the kernel gave to a stranger is never signalled."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from embedded import processes
from embedded.failure import ClusterError, tail, wait_until
from embedded.processes import Process


@pytest.fixture
def sleeper() -> Iterator[subprocess.Popen[bytes]]:
    child = subprocess.Popen(["sleep", "600"])
    yield child
    child.kill()
    child.wait(timeout=60)


@pytest.fixture
def pids(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(processes, "PIDS", tmp_path)
    return tmp_path


def test_reads_the_start_time_behind_a_name_with_brackets() -> None:
    fields = ["S", *map(str, range(4, 22)), "777", "0"]
    assert processes.parse_stat(f"42 (a) (b c) {' '.join(fields)}") == ("running", 777)


def test_a_process_that_awaits_its_parent_is_dead() -> None:
    fields = ["Z", *map(str, range(4, 22)), "777", "0"]
    assert processes.parse_stat(f"42 (etcd) {' '.join(fields)}") == ("dead", 777)


def test_remembers_a_process_across_programs(sleeper: subprocess.Popen[bytes], pids: Path) -> None:
    kept = processes.remember("sleeper", sleeper.pid)
    assert processes.recall("sleeper") == kept
    assert kept.alive
    assert [p.name for p in pids.iterdir()] == ["sleeper"]


@pytest.mark.usefixtures("pids")
def test_stop_ends_the_process_and_its_pid_file(sleeper: subprocess.Popen[bytes]) -> None:
    kept = processes.remember("sleeper", sleeper.pid)
    processes.stop(["sleeper"])
    assert not kept.alive
    assert processes.names() == []
    assert sleeper.wait(timeout=60) == -signal.SIGTERM


@pytest.mark.parametrize("change", [{"started": 1}, {"boot": "another"}])
def test_never_signals_a_stranger(
    sleeper: subprocess.Popen[bytes], pids: Path, change: dict[str, object]
) -> None:
    kept = processes.remember("sleeper", sleeper.pid)
    stranger = dataclasses.replace(kept, **change)  # type: ignore[arg-type]
    assert not stranger.alive
    stranger.send(signal.SIGKILL)
    assert kept.alive
    assert pids.is_dir()


def test_a_broken_pid_file_is_no_process(pids: Path) -> None:
    (pids / "etcd").write_text('{"pid": 12')
    assert processes.recall("etcd") is None
    assert processes.recall("never-started") is None


def test_a_pid_that_is_gone_is_not_alive() -> None:
    assert not Process(pid=2**22 + 1, started=0, boot=processes.boot()).alive


def test_a_wait_that_fails_ends_with_the_log(tmp_path: Path) -> None:
    log = tmp_path / "etcd.log"
    log.write_text("".join(f"line {n}\n" for n in range(100)))
    with pytest.raises(ClusterError) as failed:
        wait_until("etcd becoming ready", lambda: False, seconds=0.05, log=log)
    lines = str(failed.value).splitlines()
    assert lines[0].startswith("etcd becoming ready did not happen within 0 s")
    assert lines[-1] == "  line 99"
    assert len([line for line in lines if line.startswith("  line")]) == 15


def test_a_log_that_is_missing_is_reported(tmp_path: Path) -> None:
    assert tail(tmp_path / "none.log") == f"  (no log at {tmp_path / 'none.log'})"


def test_this_process_is_alive() -> None:
    found = processes.stat_of(os.getpid())
    assert found is not None
    assert found[0] == "running"
