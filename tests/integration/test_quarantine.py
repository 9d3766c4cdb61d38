"""`bagpipe run` of a job with a case in quarantine: a real agent, and programs that really fail."""

import json
import sys
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from tests.integration.laptop import Laptop

pytestmark = pytest.mark.integration

# The program of the case `1` ends by a signal.
CRASHES = """
import os, signal
from bagpipe import binpipe
for record in binpipe.read():
    if record.read() == b"1":
        os.kill(os.getpid(), signal.SIGSEGV)
    binpipe.write(b"done", name="answer")
"""


@pytest.fixture
def laptop(tmp_path: Path, agent_binary: Path) -> Iterator[Laptop]:
    made = Laptop(tmp_path, agent_binary)
    (tmp_path / "recordings").mkdir()
    for number in range(2):
        (tmp_path / f"recordings/{number}.bin").write_text(str(number))
    yield made
    made.await_nothing_left()


def ran(laptop: Laptop, cases: str, days: int) -> tuple[int, dict[str, Any]]:
    """Exit status and results of a run whose quarantine of `cases` ends in so many days."""
    until = (datetime.now(UTC) + timedelta(days=days)).date().isoformat()
    spec = {
        "source": {"files": ["pvc://recordings/*.bin"]},
        "stack": {"engine": "exec", "image": "any", "command": [sys.executable, "-c", CRASHES]},
        "spark": {"slots": 2},
        "quarantine": [{"cases": cases, "reason": "issue 17", "until": until}],
        "output": {"uri": "pvc://results/r"},
    }
    manifest = laptop.manifest("crashes", spec)
    status, output, errors = laptop.job(manifest, "--output", "json", "--replace")
    return status, json.loads(output) if output else {"errors": errors}


def test_a_crash_in_quarantine_is_reported_and_turns_nothing_red(laptop: Laptop) -> None:
    status, found = ran(laptop, "1*", 1)
    assert (status, found["verdict"]) == (0, "Passed")
    outcomes = {case["case"]: (case["outcome"], case["reason"]) for case in found["cases"]}
    assert list(outcomes.values()) == [("passed", ""), ("failed", "StackCrashed")]
    assert (found["counts"]["crashed"], found["counts"]["quarantined"]) == (1, 1)
    assert "1 of 1 cases in quarantine did not pass" in found["message"]
    assert (laptop.folder / "bagpipe-results/crashes/quarantine.json").exists()
    status, found = ran(laptop, "1*", -1)
    assert (status, found["verdict"], found["counts"]["quarantined"]) == (1, "Failed", 0)
    status, found = ran(laptop, "*", 1)
    assert (status, found["verdict"]) == (1, "Invalid")
    status, found = ran(laptop, "1*", 92)
    assert status == 2
    assert "QuarantineInvalid" in found["errors"]
