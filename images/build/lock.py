"""A lock between processes, also of several checkouts that share the cache."""

from __future__ import annotations

import contextlib
import fcntl
import threading
import time
from collections.abc import Iterator
from pathlib import Path

LOCK_SECONDS = 2400.0


class LockError(Exception):
    """Another process has held the lock for too long."""


@contextlib.contextmanager
def locked(path: Path, seconds: float = LOCK_SECONDS) -> Iterator[None]:
    """Hold the lock file at `path`; the kernel ends the lock with the process.

    Raises LockError when another process has not given it back after `seconds`.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    deadline = time.monotonic() + seconds
    with path.open("w") as file:
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError as held:
                if time.monotonic() > deadline:
                    raise LockError(f"Another build has held {path} for too long.") from held
                threading.Event().wait(0.2)
        yield
