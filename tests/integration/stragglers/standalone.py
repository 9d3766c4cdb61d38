"""A Spark of two hosts on this machine: Spark puts no copy of a task onto the host that has it."""

import os
import re
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pyspark

from bagpipe.driver.spark_context import QUICK_JVM

_SPARK = Path(pyspark.__file__).parent
_DEPLOY = "org.apache.spark.deploy"
_START_SECONDS = 180
HOSTS = ("127.0.0.2", "127.0.0.3")
_REGISTERING = r"Registering worker (127\.0\.0\.\d+)"


@contextmanager
def two_hosts(folder: Path, slots: int) -> Iterator[str]:
    """The URL of a master with a worker of `slots` cores on each of two addresses of loopback."""
    with ExitStack() as stack:
        master = stack.enter_context(
            _daemon(folder, "master.Master", "--host", "127.0.0.1", "--port", "0")
        )
        url = _await(master, lambda text: re.search(r"spark://127\.0\.0\.1:\d+", text))
        for host in HOSTS:
            resources = ("--cores", str(slots), "--memory", "2g", "--work-dir", str(folder / host))
            stack.enter_context(_daemon(folder, "worker.Worker", "--host", host, *resources, url))
        # A worker whose registration took long asks for it again.
        _await(master, lambda text: set(HOSTS) <= set(re.findall(_REGISTERING, text)) or "")
        yield url


@contextmanager
def _daemon(folder: Path, name: str, *arguments: str) -> Iterator[Path]:
    """One of Spark's daemons and all that it starts, ended with the block; gives its log."""
    log = folder / f"{name}-{len(list(folder.iterdir()))}.log"
    environment = os.environ | {
        "SPARK_DAEMON_MEMORY": "256m",
        "SPARK_DAEMON_JAVA_OPTS": f"-Dspark.master.rest.enabled=false -XX:+UseSerialGC {QUICK_JVM}",
        "SPARK_HOME": str(_SPARK),
    }
    command = [str(_SPARK / "bin/spark-class"), f"{_DEPLOY}.{name}", "--webui-port", "0"]
    with log.open("wb") as output:
        daemon = subprocess.Popen(
            [*command, *arguments], stdout=output, stderr=subprocess.STDOUT, env=environment
        )
    try:
        yield log
    finally:
        daemon.terminate()
        daemon.wait(timeout=90)


def _await(log: Path, look: Callable[[str], object]) -> str:
    """Wait until a log says something; gives what was found as text."""
    deadline = time.monotonic() + _START_SECONDS
    pause = threading.Event()
    while not (found := look(log.read_text())):
        assert time.monotonic() < deadline, log.read_text()
        pause.wait(0.1)
    return found[0] if isinstance(found, re.Match) else str(found)
