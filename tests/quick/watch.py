"""Check a change whenever a file is saved, until Ctrl-C: `make watch`.

python -m tests.quick.watch [--since COMMIT]
"""

import argparse
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from watchfiles import DefaultFilter, watch

ROOT = Path(__file__).parents[2]
# Cargo writes there while a check runs; a whole path, since a folder of sources may be called so.
SAVED = DefaultFilter(ignore_paths=[ROOT / "images/agent/target"])
FOLDERS = ("charts", "crds", "docs", "images", "operator", "tests")


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--since", default="HEAD", help="the commit to compare with")
    given = parser.parse_args()
    saved = watch(
        *(ROOT / folder for folder in FOLDERS),
        watch_filter=SAVED,
        raise_interrupt=False,
    )
    check_each(saved, [sys.executable, "-m", "tests.quick.run", "--since", given.since])
    return 0


def check_each(saved: Iterable[object], command: list[str]) -> None:
    """Run the command at once, and again after each group of saved files."""
    subprocess.run(command, cwd=ROOT, check=False)
    for _ in saved:
        print("\n--- saved", flush=True)
        subprocess.run(command, cwd=ROOT, check=False)


if __name__ == "__main__":
    sys.exit(main())
