"""The example's spec and the real recording, on folders in place of volume claims."""

import shutil
from pathlib import Path
from typing import Any

import yaml

from bagpipe.spec import SimulationJobSpec
from tests.integration.conftest import ROOT
from tests.recording import fetch

EXAMPLE = ROOT / "docs/examples/robot-state-publisher/job.yaml"


def folders_with_recording(tmp_path: Path) -> dict[str, str]:
    """Two claims' folders; the recording lies where the example looks for it."""
    claims = {name: tmp_path / name for name in ("recordings", "results")}
    for path in claims.values():
        path.mkdir()
    (claims["recordings"] / "pr2").mkdir()
    shutil.copyfile(fetch(), claims["recordings"] / "pr2/joint_states.bag")
    return {name: str(path) for name, path in claims.items()}


def spec_with(playback: dict[str, Any] | None = None, **stack: Any) -> SimulationJobSpec:
    """The example's spec with fields of its playback and its stack replaced."""
    spec: dict[str, Any] = yaml.safe_load(EXAMPLE.read_text())["spec"]
    spec["playback"] |= playback or {}
    spec["stack"] |= stack
    return SimulationJobSpec.model_validate(spec)
