"""One driver of Bagpipe with many executors: how fast they come, how fast cases go, what it costs.

    python -m tests.bench.fleet.driver KIND EXECUTORS CASES CASE_SECONDS REST_SECONDS LOSE

The driver's own process, with a JVM as on a cluster; it starts the executors, real or simulated,
and prints what it measured as one line of JSON.
"""

import dataclasses
import json
import os
import secrets
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pyspark import SparkConf, SparkContext
from pyspark.java_gateway import launch_gateway

from bagpipe.driver import cases_on_spark
from bagpipe.driver.journal import Journal
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.driver.row_file import RowFile
from bagpipe.driver.spark_context import DriverPod, spark_settings
from bagpipe.quantities import heap_mebibytes
from bagpipe.run.case_run import RunContext
from bagpipe.storage import Storage
from tests.bench.fleet.cases import PLACE, SECONDS, cases_of, nothing, row_of
from tests.bench.fleet.executors import Fleet, Meeting, fleet, resident
from tests.bench.fleet.jar import compiled
from tests.unit.bagpipe.jobs import make_job

ROOT = Path(__file__).parents[3]
COME_SECONDS = 900.0
LOOK_SECONDS = 0.1
# What the CRD lets a job have.
MOST_EXECUTORS = 1000
TICKS = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Measured:
    """Seconds of the clock and of a processor, MiB of memory, and what was counted.

    `came`: from the start of the fleet to its last registration. `resting`: processors that the
    driver takes while nothing runs, as a share of one. `ran`: from the first case to the last row.
    `noticed`: from the loss to the moment from which Spark counts on the rest alone. `again`: cases
    that simulated executors ended beyond one each.
    """

    executors: int
    cases: int
    came: float
    resting: float
    ran: float
    used: float
    jvm: float
    python: float
    heartbeats: int = 0
    again: int = 0
    lost: int = 0
    noticed: float = 0.0
    after_the_loss: float = 0.0


def settings(executors: int, cases: int, port: int) -> dict[str, str]:
    """A job's own settings, less Kubernetes."""
    # More than a job may have only look how far a driver goes.
    job = make_job({}, spark={"executors": min(executors, MOST_EXECUTORS)})
    own = spark_settings(job, DriverPod("driver", "bench", "127.0.0.1"), cases)
    return {key: value for key, value in own.items() if not key.startswith("spark.kubernetes.")} | {
        "spark.driver.port": str(port),
        "spark.authenticate.secret": secrets.token_hex(),
        "spark.log.level": "ERROR",
    }


@contextmanager
def spark(executors: int, cases: int) -> Iterator[SparkContext]:
    """A driver's Spark whose executors somebody else starts."""
    paths = os.pathsep.join([str(ROOT), str(ROOT / "images/spark/src")])
    os.environ |= {"PYSPARK_PYTHON": sys.executable, "PYTHONPATH": paths}
    os.environ["SPARK_LOCAL_IP"] = "127.0.0.1"
    heap = heap_mebibytes(make_job({}).spec.spark.driver.resources.memory)
    made = settings(executors, cases, _free_port())
    first = SparkConf(loadDefaults=False)
    first.set("spark.driver.memory", f"{heap}m").set("spark.driver.extraClassPath", str(compiled()))
    first.set("spark.driver.extraJavaOptions", made.pop("spark.driver.extraJavaOptions"))
    # What starts the JVM knows no such master, and a secret is no word of a process.
    gateway: Any = launch_gateway(first)  # type: ignore[no-untyped-call]
    conf = SparkConf(_jvm=gateway.jvm).setAll(list(made.items())).setMaster("bench")
    context = SparkContext(conf=conf, gateway=gateway)
    try:
        yield context
    finally:
        context.stop()


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
        return port


def meeting(context: SparkContext, case_seconds: float) -> Meeting:
    """Where the driver's executors come to."""
    conf, jvm = context.getConf(), context._jvm
    assert jvm
    url = f"spark://CoarseGrainedScheduler@127.0.0.1:{conf.get('spark.driver.port')}"
    row = row_of(PLACE) | {"ran_on": {}}
    return Meeting(
        url, context.applicationId, str(conf.get("spark.authenticate.secret")),
        jvm.org.apache.spark.util.Utils.serialize(context._javaAccumulator),
        case_seconds, row,
    )  # fmt: skip


def wait_until(holds: Callable[[], bool], seconds: float, what: str) -> None:
    """Raises TimeoutError."""
    deadline, pause = time.monotonic() + seconds, threading.Event()
    while not holds():
        if time.monotonic() > deadline:
            raise TimeoutError(f"after {seconds:.0f} s {what}")
        pause.wait(LOOK_SECONDS)


def registered(context: SparkContext) -> int:
    """How many executors Spark's scheduler counts on."""
    return int(context._jsc.sc().schedulerBackend().getExecutorIds().size())


def used(*processes: int) -> float:
    """Seconds of a processor that processes have taken, all of their threads."""
    total = 0
    for each in processes:
        fields = Path(f"/proc/{each}/stat").read_text().rpartition(")")[2].split()
        total += int(fields[11]) + int(fields[12])
    return total / TICKS


class Watching(threading.Thread):
    """Keeps each process' largest memory, until its end."""

    def __init__(self, processes: list[int]) -> None:
        super().__init__(daemon=True)
        self.most = dict.fromkeys(processes, 0.0)
        self.ended = threading.Event()

    def run(self) -> None:
        while not self.ended.wait(0.2):
            for process, before in self.most.items():
                self.most[process] = max(before, resident(process))


class Losing(threading.Thread):
    """Takes a third of the executors away once a half of the cases have ended."""

    def __init__(self, context: SparkContext, executors: Fleet, rows: RowFile, cases: int) -> None:
        super().__init__(daemon=True)
        self._context, self._executors, self._rows, self._cases = context, executors, rows, cases
        self.lost, self.at, self.noticed = 0, 0.0, 0.0

    def run(self) -> None:
        wait_until(lambda: 2 * len(self._rows) >= self._cases, COME_SECONDS, "too few rows")
        before = registered(self._context)
        self.at = time.monotonic()
        third = len(self._executors.parts[-1])
        self._executors.lose_a_third()
        rest = before - max(third, before // 3)
        wait_until(lambda: registered(self._context) <= rest, COME_SECONDS, "none is missed")
        self.noticed, self.lost = time.monotonic() - self.at, before - registered(self._context)


def measure(
    kind: str, executors: int, cases: int, case_seconds: float, rest: float, lose: bool
) -> Measured:
    """Raises RuntimeError where not each case has one row, TimeoutError where something hangs."""
    os.environ[SECONDS] = str(case_seconds)
    # What the tasks run is looked up there by name.
    vars(cases_on_spark)["run_case"] = nothing
    with (
        tempfile.TemporaryDirectory(prefix="bagpipe-fleet-") as name,
        spark(executors, cases) as context,
        RowFile(Path(name, "rows")) as rows,
    ):
        begun = time.monotonic()
        with fleet(kind, executors, meeting(context, case_seconds)) as found:
            wait_until(lambda: registered(context) >= executors, COME_SECONDS, "not all have come")
            came = time.monotonic() - begun
            own, jvm = os.getpid(), _jvm(context)
            resting = _resting(rest, own, jvm)
            watching, losing = Watching([own, jvm]), Losing(context, found, rows, cases)
            watching.start()
            if lose:
                losing.start()
            before, begun = used(own, jvm), time.monotonic()
            _run(context, cases, rows, Path(name))
            ended = time.monotonic()
            took = used(own, jvm) - before
            if lose:
                losing.join()
            watching.ended.set()
        _once_each(rows, cases)
    return Measured(
        executors, cases, came, resting, ended - begun, took, watching.most[jvm],
        watching.most[own], found.heartbeats, found.ended - cases if found.ended else 0,
        losing.lost, losing.noticed, ended - losing.at if lose else 0.0,
    )  # fmt: skip


def _jvm(context: SparkContext) -> int:
    gateway = context._gateway
    if gateway is None:
        raise RuntimeError("Spark has no gateway")
    process: int = gateway.proc.pid
    return process


def _resting(seconds: float, *processes: int) -> float:
    before, begun = used(*processes), time.monotonic()
    threading.Event().wait(seconds)
    return (used(*processes) - before) / (time.monotonic() - begun) if seconds else 0.0


def _run(context: SparkContext, count: int, rows: RowFile, folder: Path) -> None:
    progress = Progress("results")
    progress.begin(count)
    results = f"file://{folder}/results"
    keeper = Keeper(progress, rows, Journal(Storage({}), results, 1))
    run_context = RunContext("bench/fleet", make_job({}).spec, {}, results)
    cases_on_spark.run_cases(context, cases_of(count), run_context, keeper)
    keeper.finish(threading.Event())


def _once_each(rows: RowFile, cases: int) -> None:
    names = [row["case"] for row in rows.rows()]
    if sorted(names) != [case.id for case in cases_of(cases)]:
        raise RuntimeError(f"{len(names)} rows of {len(set(names))} cases, and {cases} are wanted")


def in_its_own_process(
    kind: str, executors: int, cases: int, case_seconds: float = 0.0, rest: float = 0.0,
    lose: bool = False,
) -> Measured:  # fmt: skip
    """Raises CalledProcessError, and TimeoutExpired after an hour."""
    words = [kind, executors, cases, case_seconds, rest, int(lose)]
    command = [sys.executable, "-m", "tests.bench.fleet.driver", *map(str, words)]
    folders = ("", "tests/cluster", "images/build", "images/spark/src")
    paths = [str(ROOT / folder) for folder in folders]
    done = subprocess.run(
        command, cwd=ROOT, stdout=subprocess.PIPE, text=True, timeout=3600, check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
    )  # fmt: skip
    return Measured(**json.loads(done.stdout.splitlines()[-1]))


def main(words: list[str]) -> None:
    kind, executors, cases, case_seconds, rest, lose = words
    found: Any = measure(
        kind, int(executors), int(cases), float(case_seconds), float(rest), lose == "1"
    )
    print(json.dumps(dataclasses.asdict(found)))


if __name__ == "__main__":
    # As a module of its own name: what its tasks run is found by it.
    from tests.bench.fleet import driver

    driver.main(sys.argv[1:])
