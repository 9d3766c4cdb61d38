"""Runs rows of the table by `bagpipe run`: one job for all that are played alike."""

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bagpipe.engine.delivery import judge
from bagpipe.engine.ros2.proof import PROOF
from bagpipe.evaluate.finding import Finding, verdict
from bagpipe.judgement import Judgement
from tests import ros2_standin
from tests.integration.laptop import Laptop
from tests.liars import recordings
from tests.liars.jobs import Job
from tests.liars.row import PYTHON, STACKS, Row

ROOT = Path(__file__).parents[2]
# What of a case was judged by its criteria; any other reason stands whatever they say.
_OF_CRITERIA = {"", "CriterionFailed", "CriteriaFailed", "NotEnoughEvidence"}
# Seventy cases of seconds, on a machine whose processors are all taken.
JOB_SECONDS = 1500
LIBRARIES = [
    f"-l{name}"
    for name in (
        *("roscpp", "rosconsole", "roscpp_serialization", "rostime", "xmlrpcpp", "cpp_common"),
        *("boost_system", "boost_thread", "pthread"),
    )
]


@dataclass(frozen=True)
class RowResult:
    """What the criterion that a row names reported, and the marks of the row's stack."""

    outcome: str
    reason: str
    words: str
    marks: dict[str, int]
    case: dict[str, Any]

    def __str__(self) -> str:
        return f"{self.outcome} {self.reason}: {self.words} (case: {self.case['message']})"


def judged(row: Row, case: dict[str, Any], marks: dict[str, int]) -> RowResult:
    """A line of the results, as it were if the job had the row's criterion alone."""
    named = [c for c in case.get("criteria") or [] if c["name"] == row.asked.criterion]
    if case["reason"] not in _OF_CRITERIA or not named:
        return RowResult(case["outcome"], case["reason"], case["message"], marks, case)
    (found,) = named
    finding = Finding(found["name"], found["kind"], found["outcome"], message=found["message"])
    outcome, reason, message = verdict([finding])
    # What is unproved hides behind the criteria of others that the row fails.
    unproved = unproved_of(row.asked.job, case.get("result"))
    if unproved is not None and outcome != "failed":
        return RowResult("invalid", unproved.reason, unproved.message, marks, case)
    return RowResult(outcome, reason, f"{found['message']} {message}", marks, case)


def unproved_of(job: Job, result: dict[str, Any] | None) -> Judgement | None:
    """What a case of ROS 2 is whose delivery is not proved."""
    if job.engine != "ros2" or result is None:
        return None
    found = judge(result, mode=job.playback["mode"], proof=PROOF)
    return found if found.reason == "DeliveryUnproved" else None


def compiled(folder: Path) -> Path:
    """The roscpp liar, compiled once for each of its texts."""
    source = STACKS / "liar.cpp"
    mark = hashlib.sha256(source.read_bytes()).hexdigest()[:16]
    binary = folder / f"liar-{mark}"
    if not binary.exists():
        folder.mkdir(parents=True, exist_ok=True)
        partly = folder / f"liar-{mark}.{os.getpid()}"
        command = ["g++", "-std=c++17", "-O1", "-o", str(partly), str(source), *LIBRARIES]
        subprocess.run(command, check=True, timeout=300)
        partly.rename(binary)
    return binary


class Army:
    """Rows that are run in a folder; their jobs begin at once, some at a time."""

    def __init__(self, folder: Path, agent: Path, cache: Path, jobs: int = 1, slots: int = 4):
        folder.mkdir(parents=True, exist_ok=True)
        self.laptop = Laptop(folder, agent)
        self.slots = slots
        self.marks = folder / "marks"
        self.marks.mkdir()
        self.liar = compiled(cache)
        self._jobs = ThreadPoolExecutor(jobs)
        self._results: dict[str, Future[dict[str, dict[str, Any]]]] = {}
        recordings.write_all(folder / "recordings")

    def start(self, rows: Iterable[Row]) -> None:
        """Run these rows; `result_of` waits for each."""
        by_job: dict[str, list[Row]] = {}
        for row in rows:
            by_job.setdefault(row.asked.job.name, []).append(row)
        for shared in by_job.values():
            ended = self._jobs.submit(self._run, shared)
            self._results.update({row.name: ended for row in shared})

    def result_of(self, row: Row) -> RowResult:
        """What came of a row. Raises AssertionError where its job has no line of it."""
        cases = self._results[row.name].result()
        assert row.name in cases, f"no line is about {row.name}: {sorted(cases)}"
        found = self.marks.glob(f"{row.name}.*")
        marks = {path.suffix[1:]: len(path.read_text().splitlines()) for path in found}
        return judged(row, cases[row.name], marks)

    def end(self) -> None:
        """Forget what has not begun, and wait for what has."""
        self._jobs.shutdown(cancel_futures=True)
        self.laptop.await_nothing_left()

    def _run(self, rows: list[Row]) -> dict[str, dict[str, Any]]:
        job = rows[0].asked.job
        manifest = self.laptop.manifest(job.name, self.spec(job, rows))
        wanted = [word for row in cases_of(rows) for word in ("--cases", row)]
        words = [*self.laptop.words(manifest), "--slots", str(self.slots), *wanted]
        process = self.laptop.start(*words)
        try:
            _, errors = process.communicate(timeout=JOB_SECONDS)
        finally:
            process.kill()
        results = self.laptop.folder / "bagpipe-results" / job.name / "results.jsonl"
        assert results.exists(), f"{job.name} ended with {process.returncode}: {errors}"
        lines = [json.loads(line) for line in results.read_text().splitlines()]
        return {line["values"]["row"]: line for line in lines if line.get("values")}

    def spec(self, job: Job, rows: list[Row]) -> dict[str, Any]:
        """The manifest of a job that has a combination of its matrix for each row."""
        commands = self.laptop.folder / f"commands-{job.name}.json"
        commands.write_text(json.dumps({row.name: self.words(row) for row in rows}))
        environment = {
            "LIAR_COMMANDS": str(commands),
            "LIAR_MARKS": str(self.marks),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        if job.engine == "exec":
            environment["PYTHONPATH"] = str(ROOT / "docs/examples/exec-highway")
        if job.engine == "ros2":
            environment |= ros2_standin.environment(ros2_standin.built())
            # By which the stacks are nodes of ROS 2; and Debian's classes of messages.
            environment["PYTHONPATH"] = str(STACKS / "ros2")
        return job.spec(files_of(rows)) | {
            "stack": {
                "image": "liars",
                "engine": job.engine,
                "command": [PYTHON, str(STACKS / "start.py"), "{{ row }}"],
                "parameters": job.changed.get("parameters", {}),
                "env": [{"name": key, "value": value} for key, value in environment.items()],
            },
            "matrix": {"variables": {"row": [row.name for row in rows]}},
            "spark": {"slots": self.slots},
            "output": {"uri": "pvc://results/r"},
        }

    def words(self, row: Row) -> list[str]:
        """The command of a row on this machine."""
        here = {"{liar}": str(self.liar), "{python}": sys.executable}
        return [here.get(word, word) for word in row.command]


def files_of(rows: Iterable[Row]) -> list[str]:
    """The recordings that rows are played, each once."""
    suffix = {"ros1": "bag", "ros2": "mcap", "exec": "txt"}
    return sorted({f"{row.asked.drive}.{suffix[row.asked.job.engine]}" for row in rows})


def cases_of(rows: list[Row]) -> list[str]:
    """The names of the rows' cases, of all that the job could have."""
    width = len(str(len(rows) - 1))
    for_each = []
    for place, row in enumerate(rows):
        asked = row.asked
        piece = "" if asked.job.engine == "exec" else f"-{asked.fragment:04d}"
        for_each.append(f"{asked.drive}{piece}-s{place:0{width}d}")
    return for_each
