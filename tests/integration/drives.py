"""The barrier car's job for the tests, with Debian's Python in place of its image."""

from pathlib import Path
from typing import Any

import yaml

from bagpipe.plan.case import Case
from bagpipe.run.case_run import RunContext
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.integration.conftest import ROOT, RunningAgent
from tests.waiting import patient

EXAMPLE = ROOT / "docs/examples/barrier-car"
PYTHON = "/usr/bin/python3"
# Debian's rospy, and no other Python on the way.
PATH = "/usr/bin:/bin"


def spec_with(simulator: dict[str, Any] | None = None, **changed: Any) -> SimulationJobSpec:
    """The example's spec with fields of its simulator, and whole fields, replaced."""
    spec = patient(yaml.safe_load((EXAMPLE / "job.yaml").read_text())["spec"])
    spec["stack"]["command"] = [PYTHON, str(EXAMPLE / "planner.py")]
    spec["source"]["simulator"] |= simulator or {}
    return SimulationJobSpec.model_validate(spec | changed)


def cases_of(spec: SimulationJobSpec) -> list[Case]:
    """In the order of their names."""
    return sorted(plan(spec, Storage({})).cases, key=lambda case: case.id)


def context_of(spec: SimulationJobSpec, agent: RunningAgent, folder: Path) -> RunContext:
    """Results go below `folder`/r."""
    folders = {"results": str(folder)}
    return RunContext("lab/barrier-car", spec, folders, "pvc://results/r", str(agent.shared))
