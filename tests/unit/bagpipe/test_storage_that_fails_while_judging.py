"""Storage that fails is no finding about the stack: the case errors, and is tried again."""

from pathlib import Path
from typing import Any

import pytest

from bagpipe.engine.criteria import judged_by_criteria
from bagpipe.engine.engine import Attempt
from bagpipe.evaluate.evidence import Recording
from bagpipe.judgement import Judgement
from bagpipe.source.chosen import source_of
from bagpipe.source.planning import plan
from bagpipe.storage import Storage, StorageError
from tests import ros2_recording
from tests.unit.bagpipe.fake_agent import RESULT
from tests.unit.bagpipe.jobs import make_spec


@pytest.mark.parametrize("of", ["recording", "truth", "inputs"])
def test_a_server_that_does_not_answer_while_criteria_are_judged(
    tmp_path: Path, of: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = ros2_recording.write(tmp_path / "a.mcap", ["/in"], 40).read_bytes()
    storage = Storage({"recordings": str(tmp_path)})
    fields = {"fields": ["linear_acceleration.x"], "recording": True, "max": 0.1}
    criterion: dict[str, Any] = {"name": "x", "error": {"topic": "/in"} | fields}
    if of == "inputs":  # asked where an answer is missing for a while
        made = ros2_recording.write(tmp_path / "b.mcap", ["/in"], 4).read_bytes()
        bounds = {"topic": "/in", "field": "linear_acceleration.z", "min": 9}
        criterion = {"name": "x", "bounds": bounds}
    spec = make_spec(
        source={"bags": ["pvc://recordings/a.mcap"], "topics": ["/in"]},
        stack={"engine": "ros2", "image": "i", "command": ["c"]},
        evaluate=[criterion],
        record={"topics": ["/in"]},
    )
    (case,) = plan(spec, storage).cases

    def fails(*_: Any) -> bytes:
        raise StorageError("s3://r/a.mcap can't be read: 503 Slow Down")

    attempt = Attempt(case, spec, source_of(spec), storage, "pvc://results/r", "x")
    recording = Recording(fails if of == "recording" else lambda: made, case.window.start, None)
    if of != "recording":
        monkeypatch.setattr(storage.__class__, "open", fails)
    with pytest.raises(StorageError):
        raise AssertionError(judged_by_criteria(Judgement("passed"), attempt, recording, RESULT)[0])
