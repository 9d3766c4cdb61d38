"""What each test took, of the clock and of the processors.

    BAGPIPE_TEST_TIMES=FILE make test
    python -m tests.times FILE [--longest N]

What servers use that outlive a test counts for the test that ends them.
"""

import argparse
import json
import resource
import time
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path


def processor_seconds() -> float:
    """Of this process and of those that it has waited for."""
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(used.ru_utime + used.ru_stime for used in map(resource.getrusage, kinds))


@dataclass(frozen=True)
class Meter:
    """Counts from its making on."""

    begun: float = field(default_factory=time.monotonic)
    used: float = field(default_factory=processor_seconds)

    def read(self) -> dict[str, float]:
        """Seconds of the clock and of a processor until now."""
        return {
            "seconds": round(time.monotonic() - self.begun, 3),
            "processor": round(processor_seconds() - self.used, 3),
        }


def table(lines: Iterable[str], longest: int) -> str:
    """Folders or files with their sums, then the longest tests, each as a row of Markdown."""
    tests = [json.loads(line) for line in lines]
    sums: dict[str, list[float]] = defaultdict(lambda: [0, 0.0, 0.0])
    for test in tests:
        of = sums[test["test"].partition("::")[0]]
        of[0] += 1
        of[1] += test["seconds"]
        of[2] += test["processor"]
    rows = ["| file | tests | seconds | of a processor |", "|---|---|---|---|"]
    for name, (count, took, used) in sorted(sums.items(), key=lambda row: -row[1][1])[:longest]:
        rows.append(f"| {name} | {count:.0f} | {took:.1f} | {used:.1f} |")
    took, used = (sum(test[key] for test in tests) for key in ("seconds", "processor"))
    rows.append(f"| all {len(sums)} files | {len(tests)} | {took:.1f} | {used:.1f} |")
    rows += ["", "| test | seconds | of a processor |", "|---|---|---|"]
    for test in sorted(tests, key=lambda test: -test["seconds"])[:longest]:
        rows.append(f"| {test['test']} | {test['seconds']:.1f} | {test['processor']:.1f} |")
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path)
    parser.add_argument("--longest", type=int, default=30, help="as many files, and tests")
    given = parser.parse_args()
    print(table(given.file.read_text().splitlines(), given.longest))


if __name__ == "__main__":
    main()
