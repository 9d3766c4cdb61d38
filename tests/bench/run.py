"""`make bench [BENCH=name]`: runs the benches, prints each one's table, keeps its rows.

A bench is a module beside this file with `measure() -> (rows, versions, note)`; rows.py says
what a row is. Results lie in results/<name>.json. No name runs all. With --gate the exit status
is 1 when a row fell short of its target; without, a busy machine fails nothing.
"""

import importlib
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

NOT_BENCHES = {"run", "rows", "play_cases", "play_graph"}


def benches() -> list[str]:
    found = (path.stem for path in Path(__file__).parent.glob("*.py"))
    return sorted(set(found) - NOT_BENCHES)


def main(asked: list[str]) -> int:
    gate = "--gate" in asked
    asked = [word for word in asked if word != "--gate"]
    unknown = set(asked) - set(benches())
    if unknown:
        print(f"no bench {', '.join(sorted(unknown))}; there are: {', '.join(benches())}")
        return 2
    missed = False
    for name in asked or benches():
        missed |= run(name)
    return int(missed and gate)


def run(name: str) -> bool:
    """Runs one bench; True when a target was missed."""
    convention = importlib.import_module("tests.bench.rows")
    rows, versions, note = importlib.import_module(f"tests.bench.{name}").measure()
    path = convention.write(name, rows, versions, note)
    print(f"\n{note}\n\n{convention.table(rows)}\n")
    short = [row for row in rows if row.missed]
    for row in short:
        print(f"short of its target: {row.case}, {row.metric}, beside {row.peer}")
    print(f"{len(rows)} rows in {path.relative_to(ROOT)}")
    return bool(short)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
