"""A real simulator in place of ROS: highway-env through the worker and the agent."""

import csv
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from bagpipe.row_facts import recorded_names
from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.source.bags.stream import fragment_file
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests import hanging
from tests.cached import made_once
from tests.integration.conftest import ROOT, RunningAgent
from tests.integration.stacks import folders_with_recording
from tests.waiting import PATIENCE

pytestmark = pytest.mark.integration

EXAMPLE = ROOT / "docs/examples/exec-highway"
PIP_SECONDS = 400
# Of the case that hangs: in it a slow machine has to start all that hangs.
TIMEOUT_SECONDS = 60
# Steps until its end, outcome, and the cars' least distance in metres, of each scenario.
EXPECTED = {
    "front-right-slower-left": (150, "passed", 4.001),
    "front-slower-straight": (150, "passed", 4.002),
    "left-faster-right": (150, "passed", 4.014),
    "rear-faster-straight": (45, "failed", 5.0),
    "rear-left-equal-right": (150, "passed", 20.266),
    "right-equal-left": (21, "failed", 2.472),
}


@pytest.fixture(scope="session")
def simulator() -> Path:
    """A Python with what the example's image has, kept between runs."""
    requirements = EXAMPLE / "requirements.txt"

    def install(folder: Path) -> None:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True, timeout=100)
        pip = [str(folder / "bin/python"), "-m", "pip", "install", "--quiet"]
        subprocess.run([*pip, "-r", str(requirements)], check=True, timeout=PIP_SECONDS)

    state = requirements.read_bytes() + sys.version.encode()
    return made_once("exec-highway", state, install) / "bin/python"


@pytest.fixture
def context(
    tmp_path: Path, simulator: Path, start_agent: Callable[..., RunningAgent]
) -> RunContext:
    folders = {name: str(tmp_path / name) for name in ("recordings", "results")}
    (tmp_path / "recordings").mkdir()
    shutil.copytree(EXAMPLE / "scenarios", tmp_path / "recordings/scenarios")
    spec = yaml.safe_load((EXAMPLE / "job.yaml").read_text())["spec"]
    spec["stack"]["command"] = [str(simulator), str(EXAMPLE / "simulate.py")]
    # No ROS can be found from here.
    agent = start_agent(slots=1, path="/nowhere")
    parsed = SimulationJobSpec.model_validate(spec)
    return RunContext("lab/traffic", parsed, folders, "pvc://results/r", str(agent.shared))


def run_all(context: RunContext) -> dict[str, Row]:
    cases = plan(context.spec, Storage(context.volumes)).cases
    return {case.id: run_case(case, context) for case in cases}


def stored(context: RunContext, row: Row) -> bytes:
    (name,) = recorded_names(row)
    assert name.endswith(".trajectory.csv")
    return (Path(context.volumes["results"]) / "r" / name).read_bytes()


def test_every_scenario_ends_as_physics_says_and_twice_the_same(context: RunContext) -> None:
    first = run_all(context)
    assert sorted(first) == sorted(EXPECTED)
    for name, (steps, outcome, closest) in EXPECTED.items():
        row = first[name]
        assert (row["outcome"], row["attempts"]) == (outcome, 1), row
        result = row["result"]
        figures = result["program"]["figures"]
        assert (figures["steps"], figures["closest_metres"]) == (steps, closest)
        assert figures["crashed"] == (outcome == "failed")
        assert result["stack"]["exit_status"] == 0
        assert (result["records_in"], result["records_out"]) == (1, 1)
        data = stored(context, row)
        assert result["bytes_out"] == len(data)
        rows = list(csv.DictReader(data.decode().splitlines()))
        assert len(rows) == steps
        gaps = [
            ((float(r["x"]) - float(r["barrier_x"])) ** 2
             + (float(r["y"]) - float(r["barrier_y"])) ** 2) ** 0.5
            for r in rows
        ]  # fmt: skip
        assert min(gaps) == pytest.approx(closest, abs=0.001)
        print(f"{name:26} {row['outcome']:7} {figures} {row['seconds']} s {result['timings']}")
    assert first["right-equal-left"]["reason"] == "Collision"
    assert first["right-equal-left"]["message"] == "the car under test crashed after 1.4 s"
    again = run_all(context)
    assert {n: stored(context, r) for n, r in again.items()} == {
        n: stored(context, r) for n, r in first.items()
    }


def test_a_scenario_that_is_none_is_an_error_with_the_programs_own_words(
    context: RunContext,
) -> None:
    folder = Path(context.volumes["recordings"]) / "scenarios"
    shutil.rmtree(folder)
    folder.mkdir()
    (folder / "broken.json").write_text('{"speed": 25')
    row = run_all(context)["broken"]
    assert (row["outcome"], row["reason"], row["attempts"]) == ("failed", "StackCrashed", 1)
    assert row["message"].startswith("the program ended with exit status 1")
    assert row["stderr"][-1].startswith("json.decoder.JSONDecodeError")
    assert row["recorded"] is None


def test_fragments_of_a_real_bag_pass_through_a_program_byte_for_byte(
    tmp_path: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    folders = folders_with_recording(tmp_path)
    source = {"bags": ["pvc://recordings/pr2/*.bag"], "fragment": {"length": "4s"}}
    stack = {"engine": "exec", "image": "any", "command": ["cat"]}
    fields = {"source": source, "stack": stack, "output": {"uri": "pvc://results/r"}}
    spec = SimulationJobSpec.model_validate(fields)
    shared = str(start_agent().shared)
    context = RunContext("lab/cat", spec, folders, "pvc://results/r", shared)
    storage = Storage(folders)
    cases = plan(spec, storage).cases
    assert len(cases) == 4
    for case in cases:
        row = run_case(case, context)
        assert (row["outcome"], row["attempts"]) == ("passed", 1), row
        (name,) = recorded_names(row)
        assert name.endswith(".joint_states.bag")
        sent = b"".join(fragment_file(case, storage).pieces())
        assert (Path(folders["results"]) / "r" / name).read_bytes() == sent
        assert row["result"]["bytes_in"] == row["result"]["bytes_out"] == len(sent)


def command_lines(agent: RunningAgent) -> list[str]:
    """The arguments of all that the agent's cases started and that still runs."""
    lines = []
    for pid in agent.descendants():
        try:
            line = Path(f"/proc/{pid}/cmdline").read_text()
        except OSError:
            continue
        lines.append(line.replace("\0", " "))
    return lines


def test_a_program_that_hangs_is_ended_with_all_it_started_and_the_next_runs_well(
    tmp_path: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    folders = {name: str(tmp_path / name) for name in ("recordings", "results")}
    (tmp_path / "recordings").mkdir()
    for name, content in hanging.CASES.items():
        (tmp_path / f"recordings/{name}.bin").write_text(content)
    command = [sys.executable, "-c", hanging.program(str(tmp_path))]
    fields = {
        "source": {"files": ["pvc://recordings/*.bin"]},
        "stack": {"engine": "exec", "image": "any", "command": command},
        "playback": {"caseTimeout": f"{TIMEOUT_SECONDS}s"},
        "output": {"uri": "pvc://results/r"},
    }
    spec = SimulationJobSpec.model_validate(fields)
    agent = start_agent()
    context = RunContext("lab/hanging", spec, folders, "pvc://results/r", str(agent.shared))
    hangs, well = plan(spec, Storage(folders)).cases
    rows: list[Row] = []
    runner = threading.Thread(target=lambda: rows.append(run_case(hangs, context)))
    runner.start()
    pause, deadline = threading.Event(), time.monotonic() + PATIENCE
    while sum(map(hanging.is_sleeper, command_lines(agent))) < hanging.SLEEPERS:
        assert time.monotonic() < deadline, command_lines(agent)
        pause.wait(0.05)
    runner.join(TIMEOUT_SECONDS + 2 * PATIENCE)
    (row,) = rows
    assert (row["outcome"], row["reason"], row["attempts"]) == (
        "errored", "CaseDeadlineExceeded", 1,
    )  # fmt: skip
    assert row["recorded"] is None
    assert row["seconds"] >= TIMEOUT_SECONDS
    assert command_lines(agent) == []
    (tmp_path / "go-on").touch()
    row = run_case(well, context)
    assert (row["outcome"], row["attempts"]) == ("passed", 1), row
