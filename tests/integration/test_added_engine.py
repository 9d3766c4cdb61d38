"""The engine of tests/toy_engine in a whole run: a plan, Spark, the real agent, a verdict."""

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.integration.conftest import ROOT
from tests.integration.laptop import Laptop
from tests.integration.stacks import folders_with_recording

pytestmark = pytest.mark.integration

# Reads all that it is sent, and gives back ten bytes of it.
LOSES = """
from bagpipe import binpipe
for record in binpipe.read():
    binpipe.write(record.read()[:10], name="back")
"""


@pytest.fixture
def laptop(tmp_path: Path, agent_binary: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Laptop]:
    ours = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT / "tests/toy_engine"), ours]))
    made = Laptop(tmp_path, agent_binary)
    folders_with_recording(tmp_path)
    yield made
    made.await_nothing_left()


def rows_of(laptop: Laptop, command: list[str]) -> dict[str, dict[str, Any]]:
    spec = {
        "source": {"bags": ["pvc://recordings/pr2/*.bag"], "fragment": {"length": "4s"}},
        "stack": {"engine": "loopback", "image": "any", "command": command},
        "record": {"topics": ["/tf"]},
        "output": {"uri": "pvc://results/r"},
    }
    laptop.job(laptop.manifest("toy", spec), "--slots", "2")
    lines = (laptop.folder / "bagpipe-results/toy/results.jsonl").read_text().splitlines()
    return {row["case"]: row for row in map(json.loads, lines)}


def test_its_cases_pass_by_its_own_verdict(laptop: Laptop) -> None:
    rows = rows_of(laptop, ["cat"])
    assert sorted(rows) == [f"joint_states-{n:04d}" for n in range(4)]
    for row in rows.values():
        assert (row["outcome"], row["attempts"], row["recorded"]) == ("passed", 1, None), row
        assert row["result"]["bytes_out"] == row["result"]["input_bytes"] > 10_000


def test_a_case_that_loses_bytes_fails_with_its_own_reason(laptop: Laptop) -> None:
    rows = rows_of(laptop, [sys.executable, "-c", LOSES])
    assert len(rows) == 4
    for row in rows.values():
        sent = row["result"]["input_bytes"]
        assert (row["outcome"], row["reason"]) == ("failed", "BytesMissing"), row
        assert row["message"] == f"10 of {sent} bytes came back"
