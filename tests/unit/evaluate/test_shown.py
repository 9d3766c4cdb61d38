"""What a criterion must have been shown before it passes: coverage, clocks, numbers, the window.

Windows are from 10 to 15 s, with 50 inputs a tenth of a second apart.
"""

import math
from typing import Any

import pytest

from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.finding import Finding
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion
from tests.unit.evaluate.recordings import evidence, number, poses, stamped

INPUTS = [10 + n / 10 for n in range(50)]
LATENCY = {"latency": {"topic": "/pose", "max": "80ms"}}
RATE = {"rate": {"topic": "/pose", "min": 9.5}}
PRESENCE = {"presence": {"topic": "/pose", "min": 50}}
BOUNDS = {"bounds": {"topic": "/pose", "field": "pose.position.x", "min": -1, "max": 100}}
HOLDS = {"expression": {"topic": "/pose", "holds": "!(msg.pose.position.x > 100.0)"}}
ERROR = {
    "error": {
        "topic": "/pose",
        "truth": "/truth",
        "recording": True,
        "fields": ["pose.position.x", "pose.position.y"],
        "metric": "max",
        "max": 0.5,
    }
}
GOAL = {"finalPose": {"topic": "/pose", "position": [14.9, 0.0], "within": 0.2, "yaw": 0.0}}
KEEPS_AWAY = {"separation": {"ego": "/pose", "obstacles": "/cars", "minDistance": 2}}
DAY = 86_400.0


def answer(at: float, late: float = 0.01, **more: Any) -> Any:
    """A right answer to the input at `at`."""
    stamp = more.get("stamp", at)
    return ("/pose", at + late, stamped(stamp, more.get("x", at), more.get("y", 0.0)))


def unstamped(times: list[float]) -> list[Any]:
    return [("/pose", at, number(1.0)) for at in times]


RIGHT = [answer(at) for at in INPUTS]
CARS = [("/cars", at, poses(at, (at, 10.0))) for at in INPUTS]


def case(recorded: list[Any], **more: Any) -> Evidence:
    truth = [("/truth", at, stamped(at, at, 0.0)) for at in INPUTS]
    return evidence(recorded, more.pop("truth", truth), end=15.0, **more)


def found(given: Evidence, measure: dict[str, Any], **more: Any) -> Finding:
    [finding] = evaluate([Criterion.model_validate({"name": "c"} | measure | more)], given)
    return finding


def less(measure: dict[str, Any], share: float) -> dict[str, Any]:
    return {kind: fields | {"minCoverage": share} for kind, fields in measure.items()}


ALL = [LATENCY, RATE, PRESENCE, BOUNDS, HOLDS, ERROR, GOAL, KEEPS_AWAY]
ANSWERED = [LATENCY, BOUNDS, HOLDS, ERROR, GOAL, KEEPS_AWAY]


def named(value: object) -> str | None:
    """A measure's test is called by its kind."""
    return str(next(iter(value))) if isinstance(value, dict) else None


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


def test_a_distance_beyond_all_squares_is_a_figure() -> None:
    rmse = {"error": ERROR["error"] | {"metric": "rmse"}}
    finding = found(case([*RIGHT[:-1], answer(14.9, x=1e300)]), rmse)
    assert finding.outcome == "failed"
    assert finding.figure == pytest.approx(1e300 / math.sqrt(50))


def test_of_two_samples_that_are_as_near_the_earlier_counts() -> None:
    truth = [("/truth", at, stamped(at, x, 0.0)) for at, x in ((10.0, 0.0), (12.0, 100.0))]
    entries = [answer(11.0, x=1.0), answer(12.0, x=100.0)]
    finding = found(case(entries, truth=truth), {"error": ERROR["error"] | {"within": "1s"}})
    assert finding.figure == 1.0


# Numbers that are none.


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
    goal = {"finalPose": {"topic": "/pose", "position": [14.9, 0.0], "within": 0.2}}
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


# Clocks.


def test_stamps_of_another_clock_are_no_latency() -> None:
    wall = [answer(at, stamp=at + 3300 * DAY) for at in INPUTS]
    finding = found(case(wall), LATENCY)
    assert finding.outcome == "invalid"
    assert finding.message == (
        "50 of 50 messages on /pose are stamped later than they came, the first at 0.010 s by 3,300"
        " days: is /use_sim_time set for the node, and does it stamp with ROS time or its input's"
        " stamp? Else it stamps with this machine's clock"
    )
    assert found(case(wall), LATENCY, expectFailure=True).outcome == "invalid"
    assert found(case(wall), ERROR).outcome == "invalid"
    # What needs no stamp goes by the time of receipt.
    assert (found(case(wall), RATE).outcome, found(case(wall), RATE).clock) == ("passed", "receipt")


def test_one_stamp_of_the_far_future_is_enough() -> None:
    entries = [*RIGHT[:-1], answer(14.9, stamp=4_294_967_290.0)]
    for measure in (LATENCY, ERROR):
        finding = found(case(entries), measure)
        assert finding.outcome == "invalid"
        assert "1 of 50 messages on /pose are stamped later than they came" in finding.message


def test_stamps_after_2038_are_times_like_others() -> None:
    offset = 2**31 + 100.0
    entries = [
        ("/pose", at + offset + 0.01, stamped(at + offset, at, 0.0)) for at in INPUTS
    ]  # fmt: skip
    given = evidence(entries, entries, start=10 + offset, end=15 + offset)
    latency = found(given, LATENCY)
    assert latency.outcome == "passed"
    assert latency.figure == pytest.approx(0.01, abs=1e-6)
    wanted = {"error": {"topic": "/pose", "recording": True, "fields": ["header.stamp"], "max": 0}}
    assert found(given, wanted).outcome == "passed"
    stamp = {"bounds": {"topic": "/pose", "field": "header.stamp", "min": offset}}
    assert found(given, stamp).outcome == "passed"


def test_a_node_s_rounding_of_a_stamp_is_no_negative_delay() -> None:
    rounded = [answer(at, late=0.0, stamp=at + 0.0005) for at in INPUTS]
    assert found(case(rounded), LATENCY).outcome == "passed"
    ahead = [answer(at, late=0.0, stamp=at + 0.002) for at in INPUTS]
    assert found(case(ahead), LATENCY).outcome == "invalid"


def test_a_clock_that_stands_still_or_runs_backward_is_no_evidence() -> None:
    still = [answer(at, stamp=10.0) for at in INPUTS]
    slow = {"latency": {"topic": "/pose", "percentile": 50, "max": "6s"}}
    finding = found(case(still), slow)
    assert finding.outcome == "invalid"
    assert "its stamp stands still: does /clock reach the node?" in finding.message
    backward = [answer(at, stamp=20.0 - at) for at in INPUTS]
    finding = found(case(backward), slow)
    assert finding.outcome == "invalid"
    assert "does the node's clock run backward" in finding.message


def test_stamps_from_long_before_the_recording_are_named() -> None:
    boot = [(t, at + 1000 * DAY, m) for t, at, m in RIGHT]
    given = evidence(boot, start=10 + 1000 * DAY, end=15 + 1000 * DAY)
    finding = found(given, {"latency": {"topic": "/pose", "max": "999999h"}})
    assert finding.outcome == "invalid"
    assert "have stamps from before the recording, the first at 0.010 s by 1,000 days" in (
        finding.message
    )


def test_answers_may_repeat_stamps_that_are_wrong_in_the_recording_itself() -> None:
    """A recording that was made by playing another one has the older one's stamps."""
    for off in (-237 * DAY, 0.2):
        given = evidence(
            [
                ("/pose", at + 0.01 + 300 * DAY, stamped(at + 300 * DAY + off, at, 0))
                for at in INPUTS
            ],
            [("/truth", at + 300 * DAY, stamped(at + 300 * DAY + off, at, 0)) for at in INPUTS],
            start=10 + 300 * DAY,
            end=15 + 300 * DAY,
        )
        finding = found(given, ERROR)
        assert (finding.outcome, finding.coverage, finding.clock) == ("passed", 1.0, "header")
        assert found(given, LATENCY).outcome == "invalid"
        assert found(given, RATE).outcome == "passed"
    wall = evidence(
        [("/pose", at + 300 * DAY, stamped(at + 9000 * DAY, at, 0)) for at in INPUTS],
        [("/truth", at + 300 * DAY, stamped(at, at, 0)) for at in INPUTS],
        start=10 + 300 * DAY,
        end=15 + 300 * DAY,
    )
    assert found(wall, ERROR).outcome == "invalid"


def test_second_zero_is_a_time_where_the_case_begins_with_it() -> None:
    entries = [("/pose", at - 10 + 0.01, stamped(at - 10, at, 0.0)) for at in INPUTS]
    given = evidence(entries, start=0.0, end=5.0)
    assert found(given, LATENCY).outcome == "passed"
    assert found(given, RATE).clock == "header"


def test_answers_out_of_order_with_right_stamps_are_right() -> None:
    late = [answer(at, late=0.35 if n % 2 else 0.05) for n, at in enumerate(INPUTS)]
    for measure in (RATE, PRESENCE, ERROR, {"latency": {"topic": "/pose", "max": "400ms"}}):
        assert found(case(late), measure).outcome == "passed"


# Frames.


def in_frame(entry: Any, frame: str) -> Any:
    entry[2].header.frame_id = frame
    return entry


@pytest.mark.parametrize(
    ("frames", "named_so"),
    [
        (["base_link"] * 50, "/pose is said in the frame base_link and /truth in the frame map"),
        ([""] * 50, "/pose is said in no frame and /truth in the frame map"),
        (["map"] * 25 + ["odom"] * 25, "/pose is said in the frame map, then odom and /truth in"),
        (["/map"] * 50, ""),
    ],
)
def test_figures_of_two_frames_are_not_compared(frames: list[str], named_so: str) -> None:
    entries = [in_frame(answer(at), frame) for at, frame in zip(INPUTS, frames, strict=True)]
    finding = found(case(entries), ERROR)
    assert finding.outcome == ("invalid" if named_so else "passed")
    assert named_so in finding.message
    away = found(case(entries + CARS), KEEPS_AWAY)
    assert away.outcome == finding.outcome
    same = {"error": ERROR["error"] | {"anyFrame": True}}
    assert found(case(entries), same).outcome == "passed"


def test_a_truth_without_a_frame_is_compared_with_any() -> None:
    truth = [in_frame(("/truth", at, stamped(at, at, 0.0)), "") for at in INPUTS]
    assert found(case([answer(at) for at in INPUTS], truth=truth), ERROR).outcome == "passed"


# The window, and what comes after it.


def test_what_is_said_after_the_window_saves_no_rate() -> None:
    after = [15.05 + n / 100 for n in range(70)]
    silent = found(case(unstamped(after)), RATE)
    assert (silent.outcome, silent.figure) == ("failed", 0.0)
    assert silent.message == (
        "0 Hz on /pose, 70 more after the window's end, and may be at least 9.5 Hz"
    )
    for stamps in (after, [11.0] * 70, [9.0] * 70):
        entries = [("/pose", at, stamped(s, 1, 1)) for at, s in zip(after, stamps, strict=True)]
        assert found(case(entries), RATE).outcome == "failed"
        assert found(case(entries), PRESENCE).outcome == "failed"
        for measure in (LATENCY, BOUNDS, HOLDS, ERROR, GOAL):
            assert found(case(entries), measure).outcome == "invalid"
    assert found(case(unstamped(after)), PRESENCE).outcome == "invalid"


def test_a_slow_stack_that_stamps_its_answers_is_right() -> None:
    slow = [answer(at, late=2.0) for at in INPUTS]
    for measure in (RATE, PRESENCE, BOUNDS, HOLDS, ERROR, GOAL):
        assert found(case(slow), measure).outcome == "passed"
    latency = found(case(slow), LATENCY)
    assert latency.outcome == "failed"
    assert latency.figure == pytest.approx(2.0)


def test_a_slow_stack_without_stamps_may_be_late_with_half() -> None:
    count = {"presence": {"topic": "/pose", "min": 50}}
    half = found(case(unstamped([at + 2.0 for at in INPUTS])), count)
    assert (half.outcome, half.figure, half.coverage) == ("passed", 50.0, 0.6)
    assert half.covered == "the whole window, and 20 of 50 messages after its end"
    late = found(case(unstamped([at + 3.0 for at in INPUTS])), count)
    assert (late.outcome, late.coverage) == ("invalid", 0.4)


def test_answers_to_the_lead_in_are_not_counted_twice() -> None:
    """A stack that is a second late, with a lead-in: 50 answers belong to the window, not 60."""
    entries = [answer(9 + n / 10, late=1.0) for n in range(60)]
    given = case(entries, lead_in_start=9_000_000_000)
    finding = found(given, {"rate": {"topic": "/pose", "min": 9.5, "max": 10.5}})
    assert (finding.outcome, finding.figure) == ("passed", 10.0)


@pytest.mark.parametrize("step", [0.5, 1.0])
def test_bursts_are_a_rate_if_they_come_all_the_time(step: float) -> None:
    times = [10 + math.ceil((n + 1) / 10 / step) * step - 0.001 * (50 - n) for n in range(50)]
    finding = found(case(unstamped(times)), RATE)
    assert finding.outcome == "passed"
    once = found(case(unstamped([10 + n / 1000 for n in range(50)])), RATE)
    assert (once.outcome, once.figure) == ("invalid", 10.0)
    assert "which is 3%, and at least 75% are needed" in once.message


def test_a_message_that_repeats_another_one_is_none_of_its_own() -> None:
    twice = [entry for at in INPUTS[:25] for entry in (answer(at), answer(at, late=0.05))]
    finding = found(case(twice), PRESENCE)
    assert (finding.outcome, finding.figure) == ("failed", 25.0)
    assert "25 of 50 repeat another one" in finding.message
    assert found(case(twice), RATE).figure == 5.0
    most = {"presence": {"topic": "/pose", "max": 40}}
    assert found(case(twice), most).figure == 50.0
    stale = [answer(10.0, late=at - 10 + 0.01) for at in INPUTS]
    assert found(case(stale), RATE).figure == pytest.approx(0.2)


def test_a_stale_answer_with_new_content_does_not_fill_a_rate() -> None:
    stale = [answer(10.0, late=at - 10 + 0.01, x=at) for at in INPUTS]
    finding = found(case(stale), RATE)
    assert (finding.outcome, finding.figure) == ("invalid", 10.0)


def test_a_silent_stack_shows_no_rate_at_most() -> None:
    wanted = {"rate": {"topic": "/pose", "max": 20}}
    assert found(case([]), wanted).outcome == "invalid"


def test_what_must_never_be_published_is_counted_in_the_whole_window() -> None:
    never = {"presence": {"topic": "/alarm", "min": 0, "max": 0}}
    finding = found(case(RIGHT), never)
    assert (finding.outcome, finding.coverage, finding.covered) == (
        "passed", 1.0, "the whole window",
    )  # fmt: skip
    assert found(case([("/alarm", 12.0, number(1.0))]), never).outcome == "failed"


def test_mode_max_leaves_open_when_a_message_without_a_stamp_was_said() -> None:
    at_the_end = unstamped([14.9] * 50)
    wanted = {"bounds": {"topic": "/pose", "field": "data", "max": 2}}
    assert found(case(at_the_end), wanted).outcome == "invalid"
    finding = found(case(at_the_end, paced=False), wanted)
    assert (finding.outcome, finding.coverage) == ("passed", None)


@pytest.mark.parametrize(
    "measure",
    [LATENCY, BOUNDS, HOLDS, GOAL | {}, KEEPS_AWAY, {"rate": {"topic": "/pose", "min": 3}}],
    ids=named,
)
def test_where_the_recording_has_a_gap_nobody_can_be_expected_to_answer(
    measure: dict[str, Any],
) -> None:
    """Inputs in the first two of five seconds only, as at the edge of a recording's gap."""
    if measure == GOAL:
        measure = {"finalPose": {"topic": "/pose", "position": [11.9, 0.0], "within": 0.2}}
    inputs = [round(at * 1e9) for at in INPUTS[:20]]
    answered = RIGHT[:20] + CARS[:20]
    assert found(case(answered), measure).outcome == "invalid"
    finding = found(case(answered, inputs=lambda: inputs), measure)
    assert finding.outcome == "passed"
    assert finding.coverage is not None
    assert finding.coverage > 0.9
    # Not in the gap, but before it.
    silent = found(case(RIGHT[:6] + CARS[:6], inputs=lambda: inputs), less(measure, 0.9))
    assert silent.outcome != "passed"


# Poses and cars of long ago.


def test_a_pose_of_long_ago_keeps_away_from_nothing() -> None:
    finding = found(case(RIGHT[:10] + CARS), KEEPS_AWAY)
    assert finding.outcome == "invalid"
    assert finding.coverage == pytest.approx(0.57, abs=0.02)
    finding = found(case(RIGHT + CARS[:10]), KEEPS_AWAY)
    assert finding.outcome == "invalid"
    assert finding.coverage == pytest.approx(0.38)


def test_the_last_pose_must_be_near_the_end() -> None:
    wanted = {"finalPose": {"topic": "/pose", "position": [12.0, 0.0], "within": 0.2}}
    finding = found(case(RIGHT[:21]), wanted)
    assert (finding.outcome, finding.coverage) == ("invalid", 0.4)
    assert "the pose at 2.000 s of 5.000 s" in finding.message


def test_a_latched_goal_from_before_the_first_input_is_no_last_pose() -> None:
    wanted = {"finalPose": {"topic": "/pose", "position": [14.9, 0.0], "within": 0.2}}
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
