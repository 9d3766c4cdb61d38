"""The installed release bagpipe: helm, its values, and how to bring it back to what it was."""

import json
import subprocess
from pathlib import Path

import pytest

from tests.e2e import kubectl as k

CHART = Path(__file__).parents[2] / "charts/bagpipe"
SYSTEM = "bagpipe-system"
OPERATOR = "bagpipe-operator"


def helm(*words: str, seconds: float = 360) -> str:
    """What helm prints, in the release's namespace."""
    done = subprocess.run(
        ["helm", *words, "--namespace", SYSTEM],
        capture_output=True,
        text=True,
        timeout=seconds,
        env=k.tool_environment(),
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def installed() -> str:
    """The chart and version of the release, as bagpipe-0.2.0; empty without one."""
    found = json.loads(helm("list", "--filter", "^bagpipe$", "-o", "json"))
    return str(found[0]["chart"]) if found else ""


def keep_values(folder: Path) -> Path:
    """A file with the values that the release was given. Skips the test without a release."""
    if not installed():
        pytest.skip(f"no release bagpipe in namespace {SYSTEM}: make install")
    values = folder / "values.yaml"
    values.write_text(helm("get", "values", "bagpipe", "-o", "yaml"))
    return values


def upgrade(values: Path, *more: str) -> None:
    """Bring the release to this checkout's chart, and wait until its operator is ready."""
    wait = ("--wait", "--timeout", "5m")
    helm("upgrade", "--install", "bagpipe", str(CHART), "-f", str(values), *more, *wait)
