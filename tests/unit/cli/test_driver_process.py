"""The driver's process of `bagpipe run`, started before and after it is known what for."""

import fcntl
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import pytest
from click.testing import CliRunner

from bagpipe.cli import driver_process
from bagpipe.cli.__main__ import main
from tests.waiting import PATIENCE, wait_until

# Writes its words to stdout, and to stderr what belongs into the log.
PROGRAM = (
    "import sys\n"
    "from bagpipe.driver.streams import awaited, own_stdout\n"
    "out = own_stdout()\n"
    "words = awaited(sys.stdin.buffer)\n"
    "print(*words, file=out, flush=True)\n"
    "print('a child', flush=True)\n"
    "print('in the log', sys.stdin.read() == '', file=sys.stderr, flush=True)\n"
)


Waiting = tuple[driver_process.Process, BinaryIO]


@pytest.fixture(autouse=True)
def waiting(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Waiting]]:
    """Those that wait, of which none is left."""
    found: list[Waiting] = []
    monkeypatch.setattr(driver_process, "_PROGRAM", [sys.executable, "-c", PROGRAM])
    monkeypatch.setattr(driver_process, "_waiting", found)
    yield found
    for process, early in found:
        process.kill()
        process.communicate()
        early.close()


def words_and_log(tmp_path: Path) -> tuple[str, str]:
    log = tmp_path / "driver.log"
    log.write_text("of an earlier run")
    with driver_process.driver(["--slots", "2"], log, PATIENCE) as process:
        assert process.stdout is not None
        words = process.stdout.read().decode()
    assert process.returncode == 0
    return words, log.read_text()


@pytest.mark.parametrize("early", [True, False])
def test_a_driver_has_its_words_and_its_log_whenever_it_was_started(
    tmp_path: Path, waiting: list[Waiting], early: bool
) -> None:
    if early:
        driver_process.begin()
        driver_process.begin()
        assert len(waiting) == 1
    assert words_and_log(tmp_path) == ("--slots 2\n", "a child\nin the log True\n")
    assert waiting == []


def test_one_that_has_died_meanwhile_is_replaced(tmp_path: Path, waiting: list[Waiting]) -> None:
    driver_process.begin()
    waiting[0][0].kill()
    waiting[0][0].wait()
    assert words_and_log(tmp_path) == ("--slots 2\n", "a child\nin the log True\n")


def test_no_two_drivers_write_one_log(tmp_path: Path) -> None:
    log = tmp_path / "driver.log"
    with log.open("ab") as others:
        fcntl.flock(others, fcntl.LOCK_SH)
        with driver_process.driver([], log, PATIENCE) as process:
            assert process.stdout is not None
            assert process.stdout.read() == b""
        assert (process.returncode, "another driver writes" in log.read_text()) == (1, True)
    assert words_and_log(tmp_path)[0] == "--slots 2\n"


def test_one_that_ends_before_its_words_come_is_reported_by_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver_process, "_PROGRAM", [sys.executable, "-c", "raise LookupError"])
    log = tmp_path / "driver.log"
    with driver_process.driver(["x" * 100_000], log, PATIENCE) as process:
        assert process.stdout is not None
        assert process.stdout.read() == b""
    assert (process.returncode, log.read_text().splitlines()[-1]) == (1, "LookupError")


@pytest.mark.parametrize("early", [True, False])
def test_the_log_has_why_it_could_not_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, early: bool
) -> None:
    """A full disk, as the server of the slots' processes meets it, before it has its words."""
    program = "import sys; sys.stdin.buffer.peek(); raise OSError('No space left on device')"
    monkeypatch.setattr(driver_process, "_PROGRAM", [sys.executable, "-c", program])
    if early:
        driver_process.begin()
    log = tmp_path / "driver.log"
    with driver_process.driver([], log, PATIENCE) as process:
        assert process.stdout is not None
        assert process.stdout.read() == b""
    assert log.read_text().splitlines()[-1] == "OSError: No space left on device"


def test_one_that_waits_ends_with_who_started_it() -> None:
    program = (
        "from bagpipe.cli import driver_process\n"
        "driver_process.begin()\n"
        "print(driver_process._waiting[0][0].pid, flush=True)\n"
        "import os, signal; os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == -signal.SIGKILL

    def is_gone() -> bool:
        try:
            os.kill(int(done.stdout), 0)
        except ProcessLookupError:
            return True
        return False

    wait_until(is_gone, PATIENCE, "the end of the driver")


def lives(pid: int) -> bool:
    """Whether it runs; one that has ended may wait to be asked for its status."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_nothing_of_its_group_is_left_after_the_block(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = (
        "import subprocess, sys\n"
        "from bagpipe.driver.streams import awaited, own_stdout\n"
        "out = own_stdout()\n"
        "awaited(sys.stdin.buffer)\n"
        "print(subprocess.Popen(['sleep', '600']).pid, file=out, flush=True)\n"
    )
    monkeypatch.setattr(driver_process, "_PROGRAM", [sys.executable, "-c", program])
    with driver_process.driver([], tmp_path / "driver.log", PATIENCE) as process:
        assert process.stdout is not None
        child = int(process.stdout.readline())
    wait_until(lambda: not lives(child), PATIENCE, "the end of the driver's child")


def test_one_that_has_its_words_ends_with_who_started_it(tmp_path: Path) -> None:
    driver = (
        "import sys, time\n"
        "from bagpipe.driver.streams import awaited, own_stdout\n"
        "out = own_stdout()\n"
        "awaited(sys.stdin.buffer)\n"
        "print('works', file=out, flush=True)\n"
        "time.sleep(600)\n"
    )
    program = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from bagpipe.cli import driver_process\n"
        f"driver_process._PROGRAM = [sys.executable, '-c', {driver!r}]\n"
        f"with driver_process.driver([], Path({str(tmp_path)!r}, 'driver.log'), 60) as process:\n"
        "    process.stdout.readline()\n"
        "    print(process.pid, flush=True)\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    pid = int(done.stdout)
    try:
        wait_until(lambda: not lives(pid), PATIENCE, "the end of the driver")
    finally:
        if lives(pid):
            os.kill(pid, signal.SIGKILL)


# SIGTERM comes in a callback, which takes for itself what the handler raises, as imports have some.
IN_A_CALLBACK = (
    "import os, runpy, signal\n"
    "from bagpipe.driver import slot_server\n"
    "class Gone:\n"
    "    def __del__(self):\n"
    "        os.kill(os.getpid(), signal.SIGTERM)\n"
    "slot_server.start = lambda: (Gone(), None)[1]\n"
    "runpy.run_module('bagpipe.driver.local', run_name='__main__')\n"
)


def test_one_that_is_ended_while_it_imports_ends(
    monkeypatch: pytest.MonkeyPatch, waiting: list[Waiting]
) -> None:
    monkeypatch.setattr(driver_process, "_PROGRAM", [sys.executable, "-c", IN_A_CALLBACK])
    driver_process.begin()
    assert waiting[0][0].wait(PATIENCE) == 128 + signal.SIGTERM


@pytest.mark.parametrize(
    ("words", "begun"),
    [(["run", "--help"], 0), (["run"], 0), (["list"], 0), (["run", "no.yaml"], 1)],
)
def test_none_is_started_for_help_or_another_verb(
    waiting: list[Waiting], words: list[str], begun: int
) -> None:
    CliRunner().invoke(main, words)
    assert len(waiting) == begun


def test_tab_starts_none(waiting: list[Waiting]) -> None:
    verb = main.commands["run"]
    verb.make_context("run", ["job.yaml"], resilient_parsing=True)
    assert waiting == []


def test_one_that_waits_in_vain_leaves_no_file_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, waiting: list[Waiting]
) -> None:
    """The server of the slots' processes has a folder with a socket by then."""
    monkeypatch.setattr(driver_process, "_PROGRAM", [sys.executable, "-m", "bagpipe.driver.local"])
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    driver_process.begin()
    wait_until(lambda: any(tmp_path.glob("pymp-*/*")), PATIENCE, "the server's socket")
    waiting[0][0].terminate()
    assert waiting[0][0].wait(PATIENCE) == 128 + signal.SIGTERM
    assert list(tmp_path.iterdir()) == []
