"""What PYTHONPATH has of others is not taken for the packages that Bagpipe was installed with."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
OURS = [str(ROOT / "images/spark/src"), str(ROOT / "operator/src")]
SLOT = """
from bagpipe.driver import own_packages_first, slot_server
slot = slot_server.forks().Process(target=exec, args=("import numpy, rclpy; print(rclpy.place)",))
slot.start()
slot.join(60)
raise SystemExit(slot.exitcode)
"""


@pytest.fixture
def theirs(tmp_path: Path) -> str:
    """A folder of packages with a NumPy that can't be ours, and one package of its own."""
    (tmp_path / "numpy").mkdir()
    (tmp_path / "numpy/__init__.py").write_text("raise ImportError('too old')\n")
    (tmp_path / "rclpy.py").write_text("place = __file__\n")
    return str(tmp_path)


@pytest.mark.parametrize("added", ["bagpipe_engines", "bagpipe_sources", ""])
@pytest.mark.parametrize(
    "script",
    ["import bagpipe.cli, numpy, rclpy; print(rclpy.place)", SLOT],
    ids=["program", "slot"],
)
def test_own_packages_are_taken_and_those_of_others_still_found(
    theirs: str, tmp_path: Path, script: str, added: str
) -> None:
    """Also where an engine or a source that somebody adds comes first."""
    more = tmp_path / "more"
    (more / (added or "nothing") / "toy").mkdir(parents=True)
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([theirs, str(more), *OURS])},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert (done.returncode, done.stdout) == (0, f"{theirs}/rclpy.py\n"), done.stderr


@pytest.mark.parametrize("added", ["bagpipe_engines", "bagpipe_sources"])
def test_what_adds_an_engine_or_a_source_stays_in_front(tmp_path: Path, added: str) -> None:
    (tmp_path / added).mkdir()
    done = subprocess.run(
        [sys.executable, "-c", "import bagpipe.cli, sys; print(sys.path[1])"],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *OURS])},
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    assert done.stdout == f"{tmp_path}\n"
