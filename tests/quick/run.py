"""Check a change in less than a minute: its style, and the unit tests nearest to it.

    python -m tests.quick.run [--since COMMIT] [--seconds N]

A change is what differs from COMMIT (HEAD by default), files that git does not know included. The
unit tests run nearest first; those for which no time is left are named, and `make test` has them.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

from tests.quick.affected import affected, read

ROOT = Path(__file__).parents[2]
SECONDS = 45.0


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--since", default="HEAD", help="the commit to compare with")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="begin no tests later")
    given = parser.parse_args()
    begun = time.monotonic()
    changed = changes(given.since)
    if not changed:
        print(f"Nothing differs from {given.since}.")
        return 0
    print(f"{len(changed)} files differ from {given.since}.")
    status = style(changed)
    tests = affected(read(ROOT), changed)
    for distance in sorted(set(tests.values())):
        batch = sorted(str(test) for test, far in tests.items() if far == distance)
        if time.monotonic() - begun > given.seconds:
            print(f"no time for {len(batch)} files of tests that are {distance} imports away")
            continue
        print(f"--- {len(batch)} files of tests, {distance} imports away", flush=True)
        status |= run(sys.executable, "-m", "pytest", "-q", "--no-header", *batch)
    print(f"{'FAILED' if status else 'good'} after {time.monotonic() - begun:.0f} s")
    return min(status, 1)


def changes(since: str) -> set[Path]:
    """What differs from a commit and is still there, and what git does not know yet."""
    known = _git("diff", "--name-only", "-z", "--diff-filter=d", since, "--")
    unknown = _git("ls-files", "--others", "--exclude-standard", "-z")
    return {Path(name) for name in (known + unknown).split("\0") if name}


def style(changed: set[Path]) -> int:
    """0 where ruff, mypy and rustfmt have nothing to say about a change."""
    python = sorted(str(path) for path in changed if path.suffix == ".py")
    status = 0
    if python:
        status |= run("ruff", "check", *python) | run("ruff", "format", "--check", *python)
    if any(path.startswith(("images/spark", "operator/")) for path in python):
        status |= run("mypy", "--package", "bagpipe", "--package", "bagpipe_operator")
        status |= run("lint-imports")
    if any(path.suffix == ".rs" for path in changed):
        status |= run("cargo", "fmt", "--all", "--check", folder=ROOT / "images/agent")
    return status


def run(*words: str, folder: Path = ROOT) -> int:
    """A program's status; what it prints is shown."""
    tools = str(ROOT / ".venv/bin")
    environment = os.environ | {"PATH": f"{tools}:{os.environ['PATH']}"}
    return subprocess.run(words, cwd=folder, env=environment, check=False).returncode


def _git(*words: str) -> str:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
