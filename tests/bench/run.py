"""`make bench [BENCH=name]`: runs the benches, prints each one's table, keeps its rows.

A bench is a module beside this file with `measure() -> (rows, versions, note)`; rows.py says
what a row is. One whose loads do not depend on each other has `loads() -> iterator of Load`,
`about() -> (versions, note)` and `kept() -> bool` instead: the rows of each load are printed, and
kept unless the run was a small one, as soon as they are there. Results lie in
results/<name>.json. No name runs all but those in
ELSEWHERE. The exit status is 1 when a load failed, and with --gate
when a row fell short of its target; without, a busy machine fails nothing.
"""

import importlib
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests/cluster"), str(ROOT / "images/build")]

NOT_BENCHES = {
    "run",
    "rows",
    "play_cases",
    "play_graph",
    "scale_fleet",
    "scale_model",
    "scale_planning",
    "cache_ways",
    "gate_comparison",
    "gate_tally",
    "start_seen",
}
# They need what no Debian has, or a cluster that runs: measured where they are asked for.
ELSEWHERE = {"ros2", "start", "tail"}
# A module of the bench's own name would hide one of Python's.
MODULES = {"operator": "operator_bench"}


def benches() -> list[str]:
    found = {path.stem for path in Path(__file__).parent.glob("*.py")}
    parts = {stem for stem in found if stem.startswith("operator_")}
    return sorted(found - NOT_BENCHES - parts | set(MODULES))


def main(asked: list[str]) -> int:
    gate = "--gate" in asked
    asked = [word for word in asked if word != "--gate"]
    unknown = set(asked) - set(benches())
    if unknown:
        print(f"no bench {', '.join(sorted(unknown))}; there are: {', '.join(benches())}")
        return 2
    missed = failed = False
    for name in asked or sorted(set(benches()) - ELSEWHERE):
        found = run(name)
        missed, failed = missed | found.missed, failed | found.failed
    return int(failed or (missed and gate))


@dataclass(frozen=True)
class Outcome:
    """Whether a row of a bench fell short of its target, and whether a load gave none at all."""

    missed: bool
    failed: bool = False


def run(name: str) -> Outcome:
    """Runs one bench."""
    convention = importlib.import_module("tests.bench.rows")
    bench = importlib.import_module(f"tests.bench.{MODULES.get(name, name)}")
    if hasattr(bench, "loads"):
        return run_loads(name, bench, convention)
    rows, versions, note = bench.measure()
    path = convention.write(name, rows, versions, note)
    print(f"\n{note}\n\n{convention.table(rows)}\n")
    _say_short(rows)
    print(f"{len(rows)} rows in {_shown(path)}")
    return Outcome(any(row.missed for row in rows))


def run_loads(name: str, bench: Any, convention: Any) -> Outcome:
    """Runs the loads of a bench one after the other; one that fails costs the others nothing."""
    versions, note = bench.about()
    print(f"\n{note}", flush=True)
    rows, failures = [], []
    for load in bench.loads():
        if load.failure:
            failures.append(f"{load.name} gave no rows: {load.failure}")
            print(f"\n{failures[-1]}", flush=True)
            continue
        rows += load.rows
        print(f"\n{load.name}\n\n{convention.table(load.rows)}\n", flush=True)
        if bench.kept():
            path = convention.merge(name, load.rows, versions, note)
            print(f"{len(load.rows)} rows put into {_shown(path)}", flush=True)
    print(f"\n{convention.table(rows)}\n")
    _say_short(rows)
    for failure in failures:
        print(failure)
    return Outcome(any(row.missed for row in rows), bool(failures))


def _shown(path: Path) -> Path:
    """From the checkout, but for results that go elsewhere (BENCH_RESULTS)."""
    return path.relative_to(ROOT) if path.is_relative_to(ROOT) else path


def _say_short(rows: Iterable[Any]) -> None:
    for row in rows:
        if row.missed:
            print(f"short of its target: {row.case}, {row.metric}, beside {row.peer}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
