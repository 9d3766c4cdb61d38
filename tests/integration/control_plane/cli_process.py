"""`bagpipe` as a process of its own, in a terminal or with a pipe, read while it runs."""

import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

SECONDS = 90.0
COLOURS = re.compile(rb"\x1b\[[0-9;?]*[A-Za-z]")


class CliProcess:
    """The program, and all that it has written to stdout and stderr so far.

    A terminal has 100 columns. Leaving the block kills what still runs.
    """

    def __init__(self, kubeconfig: Path, *words: str, terminal: bool = False) -> None:
        self._ours, theirs = pty.openpty() if terminal else os.pipe()
        settings = {"TERM": "xterm-256color", "COLUMNS": "100", "LINES": "30"}
        # As a terminal starts it, even where `nohup` is before the tests' own command.
        started = ["env", "--default-signal=HUP", sys.executable, "-m", "bagpipe.cli", *words]
        self._program = subprocess.Popen(
            started,
            stdin=theirs if terminal else subprocess.DEVNULL,
            stdout=theirs,
            stderr=theirs,
            env={**os.environ, **settings, "KUBECONFIG": str(kubeconfig)},
        )
        os.close(theirs)
        self.written = b""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exception: object) -> None:
        self._program.kill()
        self._program.wait(SECONDS)
        os.close(self._ours)

    def read_until(self, text: str) -> None:
        """Reads on until the text is there; fails after SECONDS."""
        self.read_until_that(text, lambda written: text in written)

    def read_until_that(self, what: str, holds: Callable[[str], bool]) -> None:
        """Reads on until something holds of all that was written; fails after SECONDS."""
        deadline = time.monotonic() + SECONDS
        while not holds(self.plain()):
            assert time.monotonic() < deadline, f"never wrote {what!r}: {self.plain()}"
            assert self._read(), f"ended without {what!r}: {self.plain()}"

    def interrupt(self, number: signal.Signals) -> None:
        """Sends a signal to the program alone."""
        self._program.send_signal(number)

    def end(self, seconds: float = SECONDS) -> int:
        """The exit status, with all that it has written read."""
        deadline = time.monotonic() + seconds
        while self._read():
            assert time.monotonic() < deadline, f"does not end: {self.plain()}"
        return self._program.wait(seconds)

    def signal(self, number: signal.Signals) -> None:
        """Sends the program a signal."""
        self._program.send_signal(number)

    def plain(self) -> str:
        """What was written without colours and what moves the cursor."""
        return COLOURS.sub(b"", self.written).decode(errors="replace")

    def _read(self) -> bool:
        """Reads what is there, waiting a second at most; False at the end."""
        ready, _, _ = select.select([self._ours], [], [], 1.0)
        if not ready:
            return True
        try:
            found = os.read(self._ours, 65536)
        except OSError:  # a terminal without a program
            return False
        self.written += found
        return bool(found)
