"""`pip install` brings no native module: what needs no bag in memory works without it."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[3] / "docs/examples"
RUN = """
import sys
sys.modules["bagpipe_bag"] = None
from bagpipe.cli.__main__ import main
main(sys.argv[1:], prog_name="bagpipe")
"""


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", RUN, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_a_plan_is_shown() -> None:
    done = run("plan", str(EXAMPLES / "barrier-car/job.yaml"))
    assert done.returncode == 0, done.stderr
    assert "54 cases" in done.stdout


@pytest.mark.parametrize("verb", ["results", "report"])
def test_a_folder_without_results_is_reported_and_no_module_is_missed(
    verb: str, tmp_path: Path
) -> None:
    done = run(verb, str(tmp_path))
    assert done.returncode == 2
    assert "manifest.json" in done.stderr
    assert "bagpipe_bag" not in done.stderr
