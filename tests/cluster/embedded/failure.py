"""Failures that a user reads: what failed, where, what its log says last, what to do."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

TAIL_LINES = 15


class ClusterError(Exception):
    """Something the cluster needs did not happen; the message is for the user."""


def tail(log: Path, lines: int = TAIL_LINES) -> str:
    """The last lines of a log, indented, or a word that says why there are none."""
    if not log.exists():
        return f"  (no log at {log})"
    text = log.read_text(errors="replace").splitlines()[-lines:]
    return "\n".join("  " + line[:400] for line in text) or "  (its log is empty)"


def wait_until(
    what: str,
    holds: Callable[[], bool],
    *,
    seconds: float,
    log: Path | None = None,
    interval: float = 0.1,
) -> None:
    """Wait until `holds` answers true, or raise ClusterError with the end of `log`."""
    deadline = time.monotonic() + seconds
    pause = threading.Event()
    while not holds():
        if time.monotonic() > deadline:
            lines = f"\nThe last lines of {log}:\n{tail(log)}" if log else ""
            raise ClusterError(f"{what} did not happen within {seconds:.0f} s.{lines}")
        pause.wait(interval)
