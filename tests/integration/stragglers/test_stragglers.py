"""A case that hangs on one executor is started on another, and counts once, whoever is first."""

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from bagpipe.spec import JobFile, SimulationJobSpec
from tests.integration.conftest import RunningAgent
from tests.integration.stragglers.standalone import two_hosts

pytestmark = pytest.mark.integration

HERE = Path(__file__).parent
# Of a case that is to be called slow; in a job it is a minute.
SLOW_SECONDS = 2
OTHERS = tuple(f"quick-{n}" for n in range(5))


@pytest.fixture(scope="module")
def master(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with two_hosts(tmp_path_factory.mktemp("spark"), slots=2) as url:
        yield url


@dataclass(frozen=True)
class Lab:
    """A job's inputs, its results, and the marks that the straggler's runs leave."""

    folder: Path
    agent: RunningAgent
    master: str

    def job(self, hanging: str, cases: tuple[str, ...]) -> JobFile:
        """A job of two executors whose straggler hangs in its `hanging` run."""
        for name in ("recordings", "results", "marks"):
            (self.folder / name).mkdir()
        for case in cases:
            (self.folder / f"recordings/{case}.bin").write_text(f"recorded by {case}")
        program = [sys.executable, str(HERE / "straggling.py"), str(self.folder / "marks"), hanging]
        spec = {
            "source": {"files": ["pvc://recordings/*.bin"]},
            "stack": {"engine": "exec", "image": "-", "command": program},
            "spark": {"executors": 2, "slots": 2},
            "output": {"uri": "pvc://results/out"},
        }
        claims = {name: str(self.folder / name) for name in ("recordings", "results")}
        return JobFile(
            name="slow", namespace="lab", uid="u", attempt=1, volumes=claims,
            spec=SimulationJobSpec.model_validate(spec),
            images={"spark": "-", "agent": "-"},  # type: ignore[arg-type]
        )  # fmt: skip

    def run(self, job: JobFile) -> str:
        """Run the driver to its end; returns its output."""
        file = self.folder / "job.json"
        file.write_text(job.model_dump_json(by_alias=True))
        program = [sys.executable, str(HERE / "driver_of_two_hosts.py"), str(file)]
        done = subprocess.run(
            [*program, self.master, str(self.agent.shared), str(SLOW_SECONDS)],
            env=os.environ | {"PYSPARK_PYTHON": sys.executable},
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.returncode == 0, done.stderr[-6000:]
        return done.stderr


@pytest.fixture
def lab(tmp_path: Path, master: str, start_agent: Callable[..., RunningAgent]) -> Lab:
    return Lab(tmp_path, start_agent(slots=4, path="/nowhere"), master)


@pytest.mark.parametrize(
    ("hanging", "cases", "starts"),
    [
        # The copy ends first, the slow one is killed. Its line says that it was the second start.
        ("first", ("straggler", *OTHERS), 2),
        # The slow one wakes up when its copy begins and is first after all; the copy is killed.
        ("second", ("straggler", *OTHERS), 1),
        # No other case ends with which it could be compared.
        ("first", ("straggler",), 2),
    ],
    ids=["copy-first", "copy-second", "alone"],
)
def test_the_first_of_two_runs_counts_and_the_other_leaves_nothing(
    lab: Lab, hanging: str, cases: tuple[str, ...], starts: int
) -> None:
    output = lab.run(lab.job(hanging, cases))
    marks = sorted(path.name for path in (lab.folder / "marks").iterdir())
    assert marks == ["first", "second"], output[-6000:]
    lab.agent.await_no_descendants()

    results = lab.folder / "results/out/slow/u"
    manifest = json.loads((results / "manifest.json").read_text())
    assert [entry["case"] for entry in manifest["cases"]] == sorted(cases)
    assert {entry["outcome"] for entry in manifest["cases"]} == {"passed"}
    assert manifest["counts"]["passed"] == len(cases)
    rows = [json.loads(line) for line in (results / "results.jsonl").read_text().splitlines()]
    assert [row["case"] for row in rows] == sorted(cases)
    slow = next(row for row in rows if row["case"] == "straggler")
    assert (slow["attempts"], slow["discarded"], slow["starts"]) == (1, [], starts)
    # On a busy machine a quick one may have looked slow as well.
    assert {row["starts"] for row in rows} <= {1, 2}

    recorded = {row["recorded"][0].removeprefix("cases/"): row["case"] for row in rows}
    kept = {path.name: path.read_text() for path in (results / "cases").iterdir()}
    assert kept == {
        name: hashlib.sha256(f"recorded by {case}".encode()).hexdigest()
        for name, case in recorded.items()
    }
    (journaled,) = [line for line in output.splitlines() if line.startswith("journaled:")]
    assert journaled.split()[1:] == sorted(cases)
