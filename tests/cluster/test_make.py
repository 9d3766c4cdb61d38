"""The Makefile's graph: what is asked for has all that it needs, from an empty folder."""

from __future__ import annotations

import os
import re
import subprocess
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CRATES = ROOT / "images/agent/crates"


def made(*arguments: str) -> str:
    """What make would do, as text."""
    environment = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    command = ["make", "--dry-run", "--always-make", *arguments]
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=60, check=True
    )
    return done.stdout


def test_the_first_verdict_has_what_reads_recordings() -> None:
    # The demonstration on an empty machine ended here: planning reads bags by the native module.
    text = made("first-verdict")
    module = text.index("Building bagpipe.MemoryBag into .venv")
    assert module < text.index("Running the demonstration's job without Kubernetes")


def crates_of(name: str) -> set[str]:
    """A crate's folder and those of all that it needs of the workspace."""
    manifest = tomllib.loads((CRATES / name / "Cargo.toml").read_text())
    needed = (each.removeprefix("bagpipe-") for each in manifest["dependencies"])
    inner = [each for each in needed if (CRATES / each / "Cargo.toml").exists()]
    return {name}.union(*(crates_of(each) for each in inner))


def test_a_change_of_each_crate_of_the_native_module_builds_it_again() -> None:
    text = subprocess.run(
        ["make", "--dry-run", "--print-data-base", "help"],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=False,
    ).stdout  # fmt: skip
    line = re.search(r"^\.venv/\.memory-bag: (.*)$", text, re.MULTILINE)
    assert line is not None
    listed = set(re.findall(r"images/agent/crates/(\w+)/src/lib\.rs", line[1]))
    assert listed == crates_of("python") >= {"python", "log", "rosbag", "mcap"}
