"""Topics that were recorded without their leading slash, which planning and playing understand."""

from pathlib import Path
from typing import Any

from bagpipe.engine.criteria import judged_by_criteria
from bagpipe.engine.engine import Attempt
from bagpipe.evaluate.evidence import Recording
from bagpipe.judgement import Judgement
from bagpipe.source.chosen import source_of
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from tests import ros2_recording
from tests.unit.bagpipe.fake_agent import RESULT
from tests.unit.bagpipe.jobs import make_spec

STACK = {"engine": "ros2", "image": "i", "command": ["c"]}


def judged(
    tmp_path: Path, name: str, source: dict[str, Any], criterion: dict[str, Any], recorded: bytes
) -> Any:
    (tmp_path / "recordings").mkdir(exist_ok=True)
    # 2 s of inputs, each 5 ms.
    ros2_recording.write(tmp_path / "recordings/a.mcap", [name], 400)
    storage = Storage({"recordings": str(tmp_path / "recordings")})
    spec = make_spec(
        source={"topics": ["/in"], **source},
        stack=STACK,
        evaluate=[criterion],
        record={"topics": ["/in", "/out"]},
    )
    made = plan(spec, storage)
    assert made.unplanned == []
    (case,) = made.cases
    attempt = Attempt(case, spec, source_of(spec), storage, "pvc://results/r", "x")
    recording = Recording(lambda: recorded, case.window.start, None)
    judgement, (row,) = judged_by_criteria(Judgement("passed"), attempt, recording, RESULT)
    return judgement, row


def answers(tmp_path: Path, count: int) -> bytes:
    return ros2_recording.write(tmp_path / "out.mcap", ["/out"], count).read_bytes()


SEQUENCE = {"sequence": [{"bag": "pvc://recordings/a.mcap"}]}
BOUNDS = {"name": "b", "bounds": {"topic": "/out", "field": "linear_acceleration.z", "min": 9}}


def test_a_stack_that_falls_silent_after_a_twentieth_of_a_sequence_lacks_evidence(
    tmp_path: Path,
) -> None:
    answered = answers(tmp_path, 20)  # 0.1 s of 2 s
    assert judged(tmp_path, "/in", SEQUENCE, BOUNDS, answered)[0].outcome == "invalid"
    judgement, row = judged(tmp_path, "in", SEQUENCE, BOUNDS, answered)
    assert judgement.outcome == "invalid", row["covered"]


FIELDS = {"fields": ["linear_acceleration.x"], "recording": True, "max": 0.1}
ERROR = {"name": "e", "error": {"topic": "/in"} | FIELDS}


def test_a_truth_is_found_by_its_resolved_name(tmp_path: Path) -> None:
    answered = ros2_recording.write(tmp_path / "out.mcap", ["/in"], 400).read_bytes()
    bags = {"bags": ["pvc://recordings/a.mcap"]}
    assert judged(tmp_path, "/in", bags, ERROR, answered)[0].outcome == "passed"
    judgement, row = judged(tmp_path, "in", bags, ERROR, answered)
    assert judgement.outcome == "passed", row["message"]
