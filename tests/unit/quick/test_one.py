import subprocess
import sys
from pathlib import Path

import pytest
from watchfiles import Change

from tests.quick.affected import read
from tests.quick.one import one
from tests.quick.watch import SAVED, check_each

ROOT = Path(__file__).parents[3]
CARGO = ["cargo", "test", "--locked", "--workspace"]


@pytest.mark.parametrize(
    ("test", "folder", "command"),
    [
        ("tests/a/test_b.py::test_c", ".",
         [sys.executable, "-m", "pytest", "-n", "0", "tests/a/test_b.py::test_c"]),
        ("images/agent/crates/replay/tests/rest.rs::a_b", "images/agent",
         [*CARGO, "--test", "rest", "--", "a_b"]),
        ("images/agent/crates/replay/tests/rest.rs", "images/agent",
         [*CARGO, "--test", "rest", "--"]),
        ("images/agent/crates/wire/src/frame.rs::tests::a_b", "images/agent",
         [*CARGO, "--lib", "--bins", "--", "tests::a_b"]),
    ],
)  # fmt: skip
def test_a_test_is_run_by_what_runs_all_of_its_kind(
    test: str, folder: str, command: list[str]
) -> None:
    assert one(test) == (folder, command)


def test_a_file_that_is_not_there_is_refused_before_anything_runs() -> None:
    command = [sys.executable, "-m", "tests.quick.one", "tests/unit/test_nothing.py::test_a"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "No such file: tests/unit/test_nothing.py::test_a" in done.stdout


def test_each_save_is_checked_once_and_the_first_check_waits_for_none(tmp_path: Path) -> None:
    log = tmp_path / "log"
    write = [sys.executable, "-c", f"open({str(log)!r}, 'a').write('x')"]
    check_each([], write)
    assert log.read_text() == "x"
    check_each([{"a"}, {"b", "c"}], write)
    assert log.read_text() == "xxxx"


def test_every_source_is_watched_and_nothing_that_a_check_writes() -> None:
    sources = [*read(ROOT).texts, Path("images/agent/crates/wire/src/frame.rs")]
    assert Path("images/build/build.py") in sources
    assert [path for path in sources if not SAVED(Change.modified, str(ROOT / path))] == []
    written = ("images/agent/target/debug/build/a.rs", "tests/__pycache__/hanging.pyc")
    assert not any(SAVED(Change.modified, str(ROOT / name)) for name in written)
