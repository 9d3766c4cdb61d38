"""Processes of this machine that do not outlive who started them."""

import ctypes
import fcntl
import os
import select
import signal

_PR_SET_PDEATHSIG = 1


def die_with_parent() -> None:
    """In a new process: SIGTERM comes when its parent is gone, however that one ended."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def die_when_closed(pipe: int) -> None:
    """In a new process: SIGTERM comes when nobody has the writing end of a pipe any more.

    So a process ends with one that is not its parent, as where a server has forked it: `pipe` is
    the reading end, into which nothing is written, and it stays open. By a signal, since a thread
    that reads would wait for native code.
    """
    fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGTERM)
    fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    before = select.poll()
    before.register(pipe, 0)
    if before.poll(0):
        os.kill(os.getpid(), signal.SIGTERM)
