"""Records from an executor's Python to a program and back, beside plain pipes and Spark's own ways.

Peers: `dd | cat | dd` over two named pipes of the same size; on Spark, `RDD.pipe` with base64
(its records are lines of text) and `binaryFiles` with `mapPartitions`, which calls no program.
"""

import base64
import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tests.bench.rows import Row

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs/examples/binpipe"
ROUNDS = 3
# (name, bytes of a record, records); 1 GB does not fit the other ways of Spark.
SIZES = [
    ("1 KB", 1 << 10, 20_000),
    ("64 KB", 1 << 16, 4_000),
    ("1 MB", 1 << 20, 400),
    ("64 MB", 64 << 20, 8),
    ("1 GB", 1 << 30, 1),
]
FIFO_TARGET, BASE64_TARGET = 0.8, 5.0
NOTE = (
    "Zeros, which no layer compresses; 20 MB in records of 1 KB, 256 to 512 MB in the others, one"
    " record of 1 GB. dd and cat move blocks of the record's size, 1 MiB at most, and check"
    " nothing; ours frames, numbers and checks every byte twice, on the way in and out. On Spark"
    " one task reads files from memory (tmpfs), and what is counted is the bytes that come back."
)


def measure() -> tuple[list[Row], dict[str, str], str]:
    """All rows, the versions of what was compared, and what one must know to read them."""
    build = Path(tempfile.mkdtemp(prefix="bagpipe-bench-"))
    memory = Path(tempfile.mkdtemp(prefix="bagpipe-bench-", dir="/dev/shm"))
    runs: dict[tuple[str, str], list[float]] = defaultdict(list)
    try:
        program = build / "pass_on"
        compiler = ["g++", "-std=c++17", "-O2", "-I", str(ROOT / "images/spark/sdk/cpp")]
        subprocess.run([*compiler, str(EXAMPLES / "pass_on.cpp"), "-o", str(program)], check=True)
        ways = {"C++": [str(program)], "Python": [sys.executable, str(EXAMPLES / "pass_on.py")]}
        for number in range(int(os.environ.get("BENCH_ROUNDS", ROUNDS))):
            print(f"    round {number + 1}", file=sys.stderr, flush=True)
            for name, size, count in scaled():
                runs[name, "fifo"].append(through_fifos(build, size, count))
                for language, command in ways.items():
                    rate, peak = in_fresh_process(command, size, count)
                    runs[name, language].append(rate)
                    runs[name, f"{language} memory"].append(peak)
            for key, rate in on_spark(memory, ways["C++"]).items():
                runs[key].append(rate)
    finally:
        shutil.rmtree(build)
        shutil.rmtree(memory)
    return rows(runs), versions(), NOTE


def scaled() -> Iterator[tuple[str, int, int]]:
    scale = float(os.environ.get("BENCH_SCALE", "1"))
    for name, size, count in SIZES:
        yield name, size, max(1, round(count * scale))


def through_fifos(folder: Path, size: int, count: int) -> float:
    """MB/s of dd into a FIFO, cat from it into another, dd from that."""
    there, back = folder / "there", folder / "back"
    for fifo in (there, back):
        fifo.unlink(missing_ok=True)
        os.mkfifo(fifo)
    block = min(size, 1 << 20)
    blocks = size * count // block
    begun = time.perf_counter()
    with contextlib.ExitStack() as stack:
        for command in (
            f"dd if=/dev/zero of={there} bs={block} count={blocks}",
            f"cat < {there} > {back}",
            f"dd if={back} of=/dev/null bs={block}",
        ):
            quiet = subprocess.DEVNULL
            stack.enter_context(subprocess.Popen(["/bin/sh", "-c", command], stderr=quiet))
    return size * count / (time.perf_counter() - begun) / 1e6


def in_fresh_process(command: list[str], size: int, count: int) -> tuple[float, float]:
    """(MB/s, peak MiB of the worker), in a process of its own so that the peak is its own."""
    done = subprocess.run(
        [sys.executable, __file__, json.dumps([command, size, count])],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{command[0]}: {done.stderr[-2000:]}")
    rate, peak = json.loads(done.stdout)
    return rate, peak


def one_run(command: list[str], size: int, count: int) -> tuple[float, float]:
    from bagpipe.binpiped.exchange import exchange  # noqa: PLC0415
    from bagpipe.binpiped.logic import Command, Deadlines  # noqa: PLC0415
    from bagpipe.binpiped.record import InputRecord, OutputHead  # noqa: PLC0415

    piece = bytes(min(size, 1 << 20))

    def pieces() -> Iterator[bytes]:
        return (piece for _ in range(size // len(piece)))

    records = (InputRecord(f"record {number}", size, pieces) for number in range(count))
    begun = time.perf_counter()
    moved = 0
    for item in exchange(Command(tuple(command)), records, Deadlines(600, 600)):
        if not isinstance(item, OutputHead):
            moved += len(item)
    seconds = time.perf_counter() - begun
    assert moved == size * count
    # Not getrusage: its maximum survives exec, so it would be that of the bench.
    status = Path("/proc/self/status").read_text().splitlines()
    peak = next(line for line in status if line.startswith("VmHWM"))
    return moved / seconds / 1e6, int(peak.split()[1]) / 1024


def on_spark(memory: Path, command: list[str]) -> dict[tuple[str, str], float]:
    """MB/s of one task on a local Spark, by (size, way)."""
    from pyspark.sql import SparkSession  # noqa: PLC0415  a virtual machine starts

    import bagpipe  # noqa: PLC0415

    os.environ["PYSPARK_PYTHON"] = sys.executable
    session = (
        SparkSession.builder.master("local[1]")
        .config("spark.driver.memory", "2g")
        .config("spark.driver.host", "127.0.0.1")
        .config("spark.driver.bindAddress", "127.0.0.1")
        .config("spark.ui.enabled", "false")
        .config("spark.ui.showConsoleProgress", "false")
        .getOrCreate()
    )
    context = session.sparkContext
    found: dict[tuple[str, str], float] = {}
    for name, size, planned in scaled():
        if size >= 1 << 30:
            continue
        count = min(planned, 4_000)
        folder = memory / str(size)
        if not folder.exists():
            folder.mkdir()
            (folder / "0").write_bytes(bytes(size))
            for number in range(1, count):
                os.link(folder / "0", folder / str(number))
        paths = [str(folder / str(number)) for number in range(count)]
        piped = bagpipe.bin_piped(context, paths, command=command, partitions=1)
        ways: dict[str, Callable[[], int]] = {
            "on Spark": partial(bytes_back, piped),
            "base64": partial(bytes_through_base64, context, paths),
        }
        # Without Hadoop's native library binaryFiles forks `ls` for each local file: small files
        # would measure that.
        if size >= 1 << 20:
            ways["binaryFiles"] = partial(bytes_read, context, folder)
        for way, action in ways.items():
            if not found:
                # The first job of a Spark starts its workers; none of the ways is to pay for it.
                context.parallelize([0], 1).map(str).pipe("cat").count()
            begun = time.perf_counter()
            assert action() == size * count
            found[name, way] = size * count / (time.perf_counter() - begun) / 1e6
    session.stop()
    return found


def bytes_back(piped: Any) -> int:
    return int(piped.data().map(len).sum())


def bytes_through_base64(context: Any, paths: list[str]) -> int:
    lines = context.parallelize(paths, 1).map(
        lambda path: base64.b64encode(Path(path).read_bytes()).decode()
    )
    return int(lines.pipe("cat").map(lambda line: len(base64.b64decode(line))).sum())


def bytes_read(context: Any, folder: Path) -> int:
    return int(context.binaryFiles(str(folder), 1).map(lambda pair: len(pair[1])).sum())


def rows(runs: dict[tuple[str, str], list[float]]) -> list[Row]:
    made = []
    for name, size, _ in SIZES:
        target = FIFO_TARGET if size >= 1 << 16 else None
        for language in ("C++", "Python"):
            metric = f"to a {language} program and back"
            fifo = ("dd, cat, dd through FIFOs", runs[name, "fifo"], target)
            made.append(Row(name, metric, "MB/s", runs[name, language], *fifo))
        if (name, "on Spark") in runs:
            ours = runs[name, "on Spark"]
            metric = "files to RDD, on Spark"
            base = ("RDD.pipe, base64", runs[name, "base64"], BASE64_TARGET)
            made.append(Row(name, metric, "MB/s", ours, *base))
            if (name, "binaryFiles") in runs:
                plain = ("binaryFiles, no program", runs[name, "binaryFiles"], None)
                made.append(Row(name, metric, "MB/s", ours, *plain))
    # Flat: a record of 1 GB takes no more of the worker's memory than records of 64 KB.
    small = runs["64 KB", "Python memory"]
    for name in ("1 MB", "64 MB", "1 GB"):
        peak = runs[name, "Python memory"]
        made.append(Row(name, "worker's peak memory", "MiB", peak, "records of 64 KB", small, 0.8))
    return made


def versions() -> dict[str, str]:
    compiler = subprocess.run(
        ["g++", "-dumpfullversion"], capture_output=True, text=True, check=True
    )
    dd = subprocess.run(["dd", "--version"], capture_output=True, text=True, check=True)
    return {
        "pyspark": version("pyspark"),
        "google-crc32c": version("google-crc32c"),
        "g++": compiler.stdout.strip(),
        "dd": dd.stdout.split("\n")[0],
        "python": sys.version.split()[0],
    }


if __name__ == "__main__":
    print(json.dumps(one_run(*json.loads(sys.argv[1]))))
