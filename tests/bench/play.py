"""`make bench BENCH=play`: how fast and how exactly the agent plays and records.

Each case runs beside its peer, in turns, in one run of this program; a ratio is of two
medians. Writes tests/bench/results/play.json and prints a table.
"""

import json
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import play_cases as cases
from play_graph import HERE, ROOT, agent

RUNS = 3
KB, MB = 1024, 1 << 20
SMALL, LARGE = 300_000, 1_500
RATES = (2_500, 5_000, 10_000, 20_000, 80_000)
Measure = Callable[[], float]


@dataclass(frozen=True)
class Row:
    """A line of the results, in the form that all benches share."""

    case: str
    metric: str
    unit: str
    ours: list[float]
    peer: str
    theirs: list[float]
    ratio: float | None
    target: float | None


class Table:
    """Rows, printed as they come."""

    def __init__(self) -> None:
        self.rows: list[Row] = []
        titles = ("case", "unit", "ours (min-max)", "theirs (min-max)", "ratio", "target")
        print("{:<46} {:<8} {:>27} {:>27} {:>6} {:>6}  peer".format(*titles), flush=True)

    def add(self, row: Row) -> None:
        """Keeps and prints a row."""
        self.rows.append(row)
        ratio = "" if row.ratio is None else f"{row.ratio:.2f}"
        target = "" if row.target is None else f"{row.target:g}"
        name = f"{row.case}, {row.metric}"
        print(
            f"{name:<46} {row.unit:<8} {spread(row.ours):>27} {spread(row.theirs):>27} "
            f"{ratio:>6} {target:>6}  {row.peer}",
            flush=True,
        )


def spread(runs: list[float]) -> str:
    """Median and extremes."""
    if not runs:
        return "-"
    return f"{statistics.median(runs):,.5g} ({min(runs):,.4g}-{max(runs):,.4g})"


def beside(ours: Measure, theirs: Measure) -> tuple[list[float], list[float]]:
    """Both, in turns, and oftener than the rest: they take a second and vary most."""
    pairs = [(ours(), theirs()) for _ in range(5)]
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def ratio(ours: list[float], theirs: list[float]) -> float | None:
    """Of the medians; larger is better."""
    base = statistics.median(theirs)
    return statistics.median(ours) / base if base > 0 else None


def sinks(bench: cases.Bench, table: Table) -> None:
    """To a program that only reads its socket."""
    for name, size, messages in (("1 KB", KB, 4 * SMALL), ("1 MB", MB, LARGE)):
        ours, theirs = beside(
            lambda s=size, n=messages: cases.sink_play(bench, s, n).rate(),  # type: ignore[misc]
            lambda s=size, n=messages: cases.sink_bare(bench, s, n).rate(),  # type: ignore[misc]
        )
        peer = "bare writev loop"
        row = Row(f"play {name} to a sink", "rate", "msg/s", ours, peer, theirs, None, 0.8)
        table.add(Row(**{**asdict(row), "ratio": ratio(ours, theirs)}))


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
            table.add(Row(case, "rate", "msg/s", rates[0], label, rates[1], ratio(*rates), wanted))
            gone = [float(messages - run.received) for run in theirs]
            table.add(Row(case, "lost", "messages", lost, label, gone, None, None))


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
        table.add(
            Row(case, "lost", "messages", lost[True], "rosbag record", lost[False], None, None)
        )
        for ours, losses in lost.items():
            if not any(losses):
                lossless[ours].append(statistics.median(run.rate() for run in runs[ours]))
    peer = "rosbag record"
    if not any(lossless[False]):
        # It lost some at every rate: the slowest one is an upper bound, in its favour.
        lossless[False] = [float(min(RATES))]
        peer += f" (lost some even at {min(RATES):,}/s)"
    best, base = [max(lossless[True])], [max(lossless[False])]
    row = Row("record 1 KB", "lossless rate", "msg/s", best, peer, base, None, 10.0)
    table.add(Row(**{**asdict(row), "ratio": ratio(best, base)}))


def steps(bench: cases.Bench, table: Table) -> None:
    """What lock-step adds to a node's own time."""
    for size, name in ((KB, "1 KB"), (MB, "1 MB")):
        runs = [cases.lockstep(bench, size, 2_000 if size == KB else 500) for _ in range(RUNS)]
        over = [run.whole - run.own for run in runs]
        budget, target = ([300.0], 1.0) if size == KB else ([], None)
        better = budget[0] / statistics.median(over) if budget else None
        peer = "budget" if budget else ""
        table.add(Row(f"lock-step {name}", "per step", "us", over, peer, budget, better, target))


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
        better = budget / statistics.median(runs) if budget else None
        peer = "budget" if budget else ""
        table.add(
            Row(case, "most" if unit == "MiB" else "time", unit, runs, peer, theirs, better, target)
        )


def machine() -> dict[str, str]:
    """Where and with what it was measured."""

    def version(*command: str) -> str:
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
        return done.stdout.strip().splitlines()[0] if done.stdout.strip() else "unknown"

    model = [
        line for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line
    ]
    return {
        "processors": str(len(model)),
        "model": model[0].split(":", 1)[1].strip() if model else "unknown",
        "kernel": platform.release(),
        "python": platform.python_version(),
        "roscpp": version("dpkg-query", "-W", "-f", "${Version}", "libroscpp-dev"),
        "rosbag": version("dpkg-query", "-W", "-f", "${Version}", "rosbag"),
        "commit": version("git", "rev-parse", "HEAD"),
    }


PARTS = {
    "sinks": sinks,
    "nodes": nodes,
    "recorders": recorders,
    "steps": steps,
    "footprint": footprint,
}


def main(arguments: list[str] | None = None) -> int:
    """Measures all parts, or those that are named; the exit status tells of missed targets."""
    chosen = (sys.argv[1:] if arguments is None else arguments) or list(PARTS)
    unknown = [name for name in chosen if name not in PARTS]
    if unknown:
        print(f"no part {unknown[0]!r}; there are {', '.join(PARTS)}", file=sys.stderr)
        return 2
    # In memory: what is measured is no disk.
    folder = Path(tempfile.mkdtemp(prefix="bagpipe-play-", dir="/dev/shm"))
    try:
        bench, table = cases.Bench(agent(), folder), Table()
        for name in chosen:
            PARTS[name](bench, table)
    finally:
        shutil.rmtree(folder)
    results = HERE / "results" / "play.json"
    results.parent.mkdir(exist_ok=True)
    rows = [asdict(row) for row in table.rows]
    results.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1) + "\n")
    missed = [r for r in table.rows if r.target and (r.ratio is None or r.ratio < r.target)]
    for row in missed:
        print(f"below its target: {row.case}, {row.metric}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
