"""A run is as its driver's account says only where the driver has ended as the account has it."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from bagpipe.cli import driver_process, running
from bagpipe.cli.running import Driver, RunError, run_here
from bagpipe.spec import JobFile
from tests.unit.bagpipe.jobs import make_job

PROGRAM = """
import json, os, sys
from bagpipe.driver.streams import awaited, own_stdout
out = own_stdout()
awaited(sys.stdin.buffer)
print(json.dumps({"phase": os.environ["PHASE"], "cases": {"planned": 1}}), file=out, flush=True)
print("ImportError: too old", file=sys.stderr)
sys.exit(int(os.environ["STATUS"]))
"""


@contextmanager
def no_agent(*_: object) -> Iterator[None]:
    yield


@pytest.fixture
def job(tmp_path: Path) -> JobFile:
    return make_job({"results": str(tmp_path), "recordings": str(tmp_path)})


@pytest.mark.parametrize(
    ("phase", "status", "counts"),
    [
        ("Complete", 0, True),
        ("Failed", 1, True),
        # Python's own status where nobody took an exception.
        ("Complete", 1, False),
        ("Running", 1, False),
        ("Running", 0, False),
        ("Failed", 0, False),
        ("Complete", 9, False),
    ],
)
def test_what_a_driver_reported_counts_if_it_ended_so(
    tmp_path: Path, job: JobFile, monkeypatch: pytest.MonkeyPatch,
    phase: str, status: int, counts: bool,
) -> None:  # fmt: skip
    monkeypatch.setattr(running, "serving_agent", no_agent)
    monkeypatch.setattr(driver_process, "_PROGRAM", [sys.executable, "-c", PROGRAM])
    monkeypatch.setattr(driver_process, "_waiting", [])
    monkeypatch.setenv("PHASE", phase)
    monkeypatch.setenv("STATUS", str(status))
    shown: list[str] = []

    def show(progress: running.ProgressReport) -> None:
        shown.append(json.dumps(progress))

    if counts:
        assert run_here(job, "agent", Driver(1), tmp_path, show)["phase"] == phase
    else:
        with pytest.raises(RunError) as error:
            run_here(job, "agent", Driver(1), tmp_path, show)
        log = tmp_path / "driver.log"
        sentence = f"the driver ended with status {status}; {log} says last: ImportError: too old"
        assert str(error.value) == sentence
    assert shown
