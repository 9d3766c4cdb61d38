"""The driver's process of `bagpipe run`, which may be started before it is known what it is for.

It imports what a driver needs while this program imports what the command needs: each takes some
0.3 s. It is light itself, as it is imported before all of that.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, BinaryIO

from bagpipe.run.with_parent import die_with_parent

Process = subprocess.Popen[bytes]

_PROGRAM = [sys.executable, "-m", "bagpipe.driver.local"]
# Of what a driver writes before it knows its log, as where it can't start.
_MOST_EARLY_BYTES = 64 << 10
# The one that waits for its words, if any, and what it writes until then.
_waiting: list[tuple[Process, BinaryIO]] = []


def begin() -> None:
    """Start a driver that waits, unless one does; it ends with this process."""
    with contextlib.suppress(OSError):  # `driver` meets it too
        if not _waiting:
            # Of memory: a full disk may be what it has to report.
            early = os.fdopen(os.memfd_create("driver"), "rb")
            _waiting.append((_started(early), early))


@contextlib.contextmanager
def driver(words: Sequence[str], log: Path, seconds: float) -> Iterator[Process]:
    """The driver of these words, in a process group of its own, of which nothing is left after the
    block. What it writes beside its progress goes to `log`.

    After the block it has so many `seconds` to end.
    """
    with log.open("wb") as errors:
        process, early = _waiting.pop() if _waiting else (None, None)
        if process is None or process.poll() is not None:
            process = _started(errors)
    try:
        _send(process, words, log)
        yield process
        # It has closed its stdout, which it does last, or was killed.
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=seconds)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        if process.stdout is not None:
            process.stdout.close()
        if early is not None:
            _add_early(early, log)


def _add_early(early: BinaryIO, log: Path) -> None:
    """Has a log that a driver never wrote to say why."""
    with early, contextlib.suppress(OSError), log.open("ab") as file:
        if os.fstat(file.fileno()).st_size == 0:
            early.seek(0)
            file.write(early.read(_MOST_EARLY_BYTES))


def _send(process: Process, words: Sequence[str], log: Path) -> None:
    stream = process.stdin
    assert stream is not None  # noqa: S101  it is a pipe
    # One that has died has its end reported by who waits for it.
    with contextlib.suppress(BrokenPipeError), stream:
        stream.write(json.dumps({"words": list(words), "log": str(log.resolve())}).encode() + b"\n")


def _started(errors: int | IO[bytes]) -> Process:
    return subprocess.Popen(
        _PROGRAM,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=errors,
        start_new_session=True,
        preexec_fn=die_with_parent,  # noqa: PLW1509  one system call, before any thread
    )
