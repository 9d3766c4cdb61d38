"""The demonstration's play in real time is the example's job, of one case that takes seconds."""

from pathlib import Path

import yaml

from bagpipe.spec import SimulationJobSpec
from tests.e2e.first_verdict import ROOT, in_real_time

EXAMPLE = ROOT / "docs/examples/robot-state-publisher/realtime.yaml"


def test_it_is_the_examples_job_on_four_seconds_of_its_recording(tmp_path: Path) -> None:
    job = yaml.safe_load(in_real_time(tmp_path / "laptop").read_text())
    spec = SimulationJobSpec.model_validate(job["spec"])
    example = SimulationJobSpec.model_validate(yaml.safe_load(EXAMPLE.read_text())["spec"])
    assert (spec.playback.mode, spec.playback.rate) == ("realtime", 1.0)
    assert [(piece.bag, piece.to) for piece in spec.source.sequence] == [
        ("pvc://recordings/pr2/joint_states.bag", "4s")
    ]
    assert spec.source.topics == example.source.topics
    same = {"source": example.source, "spark": example.spark}
    assert spec.model_copy(update=same) == example
