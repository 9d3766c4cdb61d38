"""`bagpipe` against a cluster: submit and wait, a case's logs while it runs and later, results."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.e2e import fleet, jobs
from tests.e2e import kubectl as k

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("recordings")]

Ended = subprocess.CompletedProcess[str]

SECONDS = 120
WAIT_SECONDS = 400
FIRST_LINE = "the stack begins"
# What the example runs, once GO_ON exists; before it a line by which its log is known.
GO_ON = "/tmp/go-on"
WAIT = f"until [ -e {GO_ON} ]; do sleep 0.1; done"
COMMAND = ["sh", "-c", f"echo {FIRST_LINE}; {WAIT}; exec robot_state_publisher"]


def environment() -> dict[str, str]:
    """The cluster, and the program's own folder on PATH, where kubectl finds its plugin."""
    found = k.tool_environment()
    return found | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{found['PATH']}"}


def bagpipe(namespace: str, *words: str, program: tuple[str, ...] = ("bagpipe",)) -> Ended:
    return subprocess.run(
        [*program, *words, "-n", namespace], env=environment(), capture_output=True, text=True,
        timeout=SECONDS, check=False,
    )  # fmt: skip


@pytest.fixture
def submitted(namespace: str, tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """`bagpipe submit --wait` of a job of one case, under way; killed and deleted afterwards."""
    manifest = tmp_path / "job.yaml"
    job = jobs.make_job("cli", stack={"command": COMMAND})
    manifest.write_text(json.dumps(job))
    words = ["submit", str(manifest), "--wait", "--timeout", f"{WAIT_SECONDS}s"]
    program = subprocess.Popen(
        ["bagpipe", *words, "--output", "json", "-n", namespace], env=environment(),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        yield program
    finally:
        program.kill()
        jobs.delete(namespace, "cli")


def test_a_job_from_submit_to_its_results(
    namespace: str, submitted: subprocess.Popen[str], tmp_path: Path
) -> None:
    case = running_case(namespace)
    live = bagpipe(namespace, "logs", "cli", case, "--of", "stack")
    assert live.returncode == 0, live.stderr
    assert "container stack)" in live.stdout
    assert f"\n{FIRST_LINE}\n" in live.stdout
    k.await_that("the case to be reported as running", lambda: running(namespace) == 1, 60)
    go_on(namespace)

    stdout, stderr = submitted.communicate(timeout=WAIT_SECONDS)
    assert submitted.returncode == 0, stderr
    state = json.loads(stdout)
    cases = state["cases"]
    assert (state["verdict"], cases["planned"], cases["passed"]) == ("Passed", 1, 1)
    assert " Running; 0 of 1 cases: 1 running" in stderr

    unreachable = bagpipe(namespace, "results", "job/cli")
    assert unreachable.returncode == 2
    assert "the claim results is not on this machine: give --volume results=" in unreachable.stderr
    volume = ("--volume", f"results={copied(namespace, state['results'], tmp_path)}")
    results = bagpipe(namespace, "results", "cli", *volume, "--junit", str(tmp_path / "junit.xml"))
    assert results.returncode == 0, results.stderr
    assert results.stdout.startswith("Passed  cli\n")
    assert (tmp_path / "junit.xml").read_text().count("<testcase") == 1
    kept = bagpipe(namespace, "logs", "cli", case, *volume)
    assert kept.returncode == 0, kept.stderr
    assert "== stack stdout (pvc://results/" in kept.stdout
    assert f"\n{FIRST_LINE}\n" in kept.stdout
    assert bagpipe(namespace, "watch", "cli", program=("kubectl", "bagpipe")).returncode == 0
    driver = bagpipe(namespace, "logs", "cli")
    assert "1 cases planned, 0 bags refused" in driver.stdout
    of_case = bagpipe(namespace, "logs", "cli", case, "--of", "driver")
    assert of_case.returncode == 0, of_case.stderr
    assert f"case {case}: passed, attempts 1, " in of_case.stdout


def running_case(namespace: str) -> str:
    """The name of the job's one case, once its stack has spoken."""

    def look() -> str | None:
        seen = bagpipe(namespace, "logs", "cli", "--of", "stack", "--output", "json")
        pieces = json.loads(seen.stdout) if seen.stdout else []
        lines = [line for piece in pieces for line in piece["lines"] if line.endswith(FIRST_LINE)]
        return lines[0].removeprefix("[").partition("]")[0] if lines else None

    return k.await_that("the stack to speak", look, 240)


def running(namespace: str) -> int:
    """How many cases run, as the job's status says."""
    status = k.get(namespace, "simjob", "cli").get("status", {})
    found: int = status.get("cases", {}).get("running", 0)
    return found


def go_on(namespace: str) -> None:
    """Let the stack go on to be what the example runs."""
    (pod,) = fleet.pods(namespace, "cli", "executor")
    touch = ("exec", pod["metadata"]["name"], "-c", "stack", "--", "touch", GO_ON)
    k.kubectl("-n", namespace, *touch)


def copied(namespace: str, uri: str, target: Path) -> Path:
    """A folder that stands for the claim `results`, with this job's results."""
    path = uri.removeprefix("pvc://results/")
    here = target / "claim" / path
    here.parent.mkdir(parents=True)
    k.kubectl("cp", f"{namespace}/{k.TOOLBOX}:/results/{path}", str(here))
    return target / "claim"
