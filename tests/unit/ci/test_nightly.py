"""What runs at night: each part that was asked for, also after one that failed, each named."""

import os
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[3]

# In place of make: writes down what it is asked for, and fails where a file says so.
MAKE = """#!/bin/sh
echo "$*" >> "$0.asked"
! grep -qxF -- "$*" "$0.fails"
"""

ALL = [
    "test-slow",
    "down",
    "down",
    "test-nodes",
    "down",
    "test-rust",
    "stalls",
    "fuzz SECONDS=120",
    "fuzz TARGET=manifests SECONDS=1200",
    "mutants",
    "mutants-rust",
    "bench",
]


OUTCOME = re.compile(
    r"^(usage: .*|[\w-]+: passed|[\w-]+: FAILED, status \d+)(?=, \d+ s$|$)", re.MULTILINE
)


def nightly(folder: Path, *parts: str, fails: str = "") -> tuple[int, list[str], list[str]]:
    """(exit status, what make was asked for, a line for each part that ran or was refused)."""
    make = folder / "make"
    make.write_text(MAKE)
    make.chmod(0o755)
    (folder / "make.fails").write_text(f"{fails}\n")
    asked = folder / "make.asked"
    asked.unlink(missing_ok=True)
    done = subprocess.run(
        [ROOT / ".ci/nightly", *parts],
        env=os.environ | {"PATH": f"{folder}:{os.environ['PATH']}", "TMPDIR": str(folder)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    printed = done.stdout + done.stderr
    found = OUTCOME.findall(printed)
    return done.returncode, asked.read_text().splitlines() if asked.exists() else [], found


def test_all_parts_run_one_after_the_other(tmp_path: Path) -> None:
    status, asked, outcomes = nightly(tmp_path)
    assert (status, asked) == (0, ALL)
    parts = [
        "slow",
        "nodes",
        "rust",
        "stalls",
        "fuzz",
        "manifests",
        "mutants",
        "mutants-rust",
        "bench",
    ]
    assert outcomes == [f"{part}: passed" for part in parts]


def test_a_part_that_fails_ends_no_other_one_and_is_named(tmp_path: Path) -> None:
    status, asked, outcomes = nightly(tmp_path, fails="test-nodes")
    assert (status, asked) == (1, ALL)
    assert outcomes[:3] == ["slow: passed", "nodes: FAILED, status 1", "rust: passed"]


def test_parts_that_are_named_run_alone_in_their_order(tmp_path: Path) -> None:
    status, asked, outcomes = nightly(tmp_path, "mutants", "rust", fails="mutants")
    assert (status, asked) == (1, ["mutants", "test-rust"])
    assert outcomes == ["mutants: FAILED, status 1", "rust: passed"]


def test_an_unknown_part_is_refused_before_any_runs(tmp_path: Path) -> None:
    status, asked, outcomes = nightly(tmp_path, "rust", "fuzzers")
    assert (status, asked) == (2, [])
    (usage,) = outcomes
    assert usage.endswith(
        "fuzzers is none of: slow nodes rust stalls fuzz manifests mutants mutants-rust bench"
    )
