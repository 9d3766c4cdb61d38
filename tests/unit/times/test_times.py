"""What is told of the tests' times is what they took, and each test has its lane."""

import json
import subprocess
import sys

import pytest

from tests.conftest import TESTS, lane
from tests.times import Meter, table


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


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ("integration/control_plane/test_life.py", "integration/control_plane"),
        ("integration/test_lockstep.py", "integration/test_lockstep.py"),
        ("e2e/test_scenes.py", "e2e"),
        ("unit/cli/test_run.py", "unit/cli/test_run.py"),
    ],
)
def test_tests_that_share_servers_are_in_one_lane(place: str, expected: str) -> None:
    assert lane(TESTS / place) == expected
