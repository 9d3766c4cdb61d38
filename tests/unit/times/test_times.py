"""The reported times of the tests are those that they took, and tests of a lane run together."""

import gzip
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import TIMES, pytest_make_parametrize_id
from tests.times import Meter, table

ROOT = Path(__file__).parents[3]


def test_a_table_has_sums_of_files_and_the_longest_tests() -> None:
    lines = [
        json.dumps({"test": name, "seconds": seconds, "processor": used})
        for name, seconds, used in (
            ("a.py::one", 1.25, 1.0), ("a.py::two[x::y]", 2.0, 0.5), ("b.py::three", 3.0, 0.25),
        )
    ]  # fmt: skip
    assert table(lines, 2).splitlines() == [
        "| file | tests | seconds | of a processor |",
        "|---|---|---|---|",
        "| a.py | 2 | 3.2 | 1.5 |",
        "| b.py | 1 | 3.0 | 0.2 |",
        "| all 2 files | 3 | 6.2 | 1.8 |",
        "",
        "| test | seconds | of a processor |",
        "|---|---|---|",
        "| b.py::three | 3.0 | 0.2 |",
        "| a.py::two[x::y] | 2.0 | 0.5 |",
    ]


def test_a_meter_counts_the_processes_that_were_waited_for() -> None:
    meter = Meter()
    busy = "import time\nwhile time.process_time() < 0.3: pass"
    subprocess.run([sys.executable, "-c", busy], check=True, timeout=60)
    took = meter.read()
    assert took["processor"] >= 0.3
    assert took["seconds"] >= 0.3


@pytest.mark.parametrize("value", [gzip.compress(b"{"), b"\xff", b"\x00", b"two\nlines"])
def test_bytes_that_cant_be_read_name_no_test(value: bytes, request: pytest.FixtureRequest) -> None:
    """Two collections of a gzip file, in different seconds, had tests of different names."""
    assert re.fullmatch(r".*\[value\d\]", request.node.name)
    assert pytest_make_parametrize_id(value, "value") == "value"


@pytest.mark.parametrize("value", [b"", b"a word", "\x00", 7])
def test_what_can_be_read_names_its_test(value: object) -> None:
    assert pytest_make_parametrize_id(value, "value") is None


def test_a_lane_runs_in_one_process(tmp_path: Path) -> None:
    """As `make test` calls pytest: a scheduler that groups nothing would pass all other tests."""
    (tmp_path / "tests/integration/storage").mkdir(parents=True)
    shutil.copy(ROOT / "tests/conftest.py", tmp_path / "tests/conftest.py")
    for name in ("integration/storage/test_a", "integration/storage/test_b", "test_c", "test_d"):
        tests = "\n".join(f"def test_{n}(): pass" for n in range(8))
        (tmp_path / f"tests/{name}.py").write_text(tests)
    makefile = (ROOT / "Makefile").read_text()
    words = re.search(r"^BESIDE := --numprocesses .* (--dist \w+)$", makefile, re.MULTILINE)
    assert words
    options = ["--numprocesses", "3", *words[1].split()]
    environment = {name: value for name, value in os.environ.items() if name != TIMES}
    environment["BAGPIPE_CACHE"] = str(tmp_path / "cache")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-v", "--rootdir", ".", *options, "tests"],
        cwd=tmp_path, env=environment | {"PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    ran = re.findall(r"\[(gw\d)\].* PASSED .*test_([abcd])\.py", done.stdout)
    assert len(ran) == 32, done.stdout + done.stderr
    by_file: dict[str, set[str]] = {}
    for process, file in ran:
        by_file.setdefault(file, set()).add(process)
    assert [len(processes) for processes in by_file.values()] == [1, 1, 1, 1]
    assert by_file["a"] == by_file["b"]
    assert len({process for process, _ in ran}) == 3
    kept = {path.name for path in (tmp_path / "cache/lanes").iterdir()}
    assert kept == {"tests-integration-storage", "tests-test_c.py", "tests-test_d.py"}
