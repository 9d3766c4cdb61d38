"""Run one test of any kind, Python's or Rust's.

    python -m tests.quick.one tests/unit/operator/test_decide.py::test_x
    python -m tests.quick.one images/agent/crates/replay/tests/rest.rs::a_test

The part after :: is left out for all tests of a file.
"""

import subprocess
import sys
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).parents[2]
WORKSPACE = "images/agent"


def main() -> int:
    """The status of pytest or cargo; 2 where the word names no test file."""
    if len(sys.argv) != 2 or not (ROOT / sys.argv[1].partition("::")[0]).is_file():
        print(f"{__doc__}\nNo such file: {' '.join(sys.argv[1:]) or 'none was given'}")
        return 2
    folder, command = one(sys.argv[1])
    return subprocess.run(command, cwd=ROOT / folder, check=False).returncode


def one(test: str) -> tuple[str, list[str]]:
    """The folder to run in, and the command, for FILE or FILE::NAME."""
    name, _, function = test.partition("::")
    path = PurePosixPath(name)
    if path.suffix != ".rs":
        return ".", [sys.executable, "-m", "pytest", "-n", "0", test]
    # With --package cargo would compile other features of the dependencies than `make test` does.
    command = ["cargo", "test", "--locked", "--workspace"]
    chosen = ["--test", path.stem] if path.parent.name == "tests" else ["--lib", "--bins"]
    return WORKSPACE, [*command, *chosen, "--", *([function] if function else [])]


if __name__ == "__main__":
    sys.exit(main())
