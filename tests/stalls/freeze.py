"""Freezing a process, or one thread of it, for a while."""

import ctypes
import os
import signal
import time
from collections.abc import Callable

from tests.processes import PROC, below, state

# linux/ptrace.h: a thread that is seized and interrupted stands still until it is let go, and the
# others of its process go on; SIGSTOP would stop all of them.
_SEIZE, _INTERRUPT, _DETACH, _EVENT_STOP = 0x4206, 0x4207, 17, 128
# waitpid(2): a thread is no child, and is waited for all the same.
_WALL = 0x40000000

Sleep = Callable[[float], None]


def freeze_child(pid: int, seconds: float, sleep: Sleep = time.sleep) -> bool:
    """Stop a child whom nobody else stops for a while; whether it was there."""
    if not _signal(pid, signal.SIGSTOP):
        return False
    try:
        sleep(seconds)
    finally:
        _signal(pid, signal.SIGCONT)
    return True


def freeze_process(pid: int, seconds: float, sleep: Sleep = time.sleep) -> bool:
    """Stop a process that is no child for a while; whether it was there.

    Who is stopped by a signal meanwhile stays so: to end a stall by SIGCONT would end that, too.
    """
    return freeze_threads([pid, *threads(pid)], seconds, sleep)


def freeze_threads(these: list[int], seconds: float, sleep: Sleep = time.sleep) -> bool:
    """Stop threads for a while, and no others of their process; whether one stood still.

    None does that has ended, or where the system lets nobody trace (ptrace(2)). The first thread
    of a child must not be among them: to wait for it is to wait for the child, whose status would
    be lost.
    """
    stopped = [(each, at) for each in these if (at := _stop(each)) is not None]
    try:
        if stopped:
            sleep(seconds)
    finally:
        # Of a process that was killed meanwhile the first thread has ended when all others have.
        for thread, its_signal in reversed(stopped):
            if not _ptrace(_DETACH, thread, its_signal):
                os.waitpid(thread, _WALL)
    return bool(stopped)


def descendants(pid: int) -> list[int]:
    """The processes below one that neither have ended nor are stopped."""
    return [each for each in below(pid) if (state(each) or "Z") in "SRD"]


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


def _stop(thread: int) -> int | None:
    """The signal that a thread is to get when it goes on, mostly 0; None where it has ended."""
    if not _ptrace(_SEIZE, thread):
        return None
    _ptrace(_INTERRUPT, thread)
    # It stands still by then or has ended; who has ended and is not waited for keeps its process.
    status = os.waitpid(thread, _WALL)[1]
    if not os.WIFSTOPPED(status):
        return None
    return 0 if status >> 16 == _EVENT_STOP else os.WSTOPSIG(status)


def _ptrace(request: int, thread: int, data: int = 0) -> bool:
    trace = ctypes.CDLL(None).ptrace
    trace.restype = ctypes.c_long
    status: int = trace(*(ctypes.c_long(each) for each in (request, thread, 0, data)))
    return status == 0
