"""The example stacks without a cluster: their manifests as they are, their nodes as staged."""

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import yaml

from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.integration.conftest import ROOT, RunningAgent
from tests.waiting import patient

EXAMPLES = ROOT / "docs/examples"
SHARED = ROOT.parent / "shared/data"
_DEBIAN_ROS = Path(__file__).parent / "debian_ros"


def missing(recording: str) -> str:
    """Why a test of a recording that is never part of the project is skipped, or nothing."""
    there = (SHARED / recording).exists()
    return "" if there else f"the recording {recording} is not beside this checkout"


def example(name: str, folder: Path, recordings: dict[str, Path]) -> SimulationJobSpec:
    """An example's spec, with its nodes staged in a folder as its image has them.

    `recordings` says what lies where on the claim `recordings`.
    """
    for claim in ("recordings", "results"):
        (folder / claim).mkdir()
    for target, source in recordings.items():
        path = folder / "recordings" / target
        path.parent.mkdir(exist_ok=True)
        shutil.copy(source, path)
    nodes = _staged(folder / "staged")
    spec = patient(yaml.safe_load((EXAMPLES / name).read_text())["spec"])
    python, program = spec["stack"]["command"]
    assert python == "python3"
    spec["stack"]["command"] = [sys.executable, program.replace("/opt/nodes", str(nodes))]
    spec["stack"]["env"] = [{"name": "PYTHONPATH", "value": str(_DEBIAN_ROS)}]
    return SimulationJobSpec.model_validate(spec)


def run_all(spec: SimulationJobSpec, folder: Path, agent: RunningAgent) -> list[Row]:
    """Every case of a job, one after the other, in the order of the plan."""
    volumes = {claim: str(folder / claim) for claim in ("recordings", "results")}
    context = RunContext("lab/example", spec, volumes, "pvc://results/r", str(agent.shared))
    rows = [run_case(case, context) for case in plan(spec, Storage(volumes)).cases]
    for row in rows:
        print(row["case"], row["outcome"], row["reason"], row["seconds"], row["message"][:200])
        print("  ", {name: found["figure"] for name, found in found_by_name(row).items()})
    return rows


def found_by_name(row: Row) -> dict[str, dict[str, Any]]:
    """The findings of a case by the names of the criteria."""
    return {found["name"]: found for found in row.get("criteria", [])}


def _staged(folder: Path) -> Path:
    folder.mkdir()
    command = "import sys, pathlib, context; context.stage_example_nodes(pathlib.Path(sys.argv[1]))"
    subprocess.run(
        [sys.executable, "-c", command, str(folder)],
        cwd=ROOT / "images/build",
        check=True,
        timeout=60,
    )
    return folder / "nodes"
