"""Runs of tests that don't start Python again: each sees the files as they are then."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.mutation import warm

PROGRAM = str(warm.__file__)


@pytest.fixture
def project(tmp_path: Path) -> Iterator[Path]:
    (tmp_path / "doubled.py").write_text("def doubled(x):\n    return x * 2\n")
    test = "import wave\nimport doubled\ndef test_it():\n    assert doubled.doubled(3) == 6\n"
    (tmp_path / "test_doubled.py").write_text(test)
    serving = subprocess.Popen(
        [sys.executable, PROGRAM, "w", "test_doubled.py"],
        cwd=tmp_path,
        env={"PYTHONPATH": ".", "PATH": "/usr/bin"},
    )
    try:
        while not (tmp_path / "w").exists():
            assert serving.poll() is None
            time.sleep(0.05)
        yield tmp_path
    finally:
        serving.kill()
        serving.wait()


def asked(project: Path) -> int:
    asking = [sys.executable, "-I", "-S", PROGRAM, "w"]
    return subprocess.run(asking, cwd=project, check=False).returncode


def test_a_run_meets_what_was_written_since_the_last_even_if_it_is_as_long(project: Path) -> None:
    assert asked(project) == 0
    for body, status in (("x * 3", 1), ("x + 3", 0), ("x - 3", 1), ("x * 2", 0)):
        (project / "doubled.py").write_text(f"def doubled(x):\n    return {body}\n")
        assert asked(project) == status


def test_a_run_is_asked_once_files_are_of_another_second() -> None:
    waits = [warm.until_another_second(now) for now in (100.0, 100.25, 100.999)]
    assert waits == pytest.approx([1.02, 0.77, 0.021])


def test_modules_from_elsewhere_are_kept_and_the_project_s_are_not(project: Path) -> None:
    kept = (project / "modules").read_text().split()
    assert "wave" in kept
    assert not {"doubled", "test_doubled", "__main__", "sys"} & set(kept)


def test_tests_that_fail_before_anything_is_broken_are_not_asked(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text("def test_it():\n    assert 0\n")
    command = [sys.executable, PROGRAM, "w", "test_it.py"]
    serving = subprocess.run(command, cwd=tmp_path, check=False, capture_output=True)
    assert serving.returncode == 1
    assert not (tmp_path / "w").exists()
