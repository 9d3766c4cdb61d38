"""What a driver has from `bagpipe run`: a stdout that no child writes to, its words and its log."""

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

    Raises SystemExit where the other side has ended without a line.
    """
    line = stdin.readline()
    if not line:
        sys.exit(0)
    given = json.loads(line)
    log = os.open(given["log"], os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o644)
    nothing = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
    for opened, number in ((nothing, 0), (log, 1), (log, 2)):
        os.dup2(opened, number)
    os.close(log)
    os.close(nothing)
    return list(given["words"])
