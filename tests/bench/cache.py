"""The paper's Figure 6: bags in memory beside bags on disk, alone and through an executor.

Alone: the same reader and writer over `MemoryChunkedFile` and over a file. Through an executor:
the whole way of a case, from storage through a real node back into storage.
"""

import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

from tests.bench.bag import executable
from tests.bench.cache_ways import Executor, Passage, Shape, by_rosbag, executor, forget, remember
from tests.bench.play_graph import CACHE, ROOT, agent
from tests.bench.rows import Row

ROUNDS = 3
# Scaled down from the paper's 1,000,000 x 1 KB and 100,000 x 1 MB.
ALONE = (Shape("1 KB", 1 << 10, 300_000), Shape("1 MB", 1 << 20, 400))
THROUGH = (Shape("1 KB", 1 << 10, 200_000), Shape("1 MB", 1 << 20, 400))
# The paper's figures: write 3x; read 10x (small) and 5x (large).
WRITE_TARGET, READ_TARGETS = 3.0, {"1 KB": 10.0, "1 MB": 5.0}
CACHED, ON_DISK, ROSBAG = "memory", "file-backed bags", "copy, rosbag play, rosbag record"
# With room for every message, which nobody gives it unasked.
QUEUED = "copy, rosbag play --queue=all, rosbag record"
COLD, HOT = "cold", "hot"
NOTE = (
    "The paper's 1,000,000 x 1 KB and 100,000 x 1 MB, scaled down: 300,000 and 400 alone, 200,000"
    " and 400 through an executor. LZ4 compresses the bytes to about 55 %. Alone, one process"
    " writes or reads and copies out all messages of an uncompressed bag; 'on disk' waits until"
    " the disk has them, 'page cache' does not. Through an executor: MB of messages per second"
    " from the bag in storage (a file on disk) through a roscpp node that answers each message to"
    " the recording in storage; without starting and ending ROS. Cold: the page cache has"
    " forgotten each file before it is read. rosbag's losses count against its rate; its recordings"
    " are not compressed, ours are (LZ4)."
)
Runs = dict[tuple[str, str, str], list[float]]


def measure() -> tuple[list[Row], dict[str, str], str]:
    """All rows, the versions of what was compared, and what one must know to read them."""
    CACHE.mkdir(parents=True, exist_ok=True)
    # Beside the compiled nodes: on a disk, where temporary files may lie in memory.
    folder = Path(tempfile.mkdtemp(prefix="cache-", dir=CACHE))
    alone: Runs = defaultdict(list)
    passages: dict[tuple[str, str, str], list[Passage]] = defaultdict(list)
    try:
        program, binary = build_alone(), agent()
        for name in ("bags", "results", "work"):
            (folder / name).mkdir()
        for number in range(int(os.environ.get("BENCH_ROUNDS", ROUNDS))):
            print(f"    round {number + 1}", file=sys.stderr, flush=True)
            for shape in scaled(ALONE):
                layers(program, folder, shape, alone)
            for shape in scaled(THROUGH):
                ways(program, binary, folder, shape, passages, disk_first=number % 2 == 1)
    finally:
        shutil.rmtree(folder)
    return [*rows_alone(alone), *rows_through(passages)], versions(), NOTE


def scaled(shapes: tuple[Shape, ...]) -> list[Shape]:
    scale = float(os.environ.get("BENCH_SCALE", "1"))
    return [Shape(s.name, s.size, max(2, round(s.messages * scale))) for s in shapes]


def layers(program: Path, folder: Path, shape: Shape, runs: Runs) -> None:
    """One run of each of the two layers' ways, in MB/s."""
    path = folder / "alone.bag"

    def run(metric: str, way: str, verb: str) -> None:
        runs[shape.name, metric, way].append(shape.megabytes / seconds(program, verb, path, shape))

    run("write", CACHED, "keep")
    run("write, memory reused", CACHED, "reuse")
    run("write", "page cache", "spill")
    run("write", "on disk", "force")
    run("read", CACHED, "recall")
    forget(path)
    run("read", "disk, cold", "read")
    remember(path)
    run("read", "disk, hot", "read")
    path.unlink()


def ways(
    program: Path,
    binary: Path,
    folder: Path,
    shape: Shape,
    passages: dict[tuple[str, str, str], list[Passage]],
    *,
    disk_first: bool,
) -> None:
    """One passage by each way, cold and hot.

    The second of two executors is given the memory that the first has just let go, which a
    virtual machine may otherwise have to ask its host for: they take turns at being it.
    """
    bags, results, work = (folder / name for name in ("bags", "results", "work"))
    bag = bags / f"{shape.size}.bag"
    if not bag.exists():
        seconds(program, "force", bag, shape)
    claims = {"bags": str(bags), "results": str(results)}
    for state in (COLD, HOT):
        cold = state == COLD
        disk = ["--on-disk", str(work), *(["--cold"] if cold else [])]
        ours_ways = [(CACHED, list[str]()), (ON_DISK, disk)]
        for way, options in reversed(ours_ways) if disk_first else ours_ways:
            with executor(binary, folder, claims, *options) as ours:
                found = passage(ours, bag, shape, cold=cold)
            passages[shape.name, state, way].append(found)
        for way, options in ((ROSBAG, []), (QUEUED, [f"--queue={shape.messages}"])):
            found = by_rosbag(binary, work, bag, results, *options, cold=cold)
            passages[shape.name, state, way].append(found)


def passage(ours: Executor, bag: Path, shape: Shape, *, cold: bool) -> Passage:
    """One case, of which no message may be missing."""
    found = ours.passage(bag, shape, cold=cold)
    assert found.recorded == shape.messages, found
    return found


def seconds(program: Path, verb: str, path: Path, shape: Shape) -> float:
    command = [str(program), verb, str(path), str(shape.size), str(shape.messages)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    if done.returncode:
        raise RuntimeError(f"{command}: {done.stderr[-2000:]}")
    return float(done.stdout)


def rows_alone(runs: Runs) -> list[Row]:
    made = []
    for shape in ALONE:
        written = [("page cache", None), ("on disk", WRITE_TARGET)]
        read = [("disk, cold", READ_TARGETS[shape.name]), ("disk, hot", None)]
        for metric, peers in (
            ("write", written),
            ("write, memory reused", written),
            ("read", read),
        ):
            ours = runs[shape.name, metric, CACHED]
            for peer, target in peers:
                theirs = runs[shape.name, metric.split(",")[0], peer]
                case = f"{shape.name}, the bag alone"
                made.append(Row(case, metric, "MB/s", ours, peer, theirs, target))
    return made


def rows_through(passages: dict[tuple[str, str, str], list[Passage]]) -> list[Row]:
    made = []
    for shape in scaled(THROUGH):
        for state in (COLD, HOT):
            case = f"{shape.name}, through an executor, {state}"
            ours = passages[shape.name, state, CACHED]
            for peer in (ON_DISK, ROSBAG, QUEUED):
                theirs = passages[shape.name, state, peer]
                mine, other = rates(ours, shape), rates(theirs, shape)
                made.append(Row(case, "storage to storage", "MB/s", mine, peer, other))
                lost = [[float(shape.messages - run.recorded) for run in runs]
                        for runs in (ours, theirs)]  # fmt: skip
                made.append(Row(case, "lost", "messages", lost[0], peer, lost[1]))
            disk = passages[shape.name, state, ON_DISK]
            for part, metric in (
                ("in", "storage to an open bag"),
                ("play", "played and recorded"),
                ("whole", "whole case, ROS included"),
            ):
                took = [[run.parts[part] for run in runs] for runs in (ours, disk)]
                made.append(Row(case, metric, "s", took[0], ON_DISK, took[1]))
    return made


def rates(runs: list[Passage], shape: Shape) -> list[float]:
    return [run.recorded * shape.size / 1e6 / run.seconds for run in runs]


def build_alone() -> Path:
    """The program for the two layers alone, built for release."""
    command = ["cargo", "build", "--release", "--locked", "--package", "bagpipe-rosbag"]
    built = subprocess.run(
        [*command, "--example", "cache", "--message-format", "json-render-diagnostics"],
        cwd=ROOT / "images/agent",
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return Path(executable(built.stdout.splitlines()))


def versions() -> dict[str, str]:
    """What was compared."""
    command = ["dpkg-query", "-W", "-f", "${Version}", "librosbag4d"]
    shown = subprocess.run(command, capture_output=True, text=True, check=False)
    return {"rosbag": shown.stdout.strip(), "python": platform.python_version()}
