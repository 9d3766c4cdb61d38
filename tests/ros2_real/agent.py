"""An agent where ROS 2 is, as its container has it."""

import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bagpipe.run.master_ports import master_ports
from tests.integration.conftest import RunningAgent
from tests.ros2_real.place import Place

# Reached in failure only.
_PATIENCE_SECONDS = 90


@contextmanager
def agent(
    place: Place, prefix: Path, binary: Path, folder: Path, slots: int = 1
) -> Iterator[RunningAgent]:
    """One that serves so many slots below a new folder of `folder`, with the nodes of `prefix`."""
    shared = folder / f"shared{len(list(folder.glob('shared*')))}"
    shared.mkdir()
    log = shared.with_suffix(".log")
    with master_ports(slots) as port, log.open("wb") as output:
        words = [str(binary), "serve", "--shared", str(shared), "--slots", str(slots)]
        words += ["--master-port", str(port)]
        process = subprocess.Popen(
            place.command(words, prefix, [folder, binary.parent]),
            stdout=output,
            stderr=subprocess.STDOUT,
            env=place.environment() | {"TMPDIR": str(folder)},
            start_new_session=True,
        )
        try:
            _await_ready(binary, shared, process, log)
            yield RunningAgent(shared, process, log)
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(timeout=_PATIENCE_SECONDS)


def _await_ready(binary: Path, shared: Path, process: subprocess.Popen[bytes], log: Path) -> None:
    deadline = time.monotonic() + _PATIENCE_SECONDS
    pause = threading.Event()
    while subprocess.run([binary, "ready", "--shared", shared], check=False).returncode:
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < deadline, log.read_text()
        pause.wait(0.05)
