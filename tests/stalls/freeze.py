"""Freezing a process, or one thread of it, for a while."""

import ctypes
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

PROC = Path("/proc")
# linux/ptrace.h: a thread that is seized and interrupted stands still until it is let go, and the
# others of its process go on; SIGSTOP would stop all of them.
_SEIZE, _INTERRUPT, _DETACH = 0x4206, 0x4207, 17
# waitpid(2): a thread is no child, and is waited for all the same.
_WALL = 0x40000000

Sleep = Callable[[float], None]


def freeze_process(pid: int, seconds: float, sleep: Sleep = time.sleep) -> bool:
    """Stop a process for a while; whether it was there."""
    if not _signal(pid, signal.SIGSTOP):
        return False
    try:
        sleep(seconds)
    finally:
        _signal(pid, signal.SIGCONT)
    return True


def freeze_thread(thread: int, seconds: float, sleep: Sleep = time.sleep) -> bool:
    """Stop one thread of a process of ours for a while; whether that was possible.

    It is not where the thread has ended, or where the system lets nobody trace (ptrace(2)). The
    first thread of a child must not be asked for: to wait for it is to wait for the child, whose
    status would be lost.
    """
    if not _ptrace(_SEIZE, thread):
        return False
    _ptrace(_INTERRUPT, thread)
    # It stands still by then or has ended; who has ended and is not waited for keeps its process.
    if not os.WIFSTOPPED(os.waitpid(thread, _WALL)[1]):
        return False
    try:
        sleep(seconds)
    finally:
        if not _ptrace(_DETACH, thread):
            os.waitpid(thread, _WALL)
    return True


def descendants(pid: int) -> list[int]:
    """The processes below one that neither have ended nor are stopped, nearest first."""
    below: dict[int, list[int]] = {}
    for each in PROC.iterdir():
        if each.name.isdigit() and (found := _state_and_parent(each)) and found[0] in "SRD":
            below.setdefault(found[1], []).append(int(each.name))
    found_all = [pid]
    for one in found_all:
        found_all += sorted(below.get(one, []))
    return found_all[1:]


def threads(pid: int) -> list[int]:
    """The threads of a process beside its first; none where it has ended."""
    try:
        found = {int(each.name) for each in (PROC / str(pid) / "task").iterdir()}
    except OSError:
        return []
    return sorted(found - {pid})


def _signal(pid: int, number: int) -> bool:
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return False
    return True


def _state_and_parent(folder: Path) -> tuple[str, int] | None:
    try:
        # The name of a program, in brackets, may have blanks and brackets.
        words = (folder / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return words[0], int(words[1])


def _ptrace(request: int, thread: int) -> bool:
    trace = ctypes.CDLL(None).ptrace
    trace.restype = ctypes.c_long
    status: int = trace(*(ctypes.c_long(each) for each in (request, thread, 0, 0)))
    return status == 0
