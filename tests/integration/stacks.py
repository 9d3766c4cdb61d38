"""The example's spec and the real recording, on folders in place of volume claims."""

import shutil
from pathlib import Path
from typing import Any

import yaml

from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.integration.conftest import ROOT, RunningAgent
from tests.recording import fetch
from tests.waiting import patient

EXAMPLE = ROOT / "docs/examples/robot-state-publisher/job.yaml"
REALTIME = ROOT / "docs/examples/robot-state-publisher/realtime.yaml"


def folders_with_recording(tmp_path: Path) -> dict[str, str]:
    """Two claims' folders; the recording lies where the example looks for it."""
    claims = {name: tmp_path / name for name in ("recordings", "results")}
    for path in claims.values():
        path.mkdir()
    (claims["recordings"] / "pr2").mkdir()
    shutil.copyfile(fetch(), claims["recordings"] / "pr2/joint_states.bag")
    return {name: str(path) for name, path in claims.items()}


def stepped(**stack: Any) -> SimulationJobSpec:
    """The example's spec, which is in lock-step, with fields of its stack replaced."""
    return _spec(EXAMPLE, {}, stack)


def in_one_piece() -> SimulationJobSpec:
    """The example's spec with the whole recording as its one case."""
    return SimulationJobSpec.model_validate(whole_fields())


def whole_fields() -> dict[str, Any]:
    """The manifest's fields of the same."""
    spec = patient(yaml.safe_load(EXAMPLE.read_text())["spec"])
    spec["source"]["fragment"] = {"length": "60s"}
    return spec


def spec_with(playback: dict[str, Any] | None = None, **stack: Any) -> SimulationJobSpec:
    """The real-time example's spec with fields of its playback and its stack replaced."""
    return _spec(REALTIME, playback or {}, stack)


def over(spec: SimulationJobSpec, recording: str) -> SimulationJobSpec:
    """The same spec over another recording, which lies beside the example's."""
    dumped = spec.model_dump(by_alias=True, exclude_unset=True)
    dumped["source"]["bags"] = [f"pvc://recordings/pr2/{recording}"]
    return SimulationJobSpec.model_validate(dumped)


def run_all(spec: SimulationJobSpec, folders: dict[str, str], agent: RunningAgent) -> list[Row]:
    """The rows of all cases."""
    context = RunContext("lab/pr2", spec, folders, "pvc://results/r", str(agent.shared))
    return [run_case(case, context) for case in plan(spec, Storage(folders)).cases]


def _spec(path: Path, playback: dict[str, Any], stack: dict[str, Any]) -> SimulationJobSpec:
    spec = patient(yaml.safe_load(path.read_text())["spec"])
    spec["playback"] |= playback
    spec["stack"] |= stack
    return SimulationJobSpec.model_validate(spec)
