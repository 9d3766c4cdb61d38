"""Executors come and go with the cases; a case on one that has to go is never lost nor blamed."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from bagpipe.run.attempts import QUARANTINE_ATTEMPT
from bagpipe.spec import JobFile, SimulationJobSpec
from tests.integration.conftest import RunningAgent
from tests.integration.stragglers.standalone import two_hosts
from tests.waiting import wait_until

pytestmark = pytest.mark.integration

HERE = Path(__file__).parent
DRIVER = HERE.parent / "stragglers/driver_of_two_hosts.py"
# Of a case that is to be copied: none here.
NEVER_SLOW = 3600
# What an executor logs once its driver has answered that it knows.
LEAVES = "Will exit when finished decommissioning"
SHORT = tuple(f"short-{n}" for n in range(5))


@dataclass(frozen=True)
class Lab:
    """A job on a Spark of two hosts, of which each has room for one executor of one slot."""

    folder: Path
    spark: Path
    agent: RunningAgent
    master: str

    def executors(self) -> dict[int, Path]:
        """The executors' processes, each with its log: Spark gives each a folder to work in."""
        found = {}
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                work = (entry / "cwd").readlink()
                words = (entry / "cmdline").read_bytes().split(b"\0")
            except OSError:  # it has ended meanwhile
                continue
            if work.is_relative_to(self.spark) and b"--executor-id" in words:
                found[int(entry.name)] = work / "stderr"
        return found

    def send_off(self, pid: int, log: Path) -> None:
        """SIGTERM, as a kubelet sends it, and the driver knows of it."""
        os.kill(pid, signal.SIGTERM)
        wait_until(lambda: LEAVES in log.read_text(), 120, "the executor to notice")

    def begun(self, run: int) -> Callable[[], bool]:
        return (self.folder / f"marks/begun-{run}").exists

    def let_go(self) -> None:
        (self.folder / "marks/go").touch()

    @contextmanager
    def running(self, cases: tuple[str, ...]) -> Iterator[subprocess.Popen[str]]:
        """A driver at work; the block lets its long case go."""
        for name in ("recordings", "results", "marks"):
            (self.folder / name).mkdir()
        for case in cases:
            (self.folder / f"recordings/{case}.bin").write_text(f"recorded by {case}")
        program = [sys.executable, str(HERE / "holding.py"), str(self.folder / "marks")]
        spec = {
            "source": {"files": ["pvc://recordings/*.bin"]},
            "stack": {"engine": "exec", "image": "-", "command": program},
            "spark": {"executors": {"min": 1, "max": 2}},
            "output": {"uri": "pvc://results/out"},
        }
        job = JobFile(
            name="breathing", namespace="lab", uid="u", attempt=1,
            volumes={name: str(self.folder / name) for name in ("recordings", "results")},
            spec=SimulationJobSpec.model_validate(spec),
            images={"spark": "-", "agent": "-"},  # type: ignore[arg-type]
        )  # fmt: skip
        file = self.folder / "job.json"
        file.write_text(job.model_dump_json(by_alias=True))
        command = [sys.executable, str(DRIVER), str(file), self.master, str(self.agent.shared)]
        with (self.folder / "driver.log").open("w") as log:
            driver = subprocess.Popen(
                [*command, str(NEVER_SLOW)],
                env=os.environ | {"PYSPARK_PYTHON": sys.executable},
                stdout=log, stderr=subprocess.STDOUT, text=True,
            )  # fmt: skip
        try:
            yield driver
        finally:
            driver.terminate()
            driver.wait(timeout=120)

    def rows(self, driver: subprocess.Popen[str]) -> dict[str, dict[str, Any]]:
        """The rows of a job that has ended well, each case's one."""
        assert driver.wait(timeout=300) == 0, (self.folder / "driver.log").read_text()[-6000:]
        results = self.folder / "results/out/breathing/u"
        lines = (results / "results.jsonl").read_text().splitlines()
        rows = [json.loads(line) for line in lines]
        manifest = json.loads((results / "manifest.json").read_text())
        assert manifest["counts"]["planned"] == manifest["counts"]["passed"] == len(rows)
        assert len({row["case"] for row in rows}) == len(rows)
        # What a run left behind that does not count is not there.
        kept = sorted(path.name for path in (results / "cases").iterdir())
        assert kept == sorted(row["recorded"][0].removeprefix("cases/") for row in rows)
        return {row["case"]: row for row in rows}


@pytest.fixture
def lab(tmp_path: Path, start_agent: Callable[..., RunningAgent]) -> Iterator[Lab]:
    spark = tmp_path / "spark"
    spark.mkdir()
    agent = start_agent(slots=4, path="/nowhere")
    with two_hosts(spark, slots=1) as master:
        yield Lab(tmp_path, spark, agent, master)


def test_an_executor_without_cases_goes_while_the_longest_case_runs_on(lab: Lab) -> None:
    with lab.running(("long", *SHORT)) as driver:
        wait_until(lambda: len(lab.executors()) == 2, 300, "two executors")
        wait_until(lab.begun(1), 300, "the long case")
        wait_until(lambda: len(lab.executors()) == 1, 300, "one executor")
        lab.let_go()
        rows = lab.rows(driver)
    assert sorted(rows) == ["long", *SHORT]
    assert {(row["starts"], row["attempts"], len(row["discarded"])) for row in rows.values()} == {
        (1, 1, 0)
    }


# Promise: sigterm-ends-the-case
def test_an_executor_that_gets_sigterm_ends_its_case_first(lab: Lab) -> None:
    with lab.running(("long",)) as driver:
        wait_until(lab.begun(1), 300, "the long case")
        [(pid, log)] = lab.executors().items()
        lab.send_off(pid, log)
        lab.let_go()
        rows = lab.rows(driver)
    assert (rows["long"]["starts"], rows["long"]["attempts"]) == (1, 1)
    assert not lab.begun(2)()


# Promise: taken-away-is-no-attempt
def test_executors_that_are_taken_away_use_up_no_attempt_of_their_case(lab: Lab) -> None:
    lost = QUARANTINE_ATTEMPT + 1
    with lab.running(("long",)) as driver:
        for run in range(1, lost + 1):
            wait_until(lab.begun(run), 300, f"run {run}")
            for pid, log in lab.executors().items():
                lab.send_off(pid, log)
                # Its grace period is over.
                os.kill(pid, signal.SIGKILL)
        wait_until(lab.begun(lost + 1), 300, "the last run")
        lab.let_go()
        rows = lab.rows(driver)
    assert (rows["long"]["outcome"], rows["long"]["attempts"]) == ("passed", 1)
    assert rows["long"]["starts"] == lost + 1
