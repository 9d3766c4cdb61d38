"""A Docker engine of the tests' own, with its own folders, that touches no firewall of the machine.

It lives in a mount namespace of its own: what an engine leaves mounted ends with it. Nodes are
linked by a bridge of the machine, and nothing is forwarded between it and the world.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from embedded.failure import ClusterError
from embedded.places import cache

RUNTIME = Path(__file__).with_name("bounded.py")
BEGIN_SECONDS, ANSWER_SECONDS, END_SECONDS = 60.0, 10.0, 60.0


def folder() -> Path:
    return cache() / "docker"


def environment() -> dict[str, str]:
    """What a client needs to talk to the engine, without a configuration of the user's."""
    own = {"DOCKER_HOST": f"unix://{folder()}/docker.sock", "DOCKER_CONFIG": f"{folder()}/client"}
    # Debian's client has BuildKit in it; another one first on PATH may want a plugin for it.
    return {**os.environ, **own, "PATH": f"/usr/bin:{os.environ['PATH']}"}


def command() -> list[str]:
    root = folder()
    own = ["--data-root", f"{root}/data", "--exec-root", f"{root}/run", "-p", f"{root}/docker.pid"]
    runtime = ["--add-runtime", f"bounded={RUNTIME}", "--default-runtime", "bounded"]
    network = ["--bridge=none", "--iptables=false", "--ip6tables=false", "--ip-forward=false"]
    daemon = ["dockerd", "-H", f"unix://{root}/docker.sock", "--config-file", f"{root}/none.json"]
    # Lowering its own score of the OOM killer needs CAP_SYS_RESOURCE.
    return ["unshare", "--mount", *daemon, *own, *runtime, *network, "--oom-score-adjust=0"]


def answers() -> bool:
    asked = ["docker", "version", "--format", "{{.Server.Version}}"]
    try:
        done = subprocess.run(
            asked, env=environment(), capture_output=True, check=False, timeout=ANSWER_SECONDS
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


@contextmanager
def running() -> Iterator[Path]:
    """The engine, from its first answer until the end of the block; yields its log."""
    if not shutil.which("dockerd"):
        raise ClusterError("There is no dockerd: `make test-kind` gets it from Debian.")
    root, log = folder(), folder() / "dockerd.log"
    (root / "client").mkdir(parents=True, exist_ok=True)
    (root / "none.json").write_text("{}")
    with log.open("w") as file:
        daemon = subprocess.Popen(command(), stdout=file, stderr=file, start_new_session=True)
    try:
        deadline = time.monotonic() + BEGIN_SECONDS
        while not answers():
            if daemon.poll() is not None or time.monotonic() > deadline:
                last = "\n".join(log.read_text().splitlines()[-5:])
                raise ClusterError(f"dockerd does not answer. Its last lines:\n{last}\nLog: {log}")
            time.sleep(0.2)
        yield log
    finally:
        end(daemon)


def end(daemon: subprocess.Popen[bytes]) -> None:
    """End the engine; it ends its containers itself."""
    daemon.send_signal(signal.SIGTERM)
    try:
        daemon.wait(END_SECONDS)
    except subprocess.TimeoutExpired:
        os.killpg(daemon.pid, signal.SIGKILL)
        daemon.wait()
