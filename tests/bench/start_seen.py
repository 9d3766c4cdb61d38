"""What is seen of a job's start: its objects as the API server sends them, and lines of its logs.

All moments are seconds since 1970: those of objects are when this process got them, those of lines
when the container runtime did.
"""

import json
import re
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from typing import Any

from tests.e2e import kubectl as k

Json = dict[str, Any]
# Of the driver's log: what it writes of a moment, and the moment's name.
LINES = {
    "planned": re.compile(r"\d+ cases planned"),
    "Spark's JVM asked for": re.compile(r"Spark settings: "),
}
_END_SECONDS = 20


class Moments(dict[str, float]):
    """When each thing was first seen."""

    def __init__(self) -> None:
        super().__init__()
        self._lock = threading.Lock()

    def note(self, name: str, moment: float) -> None:
        """Keeps the moment unless an earlier one is known."""
        with self._lock:
            self[name] = min(moment, self.get(name, moment))


def of_job(job: Json) -> Iterator[str]:
    """What a job shows to have happened."""
    for condition in job.get("status", {}).get("conditions", []):
        if condition["status"] == "True":
            yield condition["type"]


def of_pod(pod: Json) -> Iterator[str]:
    """What a pod of the job shows to have happened."""
    role = "driver" if pod["metadata"]["name"].endswith("-driver") else "executor"
    status = pod.get("status", {})
    yield f"{role} created"
    if pod["spec"].get("nodeName"):
        yield f"{role} scheduled"
    containers = status.get("containerStatuses", [])
    if containers and all("waiting" not in each["state"] for each in containers):
        yield f"{role}'s containers run"
    first = {each["name"]: each for each in status.get("initContainerStatuses", [])}
    if "terminated" in first.get("agent", {}).get("state", {}):
        yield "agent copied"
    if "running" in first.get("stack", {}).get("state", {}):
        yield "stack's container runs"
    if first.get("stack", {}).get("started"):
        yield "agent ready"


def of_log(text: str) -> Iterator[tuple[str, float]]:
    """What lines with the container runtime's timestamps show, and when."""
    for line in text.splitlines():
        moment, _, words = line.partition(" ")
        for name, pattern in LINES.items():
            if pattern.search(words):
                # Nanoseconds are more than Python reads.
                yield name, datetime.fromisoformat(moment[:26] + "+00:00").timestamp()


@contextmanager
def watching(namespace: str, kind: str, take: Callable[[Json, float], None]) -> Iterator[None]:
    """Hands over each object of a kind as it changes, in a thread, while the block runs."""
    program = subprocess.Popen(
        ["kubectl", "-n", namespace, "get", kind, "--watch", "-o", r'jsonpath={@}{"\n"}'],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=k.tool_environment(),
    )  # fmt: skip
    lines = program.stdout
    assert lines is not None

    def read() -> None:
        for line in lines:
            moment = time.time()
            take(json.loads(line), moment)

    reader = threading.Thread(target=read)
    reader.start()
    try:
        yield
    finally:
        program.terminate()
        program.wait(_END_SECONDS)
        reader.join(_END_SECONDS)
        lines.close()
