import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from tests.processes import state
from tests.stalls.freeze import descendants, freeze_child, freeze_process, freeze_threads, threads
from tests.waiting import PATIENCE, wait_until

# One thread beside its first, which is known by then; it ends with its standard input.
TWO_THREADS = """
import sys, threading
threading.Thread(target=threading.Event().wait, daemon=True).start()
print("ready", flush=True)
sys.stdin.read()
"""
# A process with a child of its own, which ends with it.
PARENT = """
import os, subprocess, sys
wait = "threading.Thread(target=threading.Event().wait, daemon=True).start()"
code = f"import threading; {wait}; input()"
child = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE)
while len(os.listdir(f"/proc/{child.pid}/task")) < 2:
    pass
print(child.pid, flush=True)
sys.stdin.read()
"""


@pytest.fixture
def started() -> Iterator[list[subprocess.Popen[str]]]:
    """Processes that end with the test."""
    all_of_them: list[subprocess.Popen[str]] = []
    yield all_of_them
    for each in all_of_them:
        each.communicate(timeout=30)


def start(started: list[subprocess.Popen[str]], program: str) -> tuple[int, str]:
    """Its number, and the first line that it wrote."""
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    started.append(process)
    assert process.stdout
    return process.pid, process.stdout.readline().strip()


def states(pid: int) -> set[str | None]:
    return {state(pid, each) for each in [pid, *threads(pid)]}


def await_rest(pid: int) -> None:
    wait_until(lambda: states(pid) == {"S"}, PATIENCE, lambda: f"S, in place of {states(pid)}")


def test_a_child_is_stopped_for_so_long_and_goes_on(started: list[subprocess.Popen[str]]) -> None:
    pid, _ = start(started, TWO_THREADS)
    asked = []

    def sleep(seconds: float) -> None:
        asked.append(seconds)
        # T is stopped (proc_pid_stat(5)); each thread comes to it when it gets a processor.
        wait_until(lambda: states(pid) == {"T"}, PATIENCE, lambda: f"T, in place of {states(pid)}")

    assert freeze_child(pid, 0.25, sleep)
    assert asked == [0.25]
    await_rest(pid)


def test_a_child_goes_on_though_the_pause_fails(started: list[subprocess.Popen[str]]) -> None:
    pid, _ = start(started, TWO_THREADS)

    def sleep(_: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        freeze_child(pid, 0.25, sleep)
    await_rest(pid)


def test_all_threads_of_a_process_are_stopped_and_go_on(
    started: list[subprocess.Popen[str]],
) -> None:
    _, child = start(started, PARENT)
    seen = []

    def sleep(seconds: float) -> None:
        seen.append((seconds, states(int(child))))

    assert freeze_process(int(child), 0.25, sleep)
    # t is stopped by who traces it, which has waited for that.
    assert seen == [(0.25, {"t"})]
    await_rest(int(child))


def test_who_is_stopped_by_a_signal_during_a_stall_stays_so(
    started: list[subprocess.Popen[str]],
) -> None:
    _, child = start(started, PARENT)
    assert freeze_process(int(child), 0.25, lambda _: os.kill(int(child), signal.SIGSTOP))
    wait_until(lambda: states(int(child)) == {"T"}, PATIENCE, "a child that is still stopped")
    os.kill(int(child), signal.SIGCONT)
    await_rest(int(child))


def test_a_process_that_is_killed_during_a_stall_is_let_go(
    started: list[subprocess.Popen[str]],
) -> None:
    _, child = start(started, PARENT)
    assert freeze_process(int(child), 0.25, lambda _: os.kill(int(child), signal.SIGKILL))
    # Its parent has not asked how it ended.
    wait_until(lambda: states(int(child)) == {"Z"}, PATIENCE, "a child that has ended")


def test_one_thread_is_stopped_and_the_others_of_its_process_go_on(
    started: list[subprocess.Popen[str]],
) -> None:
    pid, _ = start(started, TWO_THREADS)
    (second,) = threads(pid)
    seen = []

    def sleep(seconds: float) -> None:
        # t is stopped by who traces it, which has waited for that.
        assert state(pid, second) == "t"
        wait_until(lambda: state(pid, pid) == "S", PATIENCE, "the first thread at its read")
        seen.append(seconds)

    assert freeze_threads([second], 0.25, sleep)
    # Nobody traces it any more: the next one can.
    assert freeze_threads([second], 0.5, sleep)
    assert seen == [0.25, 0.5]
    wait_until(lambda: state(pid, second) == "S", PATIENCE, "the second thread at its wait")


def test_a_process_that_is_killed_while_a_thread_of_it_stands_still_can_be_waited_for(
    started: list[subprocess.Popen[str]],
) -> None:
    pid, _ = start(started, TWO_THREADS)
    (second,) = threads(pid)
    assert freeze_threads([second], 0.25, lambda _: started[0].kill())
    assert started[0].wait(PATIENCE) == -signal.SIGKILL


def test_who_has_ended_is_not_stopped() -> None:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait(30)
    calls: list[float] = []
    assert not freeze_child(process.pid, 0.25, calls.append)
    assert not freeze_threads([process.pid], 0.25, calls.append)
    assert calls == []
    assert (threads(process.pid), descendants(process.pid)) == ([], [])


def test_processes_below_one_are_found_at_any_depth_and_stopped_ones_are_not(
    started: list[subprocess.Popen[str]],
) -> None:
    pid, child = start(started, PARENT)
    assert descendants(pid) == [int(child)]
    mine = subprocess.Popen(["/bin/cat"], stdin=subprocess.PIPE, text=True)
    started.append(mine)
    here = descendants(threading.main_thread().native_id or 0)
    assert {pid, int(child), mine.pid} <= set(here)
    assert here.index(pid) < here.index(int(child))

    def sleep(_: float) -> None:
        wait_until(lambda: not descendants(pid), PATIENCE, "nobody that runs")

    assert freeze_process(int(child), 0.25, sleep)
