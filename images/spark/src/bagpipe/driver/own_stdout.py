"""A stdout that no child writes to."""

import os
import sys
from typing import TextIO


def own_stdout() -> TextIO:
    """Stdout for who calls this alone: what its children write there goes to stderr from now on."""
    stdout = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    return stdout
