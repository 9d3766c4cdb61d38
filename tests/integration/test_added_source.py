"""The source of tests/toy_source in a whole run, judged by an engine that is added as well."""

import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.integration.conftest import ROOT
from tests.integration.laptop import Laptop

pytestmark = pytest.mark.integration


@pytest.fixture
def laptop(tmp_path: Path, agent_binary: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Laptop]:
    toys = [str(ROOT / "tests/toy_engine"), str(ROOT / "tests/toy_source")]
    ours = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([*toys, ours]))
    (tmp_path / "recordings").mkdir()
    made = Laptop(tmp_path, agent_binary)
    yield made
    made.await_nothing_left()


def test_its_cases_are_planned_sent_and_judged(laptop: Laptop) -> None:
    spec = {
        "source": {"ticks": {"count": 500, "every": "10ms"}},
        "stack": {"engine": "loopback", "image": "any", "command": ["cat"]},
        "record": {"topics": ["/ticks"]},
        "playback": {"rounds": 2},
        "output": {"uri": "pvc://results/r"},
    }
    status, output, errors = laptop.job(laptop.manifest("ticks", spec), "--slots", "2")
    assert status == 0, (output, errors)
    lines = (laptop.folder / "bagpipe-results/ticks/results.jsonl").read_text().splitlines()
    rows = {row["case"]: row for row in map(json.loads, lines)}
    assert sorted(rows) == ["ticks-r0", "ticks-r1"]
    for row in rows.values():
        assert (row["outcome"], row["attempts"], row["bag"]) == ("passed", 1, "ticks"), row
        assert row["result"]["bytes_out"] == row["result"]["input_bytes"] > 500 * 4
