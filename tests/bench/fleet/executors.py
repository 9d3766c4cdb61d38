"""Fleets of executors beside one driver: Spark's own in a process each, or simulated ones.

Each comes in three parts, of which one can be lost at once. At its end a fleet leaves no process.
"""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.bench.fleet.jar import compiled, jars

PARTS = 3
END_SECONDS = 60.0
# Small ones, so that many fit on a machine.
SMALL = ["-XX:TieredStopAtLevel=1", "-XX:+UseSerialGC", "-Xms48m", "-Xmn16m"]
# What Spark's launcher opens, of that which is used.
PACKAGES = ("java.nio", "sun.nio.ch", "java.lang", "java.util")
OPENED = [f"--add-opens=java.base/{name}=ALL-UNNAMED" for name in PACKAGES]
# Spark's own default names each connection.
LOGGING = """
rootLogger.level = error
rootLogger.appenderRef.stderr.ref = stderr
appender.stderr.type = Console
appender.stderr.name = stderr
appender.stderr.target = SYSTEM_ERR
appender.stderr.layout.type = PatternLayout
appender.stderr.layout.pattern = %d %p %c: %m%n
"""
Start = Callable[[int, int], list[subprocess.Popen[bytes]]]


@dataclass(frozen=True)
class Meeting:
    """Where a driver is met, and what it lets in."""

    url: str
    application: str
    secret: str
    accumulator: bytes
    case_seconds: float
    row: dict[str, Any]


@dataclass
class Fleet:
    """Executors that were started, in parts. `ended` and `heartbeats` count simulated ones'."""

    parts: list[list[subprocess.Popen[bytes]]] = field(default_factory=list)
    ended: int = 0
    heartbeats: int = 0

    def lose_a_third(self) -> None:
        """End a part's processes as a node's power cut would."""
        for process in self.parts.pop():
            process.kill()
            process.communicate()

    def resident(self) -> float:
        """MiB of all its processes and of what they started."""
        return sum(resident(each.pid) for part in self.parts for each in part)

    def close(self) -> None:
        """End all, and count what simulated ones say."""
        for process in (process for part in self.parts for process in part):
            try:
                stated, _ = process.communicate(timeout=END_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()
                stated, _ = process.communicate()
            if stated and len(words := stated.split()) == 2:
                self.ended += int(words[0])
                self.heartbeats += int(words[1])


def resident(process: int) -> float:
    """MiB of memory that a process has now; 0 once it has ended."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / (1 << 20)


@contextmanager
def fleet(kind: str, count: int, meeting: Meeting) -> Iterator[Fleet]:
    """So many executors, `real` or `simulated`, which have been started and come later."""
    found = Fleet()
    with tempfile.TemporaryDirectory(prefix="bagpipe-fleet-") as name:
        start = _real(meeting) if kind == "real" else _simulated(meeting, Path(name))
        try:
            for first, size in thirds(count):
                found.parts.append([])
                found.parts[-1] += start(first, size)
            yield found
        finally:
            for process in (process for part in found.parts for process in part):
                if kind == "real":
                    process.send_signal(signal.SIGKILL)
            found.close()


def thirds(count: int) -> list[tuple[int, int]]:
    """(first number, how many) of each part; the last is a third, rounded down, of at least one."""
    last = max(1, count // PARTS)
    rest = count - last
    sizes = [rest - rest // 2, rest // 2, last]
    firsts = [1, 1 + sizes[0], 1 + sizes[0] + sizes[1]]
    return [pair for pair in zip(firsts, sizes, strict=True) if pair[1]]


def _environment(meeting: Meeting) -> dict[str, str]:
    """The secret is in the environment, as it is in a pod."""
    return {**os.environ, "_SPARK_AUTH_SECRET": meeting.secret}


def _java(heap: str, *words: str) -> list[str]:
    safe = ["-Dspark.authenticate=true", "-Dspark.network.crypto.enabled=true"]
    path = ["-cp", f"{compiled()}:{jars()}/*"]
    return ["java", f"-Xmx{heap}", "-Xss512k", *SMALL, *OPENED, *safe, *path, *words]


def _real(meeting: Meeting) -> Start:
    def start(first: int, count: int) -> list[subprocess.Popen[bytes]]:
        return [_executor(meeting, str(number)) for number in range(first, first + count)]

    return start


def _executor(meeting: Meeting, number: str) -> subprocess.Popen[bytes]:
    words = ["--driver-url", meeting.url, "--executor-id", number, "--hostname", "127.0.0.1"]
    words += ["--cores", "1", "--app-id", meeting.application, "--resourceProfileId", "0"]
    program = "org.apache.spark.executor.CoarseGrainedExecutorBackend"
    return subprocess.Popen(
        _java("512m", program, *words), env=_environment(meeting), stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def _simulated(meeting: Meeting, folder: Path) -> Start:
    # What PySpark's worker sends: of foreachPartition's count, and the update of an accumulator.
    (folder / "value").write_bytes(pickle.dumps([0]))
    (folder / "row").write_bytes(pickle.dumps((0, [meeting.row])))
    (folder / "accumulator").write_bytes(meeting.accumulator)
    (folder / "log4j2.properties").write_text(LOGGING)

    def start(first: int, count: int) -> list[subprocess.Popen[bytes]]:
        words = [meeting.url, first, count, int(1000 * meeting.case_seconds)]
        quiet = f"-Dlog4j2.configurationFile={folder}/log4j2.properties"
        program = ["bagpipe.bench.SimulatedExecutors", *map(str, words), str(folder)]
        command = _java("1g", quiet, *program)
        return [
            subprocess.Popen(
                command, env=_environment(meeting), stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=sys.stderr,
            )
        ]  # fmt: skip

    return start
