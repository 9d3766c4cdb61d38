"""A case of stack.engine: ros2 from its MCAP to its row, with an agent that answers by a script."""

import copy
from pathlib import Path
from typing import Any

import pytest

from bagpipe import MemoryMcap
from bagpipe.engine.chosen import engine_of
from bagpipe.plan.case import Case
from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.run.laptop import write_fragment
from bagpipe.source.chosen import source_of
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from tests.unit.bagpipe import fake_agent
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.fake_agent import RESULT, FakeAgent, make_slot, well_behaved
from tests.unit.bagpipe.jobs import make_spec
from tests.unit.evaluate.recordings import number, stamped
from tests.unit.evaluate.ros2_recordings import mcap

SECOND = 1_000_000_000
INPUTS = [10 + n / 10 for n in range(100)]
# Nobody expects an answer in a gap of the recording.
GAP = [at for at in INPUTS if not 13 < at < 16]
POSE = {"topic": "/pose", "minCoverage": 0.9}
NEAR = {"name": "near", "error": {**POSE, "truth": "/truth", "recording": True,
                                  "fields": ["pose.position.x"], "max": 0.5}}  # fmt: skip
OFTEN = {"name": "often", "bounds": {**POSE, "field": "pose.position.x", "min": 0}}


def drive(times: list[float]) -> bytes:
    scans = [("/scan", at, stamped(at, 0, 0)) for at in times]
    truth = [("/truth", at, stamped(at, at, 0)) for at in times]
    return mcap([*scans, *truth], ("/truth",))


def answers(times: list[float], off: float = 0.0) -> bytes:
    return mcap([("/pose", at + 0.01, stamped(at, at + off, 0)) for at in times])


class Lab:
    """A folder of recordings, and one of results."""

    def __init__(self, folder: Path) -> None:
        self.volumes = {name: str(folder / name) for name in ("recordings", "results")}
        for each in self.volumes.values():
            Path(each).mkdir()
        self.shared = folder / "s"

    def context(self, **changed: Any) -> RunContext:
        stack = {"image": "stack:1", "command": ["run"], "engine": "ros2"}
        source = {"bags": ["pvc://recordings/*"], "topics": ["/scan"]}
        spec = make_spec(**{"stack": stack, "source": source, "record": {"topics": ["/pose"]}}
                         | changed)  # fmt: skip
        return RunContext("lab/drive", spec, self.volumes, "pvc://results/r", str(self.shared))

    def cases(self, **changed: Any) -> list[Case]:
        return plan(self.context(**changed).spec, Storage(self.volumes)).cases

    def run(self, recorded: bytes, **changed: Any) -> Row:
        context = self.context(**changed)
        (case,) = plan(context.spec, Storage(self.volumes)).cases
        with FakeAgent(make_slot(self.shared), well_behaved(recorded)):
            return run_case(case, context)


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Lab:
    """Whose nodes are seen to take their messages."""
    taken(monkeypatch, "taken")
    made = Lab(tmp_path)
    (tmp_path / "recordings/drive.mcap").write_bytes(drive(INPUTS))
    return made


def taken(monkeypatch: pytest.MonkeyPatch, strength: str) -> None:
    result = copy.deepcopy(RESULT)
    result["ledger"]["topics"][0]["subscribers"][0]["strength"] = strength
    monkeypatch.setattr(fake_agent, "RESULT", result)


def found(row: Row) -> dict[str, Any]:
    return {each["name"]: (each["outcome"], each["coverage"]) for each in row["criteria"]}


def test_the_recording_is_mcap_and_compared_with_the_source_s_truth(lab: Lab) -> None:
    recorded = answers(INPUTS)
    row = lab.run(recorded, evaluate=[NEAR, OFTEN])
    assert (row["outcome"], row["reason"]) == ("passed", "")
    assert found(row) == {"near": ("passed", 1.0), "often": ("passed", pytest.approx(1, abs=0.02))}
    assert row["recorded"].endswith(".mcap")
    assert Path(lab.volumes["results"], "r", row["recorded"]).read_bytes() == recorded


def test_an_answer_off_the_truth_fails(lab: Lab) -> None:
    row = lab.run(answers(INPUTS, off=1.0), evaluate=[NEAR])
    assert (row["outcome"], row["reason"]) == ("failed", "CriterionFailed")
    assert row["message"].startswith("near: 1 rmse over 100 pairs of /pose")


def test_what_was_not_taken_is_no_delivery(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    taken(monkeypatch, "received")
    row = lab.run(answers(INPUTS), evaluate=[OFTEN])
    assert (row["outcome"], row["reason"]) == ("invalid", "DeliveryUnproved")
    assert "/stack got on /scan is proved no further than `received`" in row["message"]
    assert found(row)["often"][0] == "passed"


def test_a_criterion_that_fails_is_not_hidden_by_it(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken(monkeypatch, "received")
    row = lab.run(answers(INPUTS, off=1.0), evaluate=[NEAR])
    assert (row["outcome"], row["reason"]) == ("failed", "CriterionFailed")


def test_a_job_that_allows_it_passes_by_its_criteria(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken(monkeypatch, "received")
    rule = {"cause": "DeliveryUnproved", "action": "allow"}
    row = lab.run(answers(INPUTS), evaluate=[OFTEN], faultPolicy=[rule])
    assert (row["outcome"], row["allowed"][0]["cause"]) == ("passed", "DeliveryUnproved")


def test_in_a_gap_of_the_recording_nobody_answers(lab: Lab) -> None:
    recordings = Path(lab.volumes["recordings"])
    assert found(lab.run(answers(GAP), evaluate=[OFTEN]))["often"][0] == "invalid"
    (recordings / "drive.mcap").write_bytes(drive(GAP))
    (case,) = lab.cases()
    times = source_of(lab.context().spec).input_times(case, Storage(lab.volumes))
    assert times is not None
    assert times() == [round(at * SECOND) for at in GAP]


def test_by_hand_it_is_played_by_ros_2_itself(lab: Lab, tmp_path: Path) -> None:
    stack = {
        "image": "stack:1", "command": ["ros2", "run", "lane"], "engine": "ros2",
        "parameters": {"/lane/x": 1}, "remap": {"/laser": "/scan"},
    }  # fmt: skip
    fragment = {"length": "4s", "warmUp": "1s"}
    source = {"bags": ["pvc://recordings/*"], "topics": ["/scan"], "fragment": fragment}
    context = lab.context(stack=stack, source=source)
    storage = Storage(lab.volumes)
    case = next(case for case in plan(context.spec, storage).cases if case.id == "drive-0001")
    written = write_fragment(case, source_of(context.spec), storage, tmp_path / "fragment")
    assert written.name == "fragment.mcap"
    assert len(list(MemoryMcap(written.read_bytes()).messages(["/scan"]))) >= 50
    lines = list(
        engine_of("ros2").by_hand(case, context.spec, source_of(context.spec), storage, written)
    )
    assert lines[1:3] == ['  parameters {"/lane/x": 1}', "  command    ros2 run lane"]
    start = (case.window.lead_in_start - 10 * SECOND) / 1e9
    played = (case.window.end - case.window.lead_in_start) / 1e9
    assert 2 < start < 4 < played < 6
    # The fragment begins with the chunk that the lead-in begins in.
    first = next(time for _, time, _ in MemoryMcap(written.read_bytes()).messages()) / 1e9 - 10
    assert lines[-1] == (
        f"  ros2 bag play {written} --start-offset {start - first:.9f} --playback-duration"
        f" {played:.9f} --topics /scan --rate 1 --remap /scan:=/laser"
    )


def test_what_a_bag_holds_is_no_input_of_ros_2(lab: Lab) -> None:
    folder = Path(lab.volumes["recordings"])
    write_bag(folder / "old.bag", steady("/scan", 50, 10_000_000))
    context = lab.context()
    made = plan(context.spec, Storage(lab.volumes))
    assert [case.bag for case in made.cases] == ["pvc://recordings/drive.mcap"]
    (unplanned,) = made.unplanned
    assert "/scan holds messages in ros1, and the stack would read them as cdr" in unplanned.message


def test_a_recording_without_the_topic_is_no_evidence(lab: Lab) -> None:
    row = lab.run(mcap([("/other", 10.0, number(1.0))]), evaluate=[OFTEN])
    assert (row["outcome"], row["criteria"][0]["outcome"]) == ("invalid", "invalid")
    assert "no message on /pose" in row["message"]
