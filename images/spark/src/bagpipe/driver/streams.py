"""What a driver has from `bagpipe run`: a stdout that no child writes to, its words and its log."""

import fcntl
import json
import os
import sys
from typing import BinaryIO, TextIO


def own_stdout() -> TextIO:
    """Stdout for who calls this alone: what its children write there goes to stderr from now on."""
    stdout = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    return stdout


def awaited(stdin: BinaryIO) -> list[str]:
    """The words of the command line, which come as a line; what is written from now on goes to the
    log that it names.

    The log is locked as long as this process lives, or a child that writes there: who started it
    may be killed, and no other run is to begin where this one may still commit. Raises SystemExit
    where the other side has ended without a line, and where another driver has the log.
    """
    line = stdin.readline()
    if not line:
        sys.exit(0)
    given = json.loads(line)
    log = os.open(given["log"], os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o644)
    nothing = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
    for opened, number in ((nothing, 0), (log, 1), (log, 2)):
        os.dup2(opened, number)
    try:
        fcntl.flock(log, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        sys.exit(f"bagpipe.driver: another driver writes {given['log']}: wait until it has ended")
    os.close(log)
    os.close(nothing)
    return list(given["words"])
