"""What PYTHONPATH has of others is not taken for the packages that Bagpipe was installed with."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bagpipe.own_packages import own_environment_of

ROOT = Path(__file__).parents[3]
OURS = [str(ROOT / "images/spark/src"), str(ROOT / "operator/src")]


@pytest.fixture
def theirs(tmp_path: Path) -> str:
    """A folder of packages with a NumPy that can't be ours, and one package of its own."""
    (tmp_path / "numpy").mkdir()
    (tmp_path / "numpy/__init__.py").write_text("raise ImportError('too old')\n")
    (tmp_path / "rclpy.py").write_text("place = __file__\n")
    return str(tmp_path)


def test_the_program_takes_its_own_packages_and_still_finds_those_of_others(theirs: str) -> None:
    script = "import bagpipe.cli, numpy, rclpy; print(rclpy.place)"
    path = os.pathsep.join([theirs, *OURS])
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert (done.returncode, done.stdout) == (0, f"{theirs}/rclpy.py\n"), done.stderr


def test_a_program_of_ours_is_given_what_is_ours_of_the_path(theirs: str) -> None:
    given = {"PYTHONPATH": os.pathsep.join([theirs, OURS[0], "", OURS[1]]), "HOME": "/h"}
    assert own_environment_of(given) == {"PYTHONPATH": os.pathsep.join(OURS), "HOME": "/h"}
    assert own_environment_of({"PYTHONPATH": theirs, "HOME": "/h"}) == {"HOME": "/h"}
    assert own_environment_of({"HOME": "/h"}) == {"HOME": "/h"}
