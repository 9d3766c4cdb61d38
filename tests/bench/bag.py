"""The in-memory bag beside its peers, on the same data, in turn, in one run.

Peers: rosbag in C++ and Python as Debian ships them (on disk, cold and hot, in tmpfs, in a
memfd), `rosbags` from PyPI, the Rust crate `mcap` (another format, for reference), and plain
copies of the same messages, which no format can beat.
"""

import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

from tests import recording
from tests.bench.rows import Row

ROOT = Path(__file__).parents[2]
PEERS = Path(__file__).parent / "bag_peers"
ROUNDS = 5
NOTE = (
    "The paper's tests are 1,000,000 x 1 KB and 100,000 x 1 MB; scaled down to fit memory and "
    "time: 300,000 x 1 KB and 400 x 1 MB (lz4: 200,000 and 200; bz2: 10,000; Python's rosbag "
    "50,000, rosbags and bagpipe.MemoryBag 100,000). LZ4 compresses the bytes to about 55 %. "
    "KITTI, Udacity and Autoware are bags of those recordings' topics, rates, sizes and "
    "compression, scaled down to seconds; the others are real. Such a bag is read, and all its "
    "messages are written again. Every program gets the same messages; writing ends when the bag "
    "is whole; nobody waits for "
    "the disk."
)
# Beside each bag's case, the file that `bench shapes` makes, or where the real one may lie.
SHAPES = {
    "KITTI, 3 s": "kitti.bag",
    "Udacity, 3 s": "udacity.bag",
    "Autoware campus, 1.5 s, lz4": "autoware.bag",
}
SHARED = ROOT.parent / "shared/data"
RECORDINGS = {
    "PR2 joint states, bz2": (recording.cached(), SHARED / "pr2_joint_states_bz2.bag"),
    "Jackal, bz2": (SHARED / "jackal_bz2.bag",),
    "Luminar, lz4": (SHARED / "luminar_lz4.bag",),
    "arrays": (SHARED / "arrays.bag",),
}
# Debian's rosbag_storage needs these by hand.
INCLUDES = ("pluginlib", "class_loader", "rcpputils", "rcutils", "ament_index_cpp")
LIBRARIES = (
    "rosbag_storage",
    "roscpp_serialization",
    "rostime",
    "cpp_common",
    "class_loader",
    "console_bridge",
    "boost_filesystem",
)
CPP, MEMCPY = "rosbag C++, ", "memcpy"
Comparison = tuple[str, str, str, float | None]
# (metric, the peer's metric, peer, target); a case that the peer did not run gives no row.
SMALL: list[Comparison] = [
    ("write", "write", CPP + "disk", 10.0),
    ("write", "write", CPP + "tmpfs", None),
    ("write", "write", CPP + "memfd", None),
    ("write", "write", "rosbag Python, disk", None),
    ("write", "write", "rosbags, disk", 4.0),
    ("write", "write", "mcap (Rust)", None),
    ("write", "write", MEMCPY, None),
    ("write, memory reused", "write", CPP + "disk", 10.0),
    ("write, memory reused", "write, memory reused", MEMCPY, None),
    ("read", "read", CPP + "disk cold", 10.0),
    ("read", "read", CPP + "disk hot", 10.0),
    ("read", "read", CPP + "tmpfs", 10.0),
    ("read", "read", CPP + "memfd", 10.0),
    ("read", "read", "rosbag Python, disk", None),
    ("read", "read", "rosbags, disk", None),
    ("read", "read", "mcap (Rust)", None),
    ("read, all ordered first", "read", CPP + "disk cold", None),
    ("read, all ordered first", "read", CPP + "disk hot", None),
    ("read and copy out", "read", CPP + "disk hot", None),
    ("read and copy out", "read and copy out", MEMCPY, None),
    ("write from Python", "write", "rosbags, disk", None),
    ("write from Python", "write", "rosbag Python, disk", None),
    ("read from Python", "read", "rosbags, disk", None),
    ("read from Python", "read", "rosbag Python, disk", None),
    ("read from Python, from a file", "read", "rosbags, disk", None),
    ("read from Python, from a file", "read", "rosbag Python, disk", None),
]
LARGE: list[Comparison] = [
    ("write", "write", CPP + "disk", None),
    ("write", "write", CPP + "tmpfs", None),
    ("write", "write", CPP + "memfd", None),
    ("write", "write", MEMCPY, 0.8),
    ("write, memory reused", "write, memory reused", MEMCPY, 0.8),
    ("read and copy out", "read", CPP + "disk cold", None),
    ("read and copy out", "read", CPP + "disk hot", None),
    ("read and copy out", "read", CPP + "memfd", None),
    ("read and copy out", "read and copy out", MEMCPY, 0.8),
]


def packed(target: float | None) -> list[Comparison]:
    return [
        ("write", "write", CPP + "disk", target),
        ("read", "read", CPP + "disk cold", target),
        ("read", "read", CPP + "disk hot", target),
        ("size of the bag", "size of the bag", CPP + "disk", None),
    ]


def recorded(case: str) -> list[Comparison]:
    """Of a bag of the shapes, or a real one: ours copies out as well, as the peers must."""
    target = 2.0 if "lz4" in case else None
    return [
        ("write", "write", CPP + "disk", target),
        ("write", "write", "rosbags, disk", None),
        ("size of the bag", "size of the bag", CPP + "disk", None),
        ("read and copy out", "read", CPP + "disk cold", target),
        ("read and copy out", "read", CPP + "disk hot", target),
        ("read and copy out", "read", "rosbags, disk", None),
    ]


COMPARISONS = {
    "1 KB": SMALL,
    "1 MB": LARGE,
    "1 KB lz4": packed(2.0),
    "1 MB lz4": packed(2.0),
    "1 KB bz2": packed(None),
    **{case: recorded(case) for case in [*SHAPES, *RECORDINGS]},
}
# What is promised outright; the "peer" is the promise.
PROMISES = {"s": ("the promise: 0.5 s", 0.5), "MB": ("the promise: 200 MB", 200.0)}

Key = tuple[str, str, str]
Runs = dict[Key, list[float]]


def measure() -> tuple[list[Row], dict[str, str], str]:
    """All rows, the versions of what was compared, and what one must know to read them."""
    build = Path(tempfile.mkdtemp(prefix="bagpipe-bench-"))
    memory = Path(tempfile.mkdtemp(prefix="bagpipe-bench-", dir="/dev/shm"))
    try:
        ours, cpp = build_ours(), build_cpp(build)
        payload = build / "payload"
        subprocess.run([ours, "payload", payload], check=True)
        scale = os.environ.get("BENCH_SCALE", "1")
        listed = list_bags(ours, build, scale)
        programs: list[list[str | Path]] = [
            [ours, "--scale", scale],
            [ours, "again", listed],
            [cpp, payload, build, memory, scale, listed],
            ["/usr/bin/python3", PEERS / "rosbag_python.py", payload, build, scale],
            [sys.executable, PEERS / "rosbags_python.py", payload, build, scale, listed],
            [sys.executable, PEERS / "memory_bag_python.py", payload, build, scale],
        ]
        runs: Runs = defaultdict(list)
        units: dict[tuple[str, str], str] = {}
        for number in range(int(os.environ.get("BENCH_ROUNDS", ROUNDS))):
            print(f"    round {number + 1}", file=sys.stderr, flush=True)
            for program in programs:
                take(program, runs, units)
    finally:
        shutil.rmtree(build)
        shutil.rmtree(memory)
    return rows(runs, units), versions(), NOTE


def list_bags(ours: Path, folder: Path, scale: str) -> Path:
    """The file that names the bags which every program reads; a real one that is not here is
    left out, with a sentence."""
    subprocess.run([ours, "--scale", scale, "shapes", folder], check=True)
    found = {case: folder / file for case, file in SHAPES.items()}
    for case, places in RECORDINGS.items():
        there = [path for path in places if path.exists()]
        if there:
            found[case] = there[0]
            continue
        fetch = "; `python -m tests.recording` fetches it" if "PR2" in case else ""
        print(f"    left out: {case}, which is not here{fetch}", file=sys.stderr, flush=True)
    path = folder / "bags.txt"
    path.write_text("".join(f"{case}\t{bag}\n" for case, bag in found.items()))
    return path


def take(program: list[str | Path], runs: Runs, units: dict[tuple[str, str], str]) -> None:
    """Runs a program once and adds what it prints."""
    done = subprocess.run(program, capture_output=True, text=True, timeout=180, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{program[0]} ended with {done.returncode}: {done.stderr[-2000:]}")
    for line in done.stdout.splitlines():
        each = json.loads(line)
        runs[each["case"], each["metric"], each["by"]].append(each["value"])
        units[each["case"], each["metric"]] = each["unit"]


def rows(runs: Runs, units: dict[tuple[str, str], str]) -> list[Row]:
    """One row for each comparison of which both sides were run."""
    made = [
        Row(case, metric, units[case, metric], ours, peer, theirs, target)
        for case, comparisons in COMPARISONS.items()
        for metric, their_metric, peer, target in comparisons
        if (ours := runs.get((case, metric, "bagpipe")))
        and (theirs := runs.get((case, their_metric, peer)))
    ]
    for (case, metric, by), values in runs.items():
        if by == "bagpipe" and case.startswith("plan "):
            peer, limit = PROMISES[units[case, metric]]
            made.append(Row(case, metric, units[case, metric], values, peer, [limit], 1.0))
    return made


def build_ours() -> Path:
    """The bench program, built for release; the path is the one that cargo names."""
    command = ["cargo", "build", "--release", "--locked", "--package", "bagpipe-rosbag"]
    built = subprocess.run(
        [*command, "--example", "bench", "--message-format", "json-render-diagnostics"],
        cwd=ROOT / "images/agent",
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return Path(executable(built.stdout.splitlines()))


def executable(messages: Iterable[str]) -> str:
    found = [json.loads(line).get("executable") for line in messages]
    return str(next(path for path in reversed(found) if path))


def build_cpp(folder: Path) -> Path:
    program = folder / "rosbag_cpp"
    subprocess.run(
        [
            *("g++", "-O2", "-std=c++17", PEERS / "rosbag_cpp.cpp", "-o", program),
            *(f"-I/usr/include/{each}" for each in INCLUDES),
            *(f"-l{each}" for each in LIBRARIES),
        ],
        check=True,
    )
    return program


def versions() -> dict[str, str]:
    packages = ["librosbag-storage4d", "python3-rosbag"]
    shown = subprocess.run(
        ["dpkg-query", "--show", "--showformat", "${Package} ${Version}\n", *packages],
        capture_output=True,
        text=True,
        check=False,
    )
    debian = dict(line.split(" ", 1) for line in shown.stdout.splitlines())
    rustc = subprocess.run(["rustc", "--version"], capture_output=True, text=True, check=False)
    return {
        **debian,
        "rosbags": version("rosbags"),
        "python": platform.python_version(),
        "rustc": rustc.stdout.strip(),
    }
