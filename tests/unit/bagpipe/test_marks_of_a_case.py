"""Figures of a case are marked by what its play depends on."""

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


def test_the_rate_marks_cpu_in_real_time_alone(tmp_path: Path) -> None:
    made = ros2_recording.write(tmp_path / "a.mcap", ["/in"], 40).read_bytes()
    storage = Storage({"recordings": str(tmp_path)})
    usage = {"seconds": 2.0, "cpu_seconds": 1.0, "peak_memory_bytes": 1_000_000}
    result = RESULT | {"stack": RESULT["stack"] | {"usage": usage}}

    def mark(**playback: Any) -> str:
        spec = make_spec(
            source={"bags": ["pvc://recordings/a.mcap"], "topics": ["/in"]},
            stack={"engine": "ros2", "image": "i", "command": ["c"]},
            playback=playback,
            evaluate=[{"name": "busy", "resources": {"maxCpu": 1.5}}],
            record={"topics": ["/in"]},
        )
        (case,) = plan(spec, storage).cases
        attempt = Attempt(case, spec, source_of(spec), storage, "pvc://results/r", "x")
        recording = Recording(lambda: made, case.window.start, None)
        _, [row] = judged_by_criteria(Judgement("passed"), attempt, recording, result)
        return str(row["measures"])

    steps = [{"trigger": "/in", "answer": "/out"}]
    assert mark(mode="realtime", rate=4) != mark(mode="realtime")
    assert mark(mode="lockstep", rate=4, steps=steps) == mark(mode="lockstep", steps=steps)
