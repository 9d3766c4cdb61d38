"""Criteria in a case's way from recording to row."""

import base64
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bagpipe.evaluate.model import Criterion
from bagpipe.evaluate.written import written
from bagpipe.plan.case import Case
from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.unit.bagpipe.bags import Recorded, steady, write_bag
from tests.unit.bagpipe.fake_agent import RESULT, FakeAgent, make_slot, well_behaved
from tests.unit.bagpipe.jobs import make_spec
from tests.unit.evaluate import ros2_recordings
from tests.unit.evaluate.recordings import SECOND, STORE, bag, evidence, header, number, text


def run(
    tmp_path: Path,
    recorded: bytes,
    *criteria: dict[str, Any],
    inputs: list[Recorded] | None = None,
    messages: int = 2,
    played: bytes = b"",
    **changed: Any,
) -> Row:
    (tmp_path / "recordings").mkdir()
    (tmp_path / "results").mkdir()
    messages_in = inputs or steady("/scan", 50, 10_000_000)
    write_bag(tmp_path / "recordings/a.bag", messages_in, chunk_bytes=512)
    if played:
        (tmp_path / "recordings/a.bag").write_bytes(played)
    folders = {name: str(tmp_path / name) for name in ("recordings", "results")}
    spec = make_spec(evaluate=list(criteria), **changed)
    context = RunContext("lab/drive", spec, folders, "pvc://results/r", str(tmp_path / "s"))
    case: Case = plan(spec, Storage(folders)).cases[0]
    with FakeAgent(make_slot(Path(context.shared)), well_behaved(recorded, messages=messages)):
        return run_case(case, context)


RECORDED = bag([("/out", 1.1, number(3.0)), ("/out", 1.2, number(5.0))])
BELOW = {"name": "below", "bounds": {"topic": "/out", "field": "data", "max": 4}}
THERE = {"name": "there", "presence": {"topic": "/out"}}


def test_the_row_has_each_criterion_s_finding(tmp_path: Path) -> None:
    row = run(tmp_path, RECORDED, THERE, BELOW)
    assert (row["outcome"], row["reason"]) == ("failed", "CriterionFailed")
    assert row["message"] == "below: 5 data of /out at 0.200 s of 2 messages, and may be at most 4"
    assert [(c["name"], c["outcome"], c["figure"]) for c in row["criteria"]] == [
        ("there", "passed", 2.0),
        ("below", "failed", 5.0),
    ]
    assert row["recorded"]


def logged(severity: int, words: str, *, two: bool = False) -> Any:
    """A line of /rosout, of a severity from 0, as ROS 1 or ROS 2 counts them."""
    if two:
        types, rest = ros2_recordings.STORE.types, ("/n", words, "f", "g", 1)
        stamp = types["builtin_interfaces/msg/Time"](0, 0)
        return types["rcl_interfaces/msg/Log"](stamp, 10 * (severity + 1), *rest)
    log = STORE.types["rosgraph_msgs/msg/Log"]
    return log(header(0.0), 1 << severity, "/n", words, "f", "g", 1, [])


def test_what_was_written_to_rosout_is_in_the_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    topic = {"topic": "/rosout", "type": "rosgraph_msgs/Log", "messages": 2}
    monkeypatch.setitem(RESULT["recorded"], "topics", [topic])
    lines = [("/rosout", 1.15, logged(1, "begun")), ("/rosout", 1.3, logged(3, "e" * 900))]
    recorded = bag([("/out", 1.1, number(9.0)), *lines])
    row = run(tmp_path, recorded, BELOW)
    assert row["log"] == [
        {"at": 0.15, "level": "info", "node": "/n", "text": "begun"},
        {"at": 0.3, "level": "error", "node": "/n", "text": "e" * 300},
    ]


def test_of_too_many_lines_the_worst_are_kept_and_of_a_pass_those_that_warn(form: str) -> None:
    two = form != "ros1"
    lines = [("/rosout", 10 + n / 10, logged(n % 5, str(n), two=two)) for n in range(100)]
    kept = written(evidence(lines).recorded, 10 * SECOND, passed=False)
    assert Counter(line["level"] for line in kept) == {"fatal": 20, "error": 20, "warn": 20}
    assert kept == sorted(kept, key=lambda line: float(line["at"]))
    few = written(evidence(lines).recorded, 10 * SECOND, passed=True)
    assert [line["text"] for line in few] == [str(5 * n + 4) for n in range(10)]
    mild = [("/rosout", 11.0, logged(0, "d", two=two)), ("/rosout", 12.0, logged(6, "?", two=two))]
    assert written(evidence(mild).recorded, 0, passed=True) == []
    assert len(written(evidence(mild).recorded, 0, passed=False)) == 2


def test_what_is_no_log_is_left_out() -> None:
    other = evidence([("/rosout", 11.0, number(3.0))])
    assert written(other.recorded, 0, passed=False) == []
    assert written(evidence([("/out", 11.0, number(3.0))]).recorded, 0, passed=False) == []


def test_all_criteria_met_is_a_pass(tmp_path: Path) -> None:
    assert run(tmp_path, RECORDED, THERE)["outcome"] == "passed"


def test_a_recording_that_can_t_be_read_is_never_a_pass(tmp_path: Path) -> None:
    row = run(tmp_path, b"no bag", BELOW)
    assert (row["outcome"], row["reason"]) == ("invalid", "NotEnoughEvidence")


def test_a_truth_in_the_job_s_own_bag(tmp_path: Path) -> None:
    """The same numbers in the recording and in the output: no distance between them."""
    played, recorded = (
        bag([(topic, 1.0 + n * 0.01, number(n)) for n in range(50)]) for topic in ("/scan", "/out")
    )
    wanted = {"topic": "/out", "truth": "/scan", "recording": True, "fields": ["data"], "max": 1}
    row = run(tmp_path, recorded, {"name": "as before", "error": wanted}, played=played)
    [finding] = row["criteria"]
    assert finding["outcome"] == "passed"
    assert finding["figure"] == 0.0
    assert finding["message"] == "0 rmse over 50 pairs of /out"


@pytest.mark.parametrize(
    "criterion",
    [
        {"resources": {"maxCpu": 1}},
        {"presence": {"topic": "/out", "min": 0, "max": 99}},
        {"presence": {"topic": "/out"}},
        {"bounds": {"topic": "/out", "field": "data", "max": 1}, "expectFailure": True},
    ],
)
def test_where_nothing_was_recorded_no_criterion_says_otherwise(
    tmp_path: Path, criterion: dict[str, Any]
) -> None:
    row = run(tmp_path, bag([]), {"name": "c"} | criterion, messages=0)
    assert (row["outcome"], row["reason"], row["criteria"]) == ("invalid", "NothingRecorded", [])


def test_a_gap_of_the_recording_is_read_from_its_index(tmp_path: Path) -> None:
    """Half a second of inputs, then nothing, then one: an answer to each of the first is all."""
    inputs = [*steady("/scan", 50, 10_000_000), *steady("/scan", 1, 1, 4_000_000_000)]
    recorded = bag([("/out", 1.0 + n * 0.01, number(3.0)) for n in range(50)])
    row = run(tmp_path, recorded, BELOW, inputs=inputs)
    [finding] = row["criteria"]
    assert (row["outcome"], finding["outcome"]) == ("passed", "passed"), finding
    assert finding["coverage"] > 0.9


def test_a_criterion_over_what_is_not_recorded_is_refused_at_once() -> None:
    with pytest.raises(ValueError, match=r"reads /other, which record\.topics does not have"):
        make_spec(evaluate=[{"name": "x", "presence": {"topic": "/other"}}])


def test_two_criteria_of_one_name_are_refused() -> None:
    with pytest.raises(ValueError, match="two criteria have one name"):
        make_spec(evaluate=[THERE, THERE])


def test_criteria_are_not_for_programs_of_their_own() -> None:
    with pytest.raises(ValueError, match="judges itself"):
        SimulationJobSpec.model_validate(
            {
                "source": {"files": ["pvc://a/b"]},
                "stack": {"image": "i", "command": ["c"], "engine": "exec"},
                "output": {"uri": "pvc://results/x"},
                "evaluate": [
                    Criterion.model_validate(
                        {"name": "cpu", "resources": {"maxCpu": 1}}
                    ).model_dump(by_alias=True, exclude_none=True)
                ],
            }
        )


def camera(value: int, *, width: int = 2) -> Any:
    """A grey image of two pixels."""
    data = np.full(2, value, np.uint8)
    return STORE.types["sensor_msgs/msg/Image"](header(0.0), 1, width, "mono8", 0, 2, data)


def test_what_cameras_showed_at_the_failing_moment_is_in_the_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    topics = [
        {"topic": "/seen", "type": "sensor_msgs/Image", "messages": 2},
        {"topic": "/out", "type": "std_msgs/Float64", "messages": 2},
    ]
    monkeypatch.setitem(RESULT["recorded"], "topics", topics)
    images = [("/seen", 1.15, camera(10)), ("/seen", 1.19, camera(20)), ("/seen", 1.3, camera(30))]
    recorded = bag([("/out", 1.1, number(3.0)), ("/out", 1.2, number(5.0)), *images])
    row = run(tmp_path, recorded, BELOW)
    (image,) = row["images"]
    assert (image["topic"], image["of"], image["at"]) == ("/seen", "output", 0.19)
    assert (image["width"], image["height"], image["type"]) == (2, 1, "image/png")
    assert len(base64.b64decode(image["data"])) < 100


def test_a_broken_image_is_a_sentence_and_changes_no_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    topic = {"topic": "/seen", "type": "sensor_msgs/Image", "messages": 1}
    monkeypatch.setitem(RESULT["recorded"], "topics", [topic])
    recorded = bag([("/out", 1.2, number(5.0)), ("/seen", 1.15, camera(1, width=900))])
    row = run(tmp_path, recorded, BELOW)
    assert (row["outcome"], row["reason"]) == ("failed", "CriterionFailed")
    assert row["images"] == [
        {
            "topic": "/seen",
            "of": "output",
            "fault": "its rows have 2 bytes, and 900 pixels take 900",
        }
    ]


def test_a_case_that_passed_has_no_images(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    topic = {"topic": "/seen", "type": "sensor_msgs/Image", "messages": 1}
    monkeypatch.setitem(RESULT["recorded"], "topics", [topic])
    outputs = [("/out", 1.1, number(3.0)), ("/out", 1.2, number(3.0))]
    recorded = bag([*outputs, ("/seen", 1.15, camera(1))])
    row = run(tmp_path, recorded, THERE)
    assert (row["outcome"], "images" in row) == ("passed", False)


def test_the_input_s_camera_is_shown_by_the_name_that_the_recording_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = {"topic": "/own", "type": "sensor_msgs/Image", "sent": 3, "lead_in": 0}
    ledger = RESULT["ledger"] | {
        "topics": [*RESULT["ledger"]["topics"], sent | {"subscribers": []}]
    }
    monkeypatch.setitem(RESULT, "ledger", ledger)
    images = [("/cam", 1.0, camera(1)), ("/cam", 1.18, camera(2)), ("/cam", 1.3, camera(3))]
    source = bag([("/scan", 1.0, text("a")), ("/scan", 1.5, text("b")), *images])
    recorded = bag([("/out", 1.1, number(3.0)), ("/out", 1.2, number(5.0))])
    stack = {"image": "stack:1", "command": ["run"], "remap": {"/own": "/cam"}}
    topics = {"bags": ["pvc://recordings/*.bag"], "topics": ["/scan", "/cam"]}
    row = run(tmp_path, recorded, BELOW, played=source, stack=stack, source=topics)
    (image,) = row["images"]
    assert (image["topic"], image["of"], image["at"]) == ("/cam", "input", 0.18)
