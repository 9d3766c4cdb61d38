"""How often the gate errs: liars that pass, honest stacks that are refused, and false alarms.

The stacks of tests/liars run beside a busy loop on every processor, BENCH_ROUNDS times (20 by
default); BENCH_ROWS=name,name runs only these. What is simulated of comparisons needs no machine.
BENCH_LOADS=liars or comparison runs one of the two.
"""

import contextlib
import importlib
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bagpipe.run.with_parent import die_with_parent
from tests.bench.gate_tally import Tally, answer_of
from tests.bench.play_graph import CACHE, agent
from tests.bench.rows import Load, Row
from tests.liars.army import Army
from tests.liars.table import ROWS

ROUNDS = 20
# A round takes some minutes; a loop that nobody ends, ends itself.
ROUND_SECONDS = 3600
LOOP = """
import sys, time
end = time.monotonic() + float(sys.argv[1])
while time.monotonic() < end:
    pass
"""
NOTE = (
    "Each stack of tests/liars is run in every round, beside one busy loop for each processor."
    " A liar that passes, and an honest stack that is failed or invalid, is an error of the gate."
    " What errored has no answer: it is neither good nor bad. It is counted apart,"
    " since a machine too busy for an answer has to say so. Intervals are exact ones of 95 %"
    " (Clopper and Pearson); runs of one stack are not independent, so they are too narrow where a"
    " row flips."
)


def about() -> tuple[dict[str, str], str]:
    """What was measured with, and what one must know to read it."""
    return {"python": platform.python_version(), "rows": str(len(ROWS))}, NOTE


def kept() -> bool:
    """A part of the table, or of the rounds, is a try."""
    return not {"BENCH_ROUNDS", "BENCH_ROWS"} & set(os.environ)


def loads() -> Iterator[Load]:
    """The liars' error rates, then those of comparisons."""
    wanted = os.environ.get("BENCH_LOADS", "liars,comparison").split(",")
    if "liars" in wanted:
        yield _guarded("liars", liars)
    if "comparison" in wanted:
        yield _guarded("comparison", comparison)


def _guarded(name: str, measure: Any) -> Load:
    try:
        return Load(name, measure())
    except (AssertionError, OSError, ImportError, subprocess.SubprocessError) as fault:
        return Load(name, failure=f"{type(fault).__name__}: {fault}")


def comparison() -> list[Row]:
    """False alarms and power, as gate_comparison.py simulates them."""
    measured: list[Row] = importlib.import_module("tests.bench.gate_comparison").rows()
    return measured


def liars() -> list[Row]:
    """Runs the table round by round and prints both error rates."""
    names = set(filter(None, os.environ.get("BENCH_ROWS", "").split(",")))
    chosen = [row for row in ROWS if not names or row.name in names]
    tally = Tally(chosen)
    for number in range(int(os.environ.get("BENCH_ROUNDS", ROUNDS))):
        with tempfile.TemporaryDirectory(prefix="gate-") as folder, busy():
            army = Army(Path(folder), agent(), CACHE.parent / "liars")
            try:
                army.start(chosen)
                tally.add({row.name: answer_of(army, row) for row in chosen})
            finally:
                army.end()
        print(f"    round {number + 1}: {tally.headline()}", file=sys.stderr, flush=True)
    print(f"\n{tally.report()}", flush=True)
    return tally.rows()


@contextlib.contextmanager
def busy() -> Iterator[None]:
    """A busy loop for each processor, as long as the block lasts."""
    command = [sys.executable, "-c", LOOP, str(ROUND_SECONDS)]
    loops = [
        subprocess.Popen(command, preexec_fn=die_with_parent)  # noqa: PLW1509  one system call
        for _ in os.sched_getaffinity(0)
    ]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
