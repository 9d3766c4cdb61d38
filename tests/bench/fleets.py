"""`make bench BENCH=fleets`: one driver with many executors, and the loss of a third at once.

Up to 64 of Spark's own executors, a process each, and up to thousands that are simulated: they
register, take tasks, answer them and send heartbeats by Spark's own messages, each over a
connection of its own, and run nothing. The driver is a job's own, with its settings, its JVM's
memory, journal and rows; of Kubernetes it has nothing. Where both kinds have 64, what one case
costs the driver says how far simulated ones can be trusted. BENCH_SCALE=0.1 makes all smaller.
"""

import os
import platform
from collections.abc import Callable, Sequence

import pyspark

from tests.bench.fleet.driver import Measured, in_its_own_process
from tests.bench.rows import Row

SCALE = float(os.environ.get("BENCH_SCALE", "1"))
REAL = tuple(max(3, int(SCALE * count)) for count in (8, 64))
SIMULATED = tuple(max(3, int(SCALE * count)) for count in (64, 250, 1000, 2000))
RUNS = int(os.environ.get("BENCH_RUNS", "3"))
CASES = max(100, int(SCALE * 20_000))
# As many for each as let a third of them be lost in the midst of it.
LOST_CASES, LOST_SECONDS = 4, 2.0
REST_SECONDS = 20.0
Figure = Callable[[Measured], float]
METRICS: Sequence[tuple[str, str, Figure]] = (
    ("until all had come", "s", lambda found: found.came),
    ("driver at rest, of one processor", "%", lambda found: 100 * found.resting),
    ("cases that do nothing", "cases/s", lambda found: found.cases / found.ran),
    ("driver's processor time for a case", "ms", lambda found: 1e3 * found.used / found.cases),
    ("driver's JVM memory", "MiB", lambda found: found.jvm),
    ("driver's Python memory", "MiB", lambda found: found.python),
)


def measure() -> tuple[list[Row], dict[str, str], str]:
    """The rows, what was measured with, and what it means."""
    real = {count: _runs("real", count) for count in REAL}
    simulated = {count: _runs("simulated", count) for count in SIMULATED}
    rows = [row for count, runs in real.items() for row in _rows(f"{count:,} executors", runs)]
    for count, runs in simulated.items():
        peer = f"{count:,} executors" if count in real else ""
        rows += _rows(f"{count:,} simulated", runs, peer, real.get(count, []))
    rows += [*_loss("real", REAL[-1]), *_loss("simulated", SIMULATED[2])]
    versions = {"pyspark": pyspark.__version__, "python": platform.python_version()}
    note = (
        f"{CASES:,} cases that do nothing, a tenth of them for up to {REAL[-1]} executors;"
        f" {RUNS} runs each; a third is lost once half of the cases have ended, which are"
        f" {LOST_CASES} of {LOST_SECONDS} s for each executor."
    )
    return rows, versions, note


def _runs(kind: str, count: int) -> list[Measured]:
    # As many where both kinds are measured.
    cases = CASES if count > REAL[-1] else CASES // 10
    found = [in_its_own_process(kind, count, cases, rest=REST_SECONDS) for _ in range(RUNS)]
    print(f"  {count} {kind}: {cases} cases in {found[0].ran:.1f} s", flush=True)
    return found


def _rows(
    what: str, runs: Sequence[Measured], peer: str = "", others: Sequence[Measured] = ()
) -> list[Row]:
    return [
        Row(what, metric, unit, [figure(run) for run in runs], peer, [figure(o) for o in others])
        for metric, unit, figure in METRICS
    ]


def _loss(kind: str, count: int) -> list[Row]:
    found = [
        in_its_own_process(kind, count, LOST_CASES * count, LOST_SECONDS, lose=True)
        for _ in range(RUNS)
    ]
    what = f"{count:,} {'executors' if kind == 'real' else 'simulated'}, a third lost"
    least = [LOST_SECONDS * (LOST_CASES / 2) * count / (count - run.lost) for run in found]
    noticed, ended = [run.noticed for run in found], [run.after_the_loss for run in found]
    return [
        Row(what, "executors lost", "executors", [run.lost for run in found], "", []),
        Row(what, "until the driver counts on the rest", "s", noticed, "", []),
        Row(what, "until all cases ended", "s", ended, "their own time on the rest", least),
    ]
