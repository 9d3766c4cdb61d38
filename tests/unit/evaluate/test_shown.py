"""What a criterion must have been shown before it passes: coverage, and numbers that are ones."""

import math
from typing import Any

import pytest

from tests.unit.evaluate.drives import (
    ALL,
    ANSWERED,
    BOUNDS,
    CARS,
    ERROR,
    GOAL,
    HOLDS,
    INPUTS,
    KEEPS_AWAY,
    LATENCY,
    RIGHT,
    answer,
    case,
    found,
    less,
    named,
)
from tests.unit.evaluate.recordings import poses, stamped


@pytest.mark.parametrize("measure", ALL, ids=named)
def test_right_answers_pass_with_all_of_it_covered(measure: dict[str, Any]) -> None:
    finding = found(case(RIGHT + CARS), measure)
    assert (finding.outcome, finding.message.count("judged on")) == ("passed", 0)
    assert finding.coverage is not None
    assert finding.coverage >= 0.97
    assert finding.covered
    assert finding.clock == "header"


@pytest.mark.parametrize("measure", ANSWERED, ids=named)
def test_two_answers_of_fifty_prove_nothing(measure: dict[str, Any]) -> None:
    finding = found(case(RIGHT[:2] + CARS), less(measure, 0.0))
    assert finding.outcome == ("failed" if measure is GOAL else "passed")
    finding = found(case(RIGHT[:2] + CARS), measure)
    assert finding.outcome == "invalid"
    assert finding.coverage is not None
    assert finding.coverage < 0.5
    assert "judged on" in finding.message
    assert "minCoverage" in finding.message


@pytest.mark.parametrize("measure", [LATENCY, BOUNDS, HOLDS])
def test_two_answers_far_apart_have_no_usual_step_that_could_excuse_their_silence(
    measure: dict[str, Any],
) -> None:
    few = found(case([answer(11.7), answer(13.4)]), measure)
    assert few.outcome == "invalid", few
    assert "which is 66%" in few.message


def test_of_the_truth_nine_tenths_must_be_answered() -> None:
    few = found(case(RIGHT[:44]), ERROR)
    assert (few.outcome, few.coverage) == ("invalid", 0.88)
    assert few.message.startswith(
        "judged on 44 of 50 samples of the truth, which have an answer within 50ms, which is 88%,"
        " and at least 90% are needed"
    )
    enough = found(case(RIGHT[:45]), ERROR)
    assert (enough.outcome, enough.coverage) == ("passed", 0.9)


def test_what_was_seen_out_of_its_bounds_stays_failed_however_little_was_seen() -> None:
    wrong = [answer(10.0, y=7.0), answer(10.1)]
    assert found(case(wrong), ERROR).outcome == "failed"
    assert found(case(wrong), ERROR, expectFailure=True).outcome == "invalid"
    rmse = {"error": ERROR["error"] | {"metric": "rmse"}}
    assert found(case(wrong), rmse).outcome == "invalid"


def test_one_answer_repeated_covers_one_sample_and_weighs_as_one() -> None:
    repeated = [answer(10.0, late=0.01 * n) for n in range(1, 51)]
    assert found(case(repeated), ERROR).coverage == 0.02
    rmse = {"error": ERROR["error"] | {"metric": "rmse", "minCoverage": 0.0, "max": 0.4}}
    wrong = answer(10.1, y=1.0)
    finding = found(case([*repeated, wrong]), rmse)
    assert finding.figure == pytest.approx(math.sqrt(0.5))
    assert finding.outcome == "failed"


def test_the_final_error_is_that_of_the_latest_stamp_and_near_the_end() -> None:
    final = {"error": ERROR["error"] | {"metric": "final"}}
    swapped = [*RIGHT[:48], answer(14.9, late=0.01), answer(14.8, late=0.15, y=3.0)]
    assert found(case(swapped), final).figure == pytest.approx(0.0)
    early = found(case(RIGHT[:20]), final)
    assert (early.outcome, early.coverage) == ("invalid", 0.4)
    assert "the last answer is at sample 20 of 50" in early.message


@pytest.mark.parametrize(("last", "outcome"), [(500.0, "failed"), (14.9, "passed")])
def test_of_two_answers_with_the_last_stamp_the_later_is_the_last(
    last: float, outcome: str
) -> None:
    other = 14.9 if last > 100 else 500.0
    both = [*RIGHT[:-1], answer(14.9, x=other), answer(14.9, late=0.02, x=last)]
    final = {"error": ERROR["error"] | {"metric": "final"}}
    goal = {"finalPose": GOAL["finalPose"] | {"position": [14.9, 0.0]}}
    for measure in (final, goal):
        assert found(case(both), measure).outcome == outcome


def test_a_last_answer_that_strays_is_the_final_error() -> None:
    """It lies between the truth's last two samples, which are answered but for the last."""
    final = {"error": ERROR["error"] | {"metric": "final", "stampTolerance": "10ms"}}
    before, wild = RIGHT[:-1], answer(14.84, y=7.0)
    finding = found(case([*before, wild]), final)
    assert finding.outcome == "failed"
    assert finding.figure == pytest.approx(6.9, abs=0.02)
    assert "over 49 pairs of /pose and 1 answers that stray between" in finding.message
    # Of two with that stamp the later; one on the way between both is no error.
    again = answer(14.84, y=9.0, late=0.03)
    assert found(case([*before, wild, again]), final).figure == pytest.approx(8.9, abs=0.02)
    for later in (answer(14.84, late=0.03), answer(14.86)):
        assert found(case([*before, wild, later]), final).outcome == "passed"
    # One that strays no further than the last pair is off makes that no better.
    off = [*RIGHT[:-2], answer(14.8, y=0.3), answer(14.84, y=0.2)]
    assert found(case(off), final).figure == pytest.approx(0.3)
    # What came after it with a later stamp is the last.
    assert found(case([*before, answer(14.74, y=7.0)]), final).outcome == "passed"
    assert found(case([*RIGHT, answer(14.84, y=7.0, late=0.2)]), final).outcome == "passed"


def test_a_distance_beyond_all_squares_is_a_figure() -> None:
    rmse = {"error": ERROR["error"] | {"metric": "rmse"}}
    finding = found(case([*RIGHT[:-1], answer(14.9, x=1e300)]), rmse)
    assert finding.outcome == "failed"
    assert finding.figure == pytest.approx(1e300 / math.sqrt(50))


def test_of_two_samples_that_are_as_near_the_earlier_counts() -> None:
    truth = [("/truth", at, stamped(at, x, 0.0)) for at, x in ((10.0, 0.0), (12.0, 100.0))]
    entries = [answer(11.0, x=1.0), answer(12.0, x=100.0)]
    finding = found(
        case(entries, truth=truth), {"error": ERROR["error"] | {"stampTolerance": "1s"}}
    )
    assert finding.figure == 1.0


STRICT = ERROR["error"] | {"stampTolerance": "10ms"}


@pytest.mark.parametrize(("metric", "figure"), [("max", 6.9), ("rmse", 0.69)])
def test_a_wild_answer_between_the_truth_s_samples_is_an_error(metric: str, figure: float) -> None:
    wild = answer(12.04, y=7.0)
    finding = found(case([*RIGHT, wild]), {"error": STRICT | {"metric": metric}})
    # As near to both neighbours as they are to each other it may have been, and no nearer.
    assert finding.figure == pytest.approx(figure, rel=0.01)
    assert "over 50 pairs of /pose and 1 answers that stray between" in finding.message
    wider = found(case([*RIGHT, wild]), ERROR)
    assert wider.figure == pytest.approx(7.0, rel=0.001)
    assert "over 51 pairs of /pose, " in wider.message


def test_answers_between_the_truth_s_samples_are_right_if_the_truth_may_have_been_there() -> None:
    between = [answer(at + 0.05) for at in INPUTS]
    outside = [answer(9.9, late=0.2, y=7.0), answer(14.95, y=7.0)]
    finding = found(case([*RIGHT, *between, *outside]), {"error": STRICT})
    assert (finding.outcome, finding.figure) == ("passed", 0.0)
    assert "stray" not in finding.message
    angle = STRICT | {"angle": True, "fields": ["pose.position.x"]}
    truth = [("/truth", at, stamped(at, 6.2 if at < 12 else 0.05, 0.0)) for at in INPUTS]
    turns = [answer(at, x=6.2 if at < 12 else 0.05) for at in INPUTS]
    given = case([*turns, answer(11.95, x=6.28)], truth=truth)
    assert found(given, {"error": angle}).figure == 0.0


def test_in_a_gap_of_the_truth_it_may_have_been_anywhere() -> None:
    """A loop through a tunnel: the truth is silent, and comes out where it went in."""
    inside = [at for at in INPUTS if 11.95 < at < 12.35]
    truth = [("/truth", at, stamped(at, 0.0, 0.0)) for at in INPUTS if at not in inside]
    answers = [answer(at, x=50.0 if at in inside else 0.0) for at in INPUTS]
    finding = found(case(answers, truth=truth), {"error": STRICT})
    assert (len(inside), finding.outcome, finding.figure) == (4, "passed", 0.0)


# Numbers that are none.


# Promise: no-number-fails
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("measure", ANSWERED[1:], ids=named)
def test_no_number_fails_with_the_time_of_the_first(measure: dict[str, Any], value: float) -> None:
    entries = [*RIGHT[:10], *(answer(at, x=value) for at in INPUTS[10:]), *CARS]
    finding = found(case(entries), measure)
    assert (finding.outcome, finding.figure) == ("failed", None)
    assert f"is no finite number but {value}" in finding.message
    assert ("at 4.900 s" if measure is GOAL else "at 1.0") in finding.message
    expected = found(case(entries), measure, expectFailure=True)
    assert expected.outcome == "failed"
    assert expected.message.startswith("expected to fail, but not like this: ")


def test_a_number_that_is_none_in_a_quaternion_or_an_obstacle_fails() -> None:
    odd = stamped(14.9, 14.9, 0.0)
    odd.pose.orientation.z = math.nan
    goal = {"finalPose": {"topic": "/pose", "position": [14.9, 0.0], "maxDistance": 0.2}}
    assert found(case([*RIGHT[:-1], ("/pose", 14.91, odd)]), goal).outcome == "failed"
    cars = [*CARS[:-1], ("/cars", 14.9, poses(14.9, (math.nan, 10.0)))]
    finding = found(case(RIGHT + cars), KEEPS_AWAY)
    assert finding.outcome == "failed"
    assert "an obstacle's pose is no finite number but nan at 4.900 s" in finding.message


def test_a_heading_without_a_direction_is_no_evidence() -> None:
    flat = stamped(14.9, 14.9, 0.0)
    flat.pose.orientation.w = 0.0
    finding = found(case([*RIGHT[:-1], ("/pose", 14.91, flat)]), GOAL)
    assert finding.outcome == "invalid"
    assert "its quaternion has the length 0 and not 1" in finding.message


@pytest.mark.parametrize("length", [0.91, 1.0, 1.09])
@pytest.mark.parametrize(("yaw", "roll", "pitch"), [(1.57, 0, 0), (1.39, 0, 0), (-2.9, 0.3, 0.2)])
def test_a_heading_is_that_of_its_quaternion_however_long_it_is(
    length: float, yaw: float, roll: float, pitch: float
) -> None:
    last = answer(14.9)
    turn = last[2].pose.orientation
    sy, cy, sp, cp = math.sin(yaw / 2), math.cos(yaw / 2), math.sin(pitch / 2), math.cos(pitch / 2)
    sr, cr = math.sin(roll / 2), math.cos(roll / 2)
    turn.x, turn.y = length * (sr * cp * cy - cr * sp * sy), length * (cr * sp * cy + sr * cp * sy)
    turn.z, turn.w = length * (cr * cp * sy - sr * sp * cy), length * (cr * cp * cy + sr * sp * sy)
    for off, outcome in ((0.0, "passed"), (0.049, "passed"), (0.051, "failed")):
        goal = GOAL["finalPose"] | {"yaw": yaw + off, "maxYawError": 0.05}
        assert found(case([*RIGHT[:-1], last]), {"finalPose": goal}).outcome == outcome


def test_a_truth_that_is_no_number_is_no_evidence() -> None:
    truth = [("/truth", at, stamped(at, math.nan if at == 12 else at, 0.0)) for at in INPUTS]
    finding = found(case(RIGHT, truth=truth), ERROR)
    assert finding.outcome == "invalid"
    assert "the recording's pose.position.x, pose.position.y of /truth" in finding.message
    assert "at 2.000 s" in finding.message


@pytest.mark.parametrize(
    ("holds", "finite", "outcome"),
    [
        ("msg.pose.position.y < 1.0", True, "passed"),  # what it does not read is not judged
        ("!(msg.pose.position.x > 100.0)", True, "failed"),
        ("!(msg.pose.position.x < -100.0)", False, "passed"),
        ("msg['pose'].position.x != 3.0", True, "failed"),
        ("[msg].exists(m, m.pose.position.x != 3.0)", True, "failed"),
        ("has(msg.pose) && msg.pose.position.y < 1.0", True, "failed"),
    ],
)
def test_an_expression_is_judged_by_what_it_reads(holds: str, finite: bool, outcome: str) -> None:
    entries = [*RIGHT[:-1], answer(14.9, x=math.inf)]
    wanted = {"expression": {"topic": "/pose", "holds": holds, "finite": finite}}
    assert found(case(entries), wanted).outcome == outcome


# Poses and cars of long ago.


def test_a_pose_of_long_ago_keeps_away_from_nothing() -> None:
    finding = found(case(RIGHT[:10] + CARS), KEEPS_AWAY)
    assert finding.outcome == "invalid"
    assert finding.coverage == pytest.approx(0.38)
    finding = found(case(RIGHT + CARS[:10]), KEEPS_AWAY)
    assert finding.outcome == "invalid"
    assert finding.coverage == pytest.approx(0.38)


def test_the_last_pose_must_be_near_the_end() -> None:
    wanted = {"finalPose": {"topic": "/pose", "position": [12.0, 0.0], "maxDistance": 0.2}}
    finding = found(case(RIGHT[:21]), wanted)
    assert (finding.outcome, finding.coverage) == ("invalid", 0.4)
    assert "the pose at 2.000 s of 5.000 s" in finding.message


def test_a_latched_goal_from_before_the_first_input_is_no_last_pose() -> None:
    wanted = {"finalPose": {"topic": "/pose", "position": [14.9, 0.0], "maxDistance": 0.2}}
    latched = case([("/pose", 10.0, stamped(0.0, 14.9, 0.0))], latching={"/pose"})
    finding = found(latched, wanted)
    assert (finding.outcome, finding.coverage) == ("invalid", 0.0)
    holds = {"bounds": BOUNDS["bounds"]}
    assert (found(latched, holds).outcome, found(latched, holds).coverage) == ("passed", 1.0)


# What the stack used.


@pytest.mark.parametrize(
    ("seconds", "outcome", "coverage"), [(7.5, "passed", 1.0), (5.0, "invalid", 0.5)]
)
def test_what_was_used_must_be_of_the_whole_play(
    seconds: float, outcome: str, coverage: float
) -> None:
    usage = {"seconds": seconds, "cpu_seconds": 1.0, "peak_memory_bytes": 2048}
    timings = {"subscribe": 1.5, "lead_in": 1.0, "play": 5.0, "drain": 0.5}
    given = case(RIGHT, result={"stack": {"usage": usage}, "timings": timings})
    for wanted in ({"maxCpu": 1.0}, {"maxMemory": "2Ki"}):
        finding = found(given, {"resources": wanted})
        assert (finding.outcome, finding.coverage) == (outcome, coverage)
    assert found(given, {"resources": {"maxMemory": "1Ki"}}).outcome == "failed"
