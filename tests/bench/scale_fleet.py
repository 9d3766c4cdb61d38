"""A fleet on this machine: Spark executors as processes of their own, a real agent, a real driver.

The stack sleeps, because the paper's workers had a processor each and this machine has few.
"""

import contextlib
import dataclasses
import json
import os
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pyspark import SparkConf, SparkContext

from bagpipe.driver import cases_on_spark
from bagpipe.driver.journal import Journal
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.driver.row_file import RowFile
from bagpipe.plan.case import Case
from bagpipe.plan.fragments import Window
from bagpipe.run.case_run import Row, RunContext
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.agent_binary import built

ROOT = Path(__file__).parents[2]
IMAGE_SECONDS = 0.3
DETECTOR = ROOT / "tests/bench/programs/sleeping_detector.cpp"


@dataclass(frozen=True)
class Fleet:
    """One run: wall seconds, and of each case its seconds and those of its stack."""

    seconds: float
    cases: list[float]
    stacks: list[float]

    @property
    def cost_per_case(self) -> float:
        """Median seconds of a case beyond its stack's own time, once everything is warm."""
        costs = [case - stack for case, stack in zip(self.cases, self.stacks, strict=True)]
        return statistics.median(costs[len(costs) // 4 :])


@dataclass(frozen=True)
class Planned:
    """A great job's cost to its driver: seconds in all, and memory in MiB.

    `before` and `most` are the Python process', `jvm` is its Java machine's at most.
    """

    cases: int
    seconds: float
    before: float
    most: float
    jvm: float


@contextlib.contextmanager
def serving(binary: Path, shared: Path, slots: int) -> Iterator[None]:
    """An agent with slots, until the block ends."""
    shared.mkdir()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [str(binary), "serve", "--shared", str(shared), "--slots", str(slots)]
    process = subprocess.Popen(
        [*command, "--master-port", str(port)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        deadline = time.monotonic() + 20
        pause = threading.Event()
        while subprocess.run([binary, "ready", "--shared", shared], check=False).returncode:
            if time.monotonic() > deadline:
                raise TimeoutError("the agent is not ready after 20 s")
            pause.wait(0.02)
        yield
    finally:
        process.terminate()
        process.wait(20)


@contextlib.contextmanager
def spark(master: str) -> Iterator[SparkContext]:
    """A Spark of this machine's own."""
    os.environ["PYSPARK_PYTHON"] = sys.executable
    paths = os.pathsep.join([str(ROOT), str(ROOT / "images/spark/src")])
    os.environ["PYTHONPATH"] = paths
    settings = {
        "spark.ui.enabled": "false",
        "spark.ui.showConsoleProgress": "false",
        "spark.driver.host": "127.0.0.1",
        "spark.driver.bindAddress": "127.0.0.1",
        "spark.driver.memory": "512m",
        "spark.executor.memory": "512m",
        "spark.locality.wait": "0s",
        "spark.python.unix.domain.socket.enabled": "true",
        "spark.executorEnv.PYTHONPATH": paths,
        "spark.log.level": "ERROR",
    }
    context = SparkContext(conf=SparkConf().setMaster(master).setAll(list(settings.items())))
    try:
        yield context
    finally:
        context.stop()


def run(workers: int, cases: int, images: int) -> Fleet:
    """`cases` cases of so many images each over `workers` executors of one slot, warm."""
    with tempfile.TemporaryDirectory(prefix="bagpipe-scale-") as name:
        folder = Path(name)
        recordings = folder / "recordings"
        for kind, count in (("warm", workers), ("drive", cases)):
            (recordings / kind).mkdir(parents=True)
            for number in range(count):
                taken = bytes(images if kind == "drive" else 1)
                (recordings / kind / f"{number:05d}").write_bytes(taken)
        compile_detector(folder / "detector")
        with (
            serving(built(), folder / "shared", workers),
            spark(f"local-cluster[{workers},1,640]") as context,
        ):
            _wait_for_executors(context, workers)
            _run_cases(context, folder, "warm")
            begun = time.monotonic()
            rows = _run_cases(context, folder, "drive")
            seconds = time.monotonic() - begun
    return Fleet(
        seconds,
        [float(row["seconds"]) for row in rows],
        [float(row["result"]["timings"]["run"]) for row in rows],
    )


def compile_detector(program: Path) -> None:
    """A stack whose own start costs nothing: 8 interpreters at once would be the bench's limit."""
    compiler = ["g++", "-std=c++17", "-O2", "-I", str(ROOT / "images/spark/sdk/cpp")]
    subprocess.run([*compiler, str(DETECTOR), "-o", str(program)], check=True)


def _run_cases(context: SparkContext, folder: Path, kind: str) -> list[Row]:
    spec = SimulationJobSpec.model_validate(
        {
            "source": {"files": [f"file://{folder}/recordings/{kind}/*"]},
            "stack": {
                "engine": "exec",
                "image": "-",
                "command": [str(folder / "detector"), str(int(1000 * IMAGE_SECONDS))],
            },
            "output": {"uri": f"file://{folder}/results/{kind}"},
        }
    )
    storage = Storage({})
    results = spec.output.uri
    planned = plan(spec, storage)
    run_context = RunContext(f"bench/{kind}", spec, {}, results, str(folder / "shared"))
    with RowFile(folder / f"rows-{kind}") as rows:
        progress = Progress(results)
        progress.begin(len(planned.cases))
        keeper = Keeper(progress, rows, Journal(storage, results, 1))
        cases_on_spark.run_cases(context, planned.cases, run_context, keeper)
        keeper.finish(threading.Event())
        found = list(rows.rows())
    wrong = [row for row in found if row["outcome"] != "passed"]
    if wrong or len(found) != len(planned.cases):
        raise RuntimeError(f"{len(wrong)} cases did not pass: {json.dumps(wrong[:1])[:1000]}")
    return found


def _wait_for_executors(context: SparkContext, workers: int) -> None:
    deadline = time.monotonic() + 120
    pause = threading.Event()
    jvm = context._jsc.sc()
    while jvm.getExecutorMemoryStatus().size() - 1 < workers:
        if time.monotonic() > deadline:
            raise TimeoutError(f"fewer than {workers} executors after 120 s")
        pause.wait(0.1)


def schedule(count: int) -> Planned:
    """Schedule so many cases that do nothing, in a driver process of its own."""
    command = [sys.executable, "-m", "tests.bench.scale_fleet", str(count)]
    done = subprocess.run(
        command, cwd=ROOT, stdout=subprocess.PIPE, text=True, timeout=3600, check=True
    )
    return Planned(**json.loads(done.stdout.splitlines()[-1]))


def _nothing(case: Case, _context: RunContext, _attempt: int) -> Row:
    """A case without a stack, so that only the driver's own cost is left."""
    return {
        "case": case.id, "bag": case.bag, "window": [0, 1, 2], "outcome": "passed", "reason": "",
        "message": "", "stderr": [], "attempts": 1, "recorded": None, "result": None,
        "seconds": 0.0,
    }  # fmt: skip


def _cases(count: int) -> list[Case]:
    connections = [(4096 + 300 * number, 300) for number in range(20)]
    return [
        Case(
            f"drive-{n // 1000:04d}-{n % 1000:04d}", f"s3://fleet/{n // 1000}.bag", "1",
            Window(n, n, n + 1), connections, [(n << 20, 1 << 20)], 100,
        )
        for n in range(count)
    ]  # fmt: skip


def _schedule(count: int) -> Planned:
    # What the tasks run is looked up there by name.
    vars(cases_on_spark)["run_case"] = _nothing
    folder = tempfile.mkdtemp(prefix="bagpipe-scale-")
    spec = SimulationJobSpec.model_validate(
        {
            "source": {"files": ["file:///recordings/*"]},
            "stack": {"engine": "exec", "image": "-", "command": ["true"]},
            "output": {"uri": f"file://{folder}/results"},
        }
    )
    progress = Progress("results")
    progress.begin(count)
    with spark("local[2]") as context, RowFile(Path(folder, "rows")) as rows:
        own, jvm = os.getpid(), _jvm(context)
        before = _resident(own)
        most, ended = {own: before, jvm: 0.0}, threading.Event()
        # A daemon, so that a job that fails ends the process.
        watcher = threading.Thread(target=_watch, args=(most, ended), daemon=True)
        watcher.start()
        begun = time.monotonic()
        keeper = Keeper(progress, rows, Journal(Storage({}), f"file://{folder}/results", 1))
        run_context = RunContext("bench/schedule", spec, {}, f"file://{folder}/results")
        cases_on_spark.run_cases(context, _cases(count), run_context, keeper)
        keeper.finish(threading.Event())
        seconds = time.monotonic() - begun
        ended.set()
        watcher.join()
        kept = len(rows)
    shutil.rmtree(folder)
    if kept != count:
        raise RuntimeError(f"{kept} rows of {count} cases")
    return Planned(count, seconds, before, most[own], most[jvm])


def _jvm(context: SparkContext) -> int:
    """The process of the driver's Java machine: spark-submit's own, which becomes it."""
    gateway = context._gateway
    if gateway is None:
        raise RuntimeError("Spark has no gateway")
    process: int = gateway.proc.pid
    return process


def _watch(most: dict[int, float], ended: threading.Event) -> None:
    """Keep each process' largest memory."""
    while not ended.wait(0.2):
        for process, before in most.items():
            most[process] = max(before, _resident(process))


def _resident(process: int) -> float:
    """MiB of memory that a process has now."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / (1 << 20)


if __name__ == "__main__":
    print(json.dumps(dataclasses.asdict(_schedule(int(sys.argv[1])))))
