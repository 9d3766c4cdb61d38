"""A process that ends with who holds a pipe."""

import os
import signal
import subprocess
import sys

import pytest

from tests.waiting import PATIENCE

PROGRAM = """
import sys, time
from bagpipe.run.with_parent import die_when_closed
sys.stdin.readline() if sys.argv[2] == "late" else None
die_when_closed(int(sys.argv[1]))
print("it is watched", flush=True)
time.sleep(3600)
"""


@pytest.mark.parametrize("when", ["soon", "late"])
def test_it_ends_when_the_pipe_is_closed_and_where_it_was_already(when: str) -> None:
    ours, held = os.pipe()
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(ours), when],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, pass_fds=[ours],
    )  # fmt: skip
    os.close(ours)
    with process:
        try:
            assert process.stdin is not None
            assert process.stdout is not None
            if when == "soon":
                assert process.stdout.readline() == b"it is watched\n"
                assert process.poll() is None
            os.close(held)
            process.stdin.close()
            assert process.wait(PATIENCE) == -signal.SIGTERM
        finally:
            process.kill()
