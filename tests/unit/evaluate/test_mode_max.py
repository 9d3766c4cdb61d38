"""In mode max bag time runs ahead of the stack, so that a receipt is no time of an answer."""

from typing import Any

import numpy as np
import pytest

from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.finding import Finding
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion
from tests.unit.evaluate.recordings import STORE, evidence, number, pose, poses, stamped

TIMES = [10 + n / 10 for n in range(100)]
STEP = [(at, 1.0 if at < 15 else 2.0) for at in TIMES]
TRUTH = [("/truth", at, number(value)) for at, value in STEP]
GOAL = {"topic": "/p", "position": [5.0, 0.0], "maxDistance": 1.0}
ERROR = {"topic": "/n", "fields": ["data"], "truth": "/truth", "max": 0.3}
CROWD = {"ego": "/p", "obstacles": "/o", "minDistance": 2.0}
SCENES = [("/o", 19.9, poses(at, (50.0, 0.0))) for at in TIMES]
BAD = ("/p", 19.95, stamped(0.0, 5.0, 0.0))


def found(kind: str, wanted: dict[str, Any], given: Evidence) -> Finding:
    [finding] = evaluate([Criterion.model_validate({"name": "c", kind: wanted})], given)
    return finding


def egos(x: float) -> list[Any]:
    """Poses of a type without a header."""
    kind = STORE.types["geometry_msgs/msg/PoseWithCovariance"]
    return [("/p", 19.9, kind(pose(x, 0.0), np.zeros(36))) for _ in TIMES]


def numbers(*, late: bool) -> list[Any]:
    """Right answers, as they come with bag time, or all at the window's end."""
    return [("/n", 19.9 if late else at, number(value)) for at, value in STEP]


def poses_until(end: float) -> list[Any]:
    return [("/p", 19.9, stamped(at, 5.0, 0.0)) for at in TIMES if at < end]


@pytest.mark.parametrize("late", [True, False])
def test_no_error_is_known_without_stamps(late: bool) -> None:
    finding = found("error", ERROR, evidence(numbers(late=late) + TRUTH, paced=False))
    assert finding.outcome == "invalid"
    assert finding.message.startswith("mode max leaves open when messages on /n were published")
    assert found("error", ERROR, evidence(numbers(late=False) + TRUTH)).outcome == "passed"
    recorded = ERROR | {"recording": True}
    given = evidence(numbers(late=late), TRUTH, paced=False)
    assert found("error", recorded, given).outcome == "invalid"


def test_no_error_is_known_without_stamps_of_a_truth_that_the_stack_publishes() -> None:
    wanted = ERROR | {"topic": "/p", "fields": ["pose.position.x"], "truthFields": ["data"]}
    answers = [("/p", 19.9, stamped(at, value, 0.0)) for at, value in STEP]
    finding = found("error", wanted, evidence(answers + TRUTH, paced=False))
    assert finding.message.startswith("mode max leaves open when messages on /truth were")
    # What is recorded with the inputs has the recording's own times.
    given = evidence(answers, TRUTH, paced=False)
    assert found("error", wanted | {"recording": True}, given).outcome == "passed"


def test_what_is_no_number_fails_whenever_it_was_published() -> None:
    odd = [("/n", 19.9, number(float("nan")))]
    finding = found("error", ERROR, evidence(odd + TRUTH, paced=False))
    assert finding.outcome == "failed"
    given = evidence([*egos(float("nan")), *SCENES], paced=False)
    assert found("separation", CROWD, given).outcome == "failed"


@pytest.mark.parametrize("near", [6.0, 50.0])
def test_no_separation_is_known_without_stamps(near: float) -> None:
    scenes = [("/o", 19.9, poses(at, (near, 0.0))) for at in TIMES]
    finding = found("separation", CROWD, evidence([*egos(0.0), *scenes], paced=False))
    assert finding.outcome == "invalid"
    assert finding.message.startswith("mode max leaves open when messages on /p were published")
    stamps = found("separation", CROWD, evidence([*poses_until(20), *scenes], paced=False))
    assert stamps.outcome == ("failed" if near < 50 else "passed")
    without = [("/o", 19.9, number(1.0))]
    mixed = found("separation", CROWD, evidence([*poses_until(20), *without], paced=False))
    assert mixed.outcome == "invalid"


def test_the_time_of_a_last_pose_without_a_stamp_is_open() -> None:
    stamps = found("finalPose", GOAL, evidence(poses_until(20), paced=False))
    assert (stamps.outcome, stamps.coverage) == ("passed", 0.99)
    finding = found("finalPose", GOAL, evidence(egos(5.0), paced=False))
    assert (finding.outcome, finding.coverage) == ("passed", None)
    assert finding.covered == "the last pose, whose time mode max leaves open"
    far = found("finalPose", GOAL, evidence(egos(9.0), paced=False))
    assert (far.outcome, far.figure) == ("failed", 4.0)
    assert found("finalPose", GOAL, evidence(egos(5.0))).coverage == 0.99


def test_one_bad_stamp_leaves_open_nothing_that_others_show() -> None:
    """A stack that stamps its answers, and is dead after half of the window."""
    bound = {"topic": "/p", "field": "pose.position.x", "max": 9.0}
    for bad in ([], [BAD]):
        given = [*poses_until(15), *bad]
        for kind, wanted in (
            ("bounds", bound), ("finalPose", GOAL), ("rate", {"topic": "/p", "min": 5.0})
        ):  # fmt: skip
            finding = found(kind, wanted, evidence(given, paced=False))
            assert finding.outcome == "invalid"
            assert finding.coverage == pytest.approx(0.5, abs=0.02)
    # Where all are bad, as of a node without a clock, none shows a time.
    empty = [("/p", at, stamped(0.0, 5.0, 0.0)) for at in TIMES]
    for kind, wanted in (("bounds", bound), ("finalPose", GOAL)):
        finding = found(kind, wanted, evidence(empty, paced=False))
        assert (finding.outcome, finding.coverage) == ("passed", None)


@pytest.mark.parametrize("wrong", [5.0, 999.0])
def test_all_answers_to_one_input_are_judged_whenever_they_come(wrong: float) -> None:
    """Two lanes for each picture, of which the second one is right or wild."""
    truth = [("/truth", at, stamped(at, 5.0, 0.0)) for at in TIMES]
    bound = {"topic": "/p", "field": "pose.position.x", "max": 9.0}
    greatest = {
        "topic": "/p", "fields": ["pose.position.x"], "truth": "/truth", "recording": True,
        "metric": "max", "max": 1.0,
    }  # fmt: skip
    for late in (0.0, 10.0):
        lanes = [
            ("/p", at + late + more, stamped(at, x, more))
            for at in TIMES
            for more, x in ((0.01, 5.0), (0.02, wrong))
        ]
        given = evidence(lanes, truth, paced=False)
        rate = found("rate", {"topic": "/p", "min": 15.0}, given)
        assert (rate.outcome, rate.figure) == ("passed", 20.0)
        for kind, wanted in (("bounds", bound), ("error", greatest)):
            assert found(kind, wanted, given).outcome == ("passed" if wrong < 9 else "failed")
