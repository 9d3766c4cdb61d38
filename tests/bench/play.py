"""`make bench BENCH=play`: how fast and how exactly the agent plays and records.

Each case runs beside its peer, in turns, in one run of this program; a ratio is of two
medians. Writes tests/bench/results/play.json and prints a table.
"""

import platform
import shutil
import statistics
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.bench import play_cases as cases
from tests.bench.play_graph import agent
from tests.bench.rows import Row

RUNS = 3
KB, MB = 1024, 1 << 20
SMALL, LARGE = 300_000, 1_500
RATES = (2_500, 5_000, 10_000, 20_000, 80_000)
Measure = Callable[[], float]


class Table:
    """Rows, printed as they come."""

    def __init__(self) -> None:
        self.rows: list[Row] = []

    def add(self, row: Row) -> None:
        """Keeps and prints a row."""
        self.rows.append(row)
        print(f"  {row.case}, {row.metric}: {spread(row.ours)} beside {spread(row.theirs)}")


def spread(runs: Sequence[float]) -> str:
    """Median and extremes."""
    if not runs:
        return "-"
    return f"{statistics.median(runs):,.5g} ({min(runs):,.4g}-{max(runs):,.4g})"


def beside(ours: Measure, theirs: Measure) -> tuple[list[float], list[float]]:
    """Both, in turns, and oftener than the rest: they take a second and vary most."""
    pairs = [(ours(), theirs()) for _ in range(5)]
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def sinks(bench: cases.Bench, table: Table) -> None:
    """To a program that only reads its socket."""
    for name, size, messages in (("1 KB", KB, 4 * SMALL), ("1 MB", MB, LARGE)):
        ours, theirs = beside(
            lambda s=size, n=messages: cases.sink_play(bench, s, n).rate(),  # type: ignore[misc]
            lambda s=size, n=messages: cases.sink_bare(bench, s, n).rate(),  # type: ignore[misc]
        )
        peer = "bare writev loop"
        table.add(Row(f"play {name} to a sink", "rate", "msg/s", ours, peer, theirs, 0.8))


def nodes(bench: cases.Bench, table: Table) -> None:
    """To real nodes, beside rosbag play."""
    shapes = (
        ("roscpp", "1 KB", KB, SMALL, 1.5),
        ("roscpp", "1 MB", MB, LARGE, 3.0),
        ("rospy", "1 KB", KB, SMALL // 6, None),
    )
    for library, name, size, messages, target in shapes:
        long = f"--queue={messages}"
        ours, plain, queued = [], [], []
        for _ in range(RUNS):
            ours.append(cases.node_play(bench, library, size, messages))
            plain.append(cases.node_rosbag(bench, library, size, messages))
            if library == "roscpp":
                queued.append(cases.node_rosbag(bench, library, size, messages, long))
        case = f"play {name} to {library}"
        lost = [float(messages - run.received) for run in ours]
        for peer, theirs in (("", plain), (" " + long, queued)):
            if not theirs:
                continue
            label = f"rosbag play --immediate{peer}"
            rates = [run.rate() for run in ours], [run.rate() for run in theirs]
            wanted = target if peer == "" else None
            table.add(Row(case, "rate", "msg/s", rates[0], label, rates[1], wanted))
            gone = [float(messages - run.received) for run in theirs]
            table.add(Row(case, "lost", "messages", lost, label, gone))


def recorders(bench: cases.Bench, table: Table) -> None:
    """From a roscpp publisher, beside rosbag record; then the lossless rates."""
    lossless = {True: [0.0], False: [0.0]}
    for rate in (*RATES, 0):
        messages = (rate or 100_000) * 2
        runs: dict[bool, list[cases.Delivery]] = {True: [], False: []}
        for _ in range(RUNS if rate in (80_000, 0) else 1):
            for ours in (True, False):
                runs[ours].append(cases.record(bench, KB, messages, rate, ours=ours))
        lost = {k: [float(messages - run.received) for run in v] for k, v in runs.items()}
        name = f"{rate:,}/s" if rate else "no pause"
        case = f"record 1 KB at {name}"
        table.add(Row(case, "lost", "messages", lost[True], "rosbag record", lost[False]))
        for ours, losses in lost.items():
            if not any(losses):
                lossless[ours].append(statistics.median(run.rate() for run in runs[ours]))
    peer = "rosbag record"
    if not any(lossless[False]):
        # It lost some at every rate: the slowest one is an upper bound, in its favour.
        lossless[False] = [float(min(RATES))]
        peer += f" (lost some even at {min(RATES):,}/s)"
    best, base = [max(lossless[True])], [max(lossless[False])]
    table.add(Row("record 1 KB", "lossless rate", "msg/s", best, peer, base, 10.0))


def steps(bench: cases.Bench, table: Table) -> None:
    """What lock-step adds to a node's own time."""
    for size, name in ((KB, "1 KB"), (MB, "1 MB")):
        runs = [cases.lockstep(bench, size, 2_000 if size == KB else 500) for _ in range(RUNS)]
        over = [run.whole - run.own for run in runs]
        budget, target = ([300.0], 1.0) if size == KB else ([], None)
        peer = "budget" if budget else ""
        table.add(Row(f"lock-step {name}", "per step", "us", over, peer, budget, target))


def footprint(bench: cases.Bench, table: Table) -> None:
    """What the agent itself needs."""
    measures: list[tuple[str, str, float | None, Measure]] = [
        ("agent start to ready", "ms", 20.0, lambda: cases.start_to_ready(bench)),
        (
            "memory beyond 1 MB x 200",
            "MiB",
            16.0,
            lambda: cases.memory_beyond_bag(bench, MB, 200),
        ),
    ]
    for case, unit, budget, measure in measures:
        runs = [measure() for _ in range(RUNS)]
        theirs, target = ([budget], 1.0) if budget else ([], None)
        peer = "budget" if budget else ""
        metric = "most" if unit == "MiB" else "time"
        table.add(Row(case, metric, unit, runs, peer, theirs, target))


def versions() -> dict[str, str]:
    """What the peers are."""

    def of(package: str) -> str:
        command = ["dpkg-query", "-W", "-f", "${Version}", package]
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()

    return {
        "python": platform.python_version(),
        "roscpp": of("libroscpp-dev"),
        "rosbag": of("librosbag4d"),
    }


PARTS = {
    "sinks": sinks,
    "nodes": nodes,
    "recorders": recorders,
    "steps": steps,
    "footprint": footprint,
}


def measure() -> tuple[list[Row], dict[str, str], str]:
    """All parts: rows, the peers' versions, and a note on how it was measured."""
    # In memory: what is measured is no disk.
    folder = Path(tempfile.mkdtemp(prefix="bagpipe-play-", dir="/dev/shm"))
    table = Table()
    try:
        bench = cases.Bench(agent(), folder)
        for part in PARTS.values():
            part(bench, table)
    finally:
        shutil.rmtree(folder)
    note = f"Each case beside its peer in turns, {RUNS} runs, bags in memory; medians."
    return table.rows, versions(), note
