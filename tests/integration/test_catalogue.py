"""Recordings that a catalogue selects, through a real node."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.integration.conftest import ROOT, RunningAgent
from tests.integration.stacks import folders_with_recording
from tests.integration.test_recombined import cut_scenes, run
from tests.waiting import patient

pytestmark = pytest.mark.integration

EXAMPLE = ROOT / "docs/examples/catalogue"


def test_the_scenes_of_the_head_are_played_and_no_other(
    tmp_path: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    """docs/examples/catalogue/job.yaml, all of its cases."""
    folders = folders_with_recording(tmp_path)
    cut_scenes(folders)
    shutil.copy(EXAMPLE / "catalogue.csv", folders["recordings"])
    manifest = yaml.safe_load((EXAMPLE / "job.yaml").read_text())
    spec = SimulationJobSpec.model_validate(patient(manifest["spec"]))
    made = plan(spec, Storage(folders))
    assert sorted(case.id for case in made.cases) == ["end-0000", "middle-0000"]
    assert made.unplanned == []
    assert made.selection is not None
    assert (made.selection.rows, made.selection.selected) == (3, 2)
    agent = start_agent()
    rows = [run(case, spec, folders, agent) for case in made.cases]
    assert {row["bag"] for row in rows} == {
        "pvc://recordings/pr2/scenes/middle.bag", "pvc://recordings/pr2/scenes/end.bag"
    }  # fmt: skip
