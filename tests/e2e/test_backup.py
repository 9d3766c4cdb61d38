"""docs/operations/backup.md as it is written: back up, lose everything, restore, go on."""

import json
import re
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.e2e import fleet, jobs
from tests.e2e import kubectl as k
from tests.e2e.installation import helm, keep_values, upgrade
from tests.e2e.test_cli import bagpipe

# Seven drivers, one after the other.
pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(1500)]

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/operations/backup.md"
SCHEDULE = "by-the-minute"
# The second file's case is an error, whenever it is run.
PROGRAM = f"""
import sys
{fleet.PROGRAM}
if data.endswith(b"drive 1\\n"):
    sys.exit("the laser is on fire")
"""


@dataclass(frozen=True)
class Saved:
    """A folder in which the page's commands are run."""

    folder: Path

    def run(self, heading: str) -> None:
        """The commands below a heading of the page, one block after the other."""
        section = PAGE.read_text().split(f"\n## {heading}\n")[1].split("\n## ")[0]
        blocks = re.findall(r"(?:^ {6,}\S.*\n)+", section, re.MULTILINE)
        assert blocks, heading
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", "".join(blocks)],
            cwd=self.folder, env=k.tool_environment(), capture_output=True, text=True,
            timeout=300, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr

    def jobs(self) -> set[str]:
        """The names of the jobs in the backup."""
        found = json.loads((self.folder / "bagpipe-objects.json").read_text())["items"]
        return {o["metadata"]["name"] for o in found if o["kind"] == "SimulationJob"}


@pytest.fixture
def saved(tmp_path: Path) -> Iterator[Saved]:
    """A folder with the chart beside it; whatever happens, this version is installed in the end."""
    values = keep_values(tmp_path)
    (tmp_path / "charts").symlink_to(ROOT / "charts")
    yield Saved(tmp_path)
    upgrade(values)


def make_job(name: str, *files: int, **changed: object) -> k.Object:
    """A case for each file, one at a time."""
    made = fleet.make_job(name, "pvc://results/kept", **changed)
    inputs = [f"pvc://recordings/{fleet.FOLDER}/{number:03d}.bin" for number in files]
    made["spec"]["source"] = {"files": inputs}
    made["spec"]["stack"] |= {"command": ["python3", "-c", PROGRAM]}
    made["spec"]["spark"] = jobs.spark(1, 1)
    return made


def by_the_minute() -> k.Object:
    made = make_job(SCHEDULE, 0)
    spec = {"schedule": "* * * * *", "jobTemplate": {"spec": made["spec"]}}
    return made | {"kind": "SimulationSchedule", "spec": spec}


def runs(namespace: str) -> dict[str, k.Object]:
    """The schedule's jobs by name."""
    found = k.items(namespace, "simjob", "-l", f"sim.bagpipe.io/schedule={SCHEDULE}")
    return {job["metadata"]["name"]: job for job in found}


def phases(namespace: str) -> dict[str, str]:
    found = k.items(namespace, "simjob")
    return {job["metadata"]["name"]: job.get("status", {}).get("phase", "") for job in found}


def set_suspend(namespace: str, *what: str, suspend: bool) -> None:
    patch = json.dumps({"spec": {"suspend": suspend}})
    k.kubectl("-n", namespace, "patch", *what, "--type=merge", "-p", patch)


def first_run(namespace: str) -> str:
    """The name of the schedule's only job, which has ended; the schedule rests."""
    jobs.apply(namespace, by_the_minute())
    k.await_that("the minute's job", lambda: runs(namespace), 75)
    set_suspend(namespace, "simschedule", SCHEDULE, suspend=True)
    (name,) = runs(namespace)
    assert jobs.ended(namespace, name, 240)["status"]["verdict"] == "Passed"
    return name


def lose_everything(namespace: str) -> None:
    """The release, the CRDs with all objects, and what is on the volume of the results."""
    helm("uninstall", "bagpipe", "--wait", "--timeout", "3m")
    crds = [f"{kind}.sim.bagpipe.io" for kind in ("simulationjobs", "simulationschedules")]
    k.kubectl("delete", "crd", *crds, "--timeout=100s")
    k.await_that("all pods to go", lambda: not others(namespace), 120)
    k.in_toolbox(namespace, "sh", "-c", "rm -r /results/kept")


def others(namespace: str) -> list[str]:
    """Pods but the toolbox."""
    names = [pod["metadata"]["name"] for pod in k.items(namespace, "pods")]
    return [name for name in names if name != k.TOOLBOX]


def test_what_the_page_says_brings_everything_back(namespace: str, saved: Saved) -> None:
    fleet.put_files(namespace)
    with ExitStack() as existing:
        existing.callback(
            k.kubectl, "-n", namespace, "delete", "simjob,simschedule", "--all", "--timeout=300s",
            seconds=320,
        )  # fmt: skip
        run = first_run(namespace)
        half = make_job("half", 0, 1, 2)
        jobs.apply(namespace, half)
        assert jobs.ended(namespace, "half", 240)["status"]["phase"] == "Failed"
        jobs.apply(namespace, make_job("under-way", *range(2, 42)))
        k.await_that("its first case", lambda: passed(namespace, "under-way"), 240)
        before = {job["metadata"]["name"]: job for job in k.items(namespace, "simjob")}
        set_suspend(namespace, "simschedule", SCHEDULE, suspend=False)

        saved.run("What to back up")
        k.kubectl("cp", k.on_claim(namespace, "pvc://results/kept"), str(saved.folder / "kept"))
        lose_everything(namespace)
        k.kubectl("cp", str(saved.folder / "kept"), f"{namespace}/{k.TOOLBOX}:/results/kept")
        saved.run("Restoring")

        assert_as_before(namespace, before, run)
        assert_the_schedule_goes_on(namespace, saved.jobs())
        assert_answers_are_read(namespace, before, run, saved.folder)
        assert_resumes(namespace, half, before["half"])
        assert_runs_again(namespace, before["under-way"])


def passed(namespace: str, name: str) -> int:
    status = k.get(namespace, "simjob", name).get("status", {})
    found: int = status.get("cases", {}).get("passed", 0)
    return found


def assert_as_before(namespace: str, before: dict[str, k.Object], run: str) -> None:
    """Ended jobs have ended, with their status; the others rest, and nothing has pods."""
    k.await_that(
        "the job that ran to rest", lambda: phases(namespace)["under-way"] == "Suspended", 30
    )
    assert {"half", run} <= set(before)
    for name in ("half", run):
        found = k.get(namespace, "simjob", name)
        assert found["metadata"]["uid"] != before[name]["metadata"]["uid"]
        moving = {"observedGeneration": None, "conditions": None}
        assert found["status"] | moving == before[name]["status"] | moving
    pods = k.items(namespace, "pods", "-l", f"sim.bagpipe.io/job in (half,under-way,{run})")
    assert pods == []


def assert_the_schedule_goes_on(namespace: str, restored: set[str]) -> None:
    """It starts the next minute's job, and none for the time before it was there again."""
    made = k.get(namespace, "simschedule", SCHEDULE)["metadata"]["creationTimestamp"]
    new = k.await_that("a run", lambda: set(runs(namespace)) - restored, 75)
    set_suspend(namespace, "simschedule", SCHEDULE, suspend=True)
    times = [
        runs(namespace)[name]["metadata"]["annotations"]["sim.bagpipe.io/scheduled-at"]
        for name in new
    ]
    assert min(times) > made
    for name in new:
        assert jobs.ended(namespace, name, 240)["status"]["verdict"] == "Passed"


def assert_answers_are_read(
    namespace: str, before: dict[str, k.Object], run: str, folder: Path
) -> None:
    """By the names of jobs and by folders, where the results were restored to."""
    volume = ("--volume", f"results={folder}")
    well, errored = (bagpipe(namespace, "results", name, *volume) for name in (run, "half"))
    assert (well.returncode, well.stdout.startswith(f"Passed  {run}\n")) == (0, True), well.stderr
    assert (errored.returncode, "the laser is on fire" in errored.stdout) == (2, True)
    folders = [
        str(folder / before[name]["status"]["results"].removeprefix("pvc://results/"))
        for name in (run, "half")
    ]
    for words in (["report", folders[0], "--to", "again.html"], ["compare", *folders]):
        done = subprocess.run(
            ["bagpipe", *words], capture_output=True, text=True, timeout=60, check=False,
            cwd=folder,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
    assert run in (folder / "again.html").read_text()


def assert_resumes(namespace: str, half: k.Object, before: k.Object) -> None:
    """What has ended is gone on from, what has not is refused."""
    again = half | {"metadata": {"name": "again"}, "spec": half["spec"] | {"resumeFrom": "half"}}
    jobs.apply(namespace, again)
    status = jobs.ended(namespace, "again", 240)["status"]
    assert (status["cases"]["passed"], status["cases"]["errored"]) == (2, 1), status
    assert status["resumedFrom"]["results"] == before["status"]["results"]
    _, rows = k.results(namespace, status["results"])
    assert [row.get("ran_in") for row in rows] == ["half", None, "half"]
    refused = make_job("refused", *range(2, 42), resumeFrom="under-way")
    jobs.apply(namespace, refused)
    ended = jobs.ended(namespace, "refused", 60)
    assert jobs.condition(ended, "Failed")["reason"] == "ResumeRefused"


def assert_runs_again(namespace: str, before: k.Object) -> None:
    """From its first case, into a folder of its own."""
    set_suspend(namespace, "simjob", "under-way", suspend=False)
    status = jobs.ended(namespace, "under-way", 300)["status"]
    assert (status["verdict"], status["cases"]["passed"]) == ("Passed", 40)
    assert status["results"] != before["status"]["results"]
