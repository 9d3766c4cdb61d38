"""Whose stamps are believed, which frames are compared, and what belongs to the window."""

import math
from typing import Any

import pytest

from tests.unit.evaluate.drives import (
    BOUNDS,
    CARS,
    DAY,
    ERROR,
    GOAL,
    HOLDS,
    INPUTS,
    KEEPS_AWAY,
    LATENCY,
    PRESENCE,
    RATE,
    RIGHT,
    answer,
    case,
    found,
    less,
    named,
    unstamped,
)
from tests.unit.evaluate.recordings import evidence, number, poses, stamped


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


# Seconds of ROS 2 have a sign, and end in 2038.
@pytest.mark.parametrize("form", ["ros1"], indirect=True)
def test_one_stamp_of_the_far_future_is_enough() -> None:
    entries = [*RIGHT[:-1], answer(14.9, stamp=4_294_967_290.0)]
    for measure in (LATENCY, ERROR):
        finding = found(case(entries), measure)
        assert finding.outcome == "invalid"
        assert "1 of 50 messages on /pose are stamped later than they came" in finding.message


# Seconds of ROS 2 have a sign, and end in 2038.
@pytest.mark.parametrize("form", ["ros1"], indirect=True)
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


BELOW_9 = {"bounds": {"topic": "/pose", "field": "pose.position.x", "max": 9.0}}
BELOW_9_HOLDS = {"expression": {"topic": "/pose", "holds": "msg.pose.position.x < 9.0"}}
NO_STAMP = answer(31.0, stamp=0.0, x=0.0)


@pytest.mark.parametrize("measure", [BELOW_9, BELOW_9_HOLDS], ids=named)
@pytest.mark.parametrize("bad", [[], [NO_STAMP], [answer(12.345, stamp=500.0, x=0.0)]])
def test_one_bad_stamp_hides_no_answer_that_is_late(measure: Any, bad: list[Any]) -> None:
    """A stack at half the pace of its inputs, whose late answers are wrong."""
    early = [answer(at, late=at - 10, x=0.0) for at in INPUTS[:25]]
    wrong = [answer(at, late=at - 10, x=999.0) for at in INPUTS[25:]]
    assert found(case(early + wrong + bad), measure).outcome == "failed"


def test_one_bad_stamp_hides_no_last_pose_that_is_late() -> None:
    late = answer(14.95, late=0.6, x=500.0)
    for bad in ([], [answer(15.6, stamp=0.0)], [answer(12.345, stamp=500.0)]):
        finding = found(case([*RIGHT, late, *bad]), GOAL)
        assert finding.outcome == "failed"
        assert finding.figure == pytest.approx(485.1)


@pytest.mark.parametrize("beside", [1.0, 10.0])
def test_one_bad_stamp_moves_no_obstacle(beside: float) -> None:
    """One that drives beside the ego, and is seen two seconds later."""
    ego = [answer(at, x=10 * at) for at in INPUTS]
    cars = [("/cars", at + 2.0, poses(at, (10 * at, beside))) for at in INPUTS]
    outcome = "failed" if beside < 2 else "passed"
    for bad in ([], [answer(12.345, stamp=500.0, x=123.45)], [("/cars", 12.5, poses(0.0))]):
        finding = found(case(ego + cars + bad), KEEPS_AWAY)
        assert (finding.outcome, finding.clock) == (outcome, "receipt" if bad else "header")
    # Where none of one topic's stamps can be true, receipts are left for both.
    wall = [answer(at, stamp=at + 3300 * DAY, x=10 * at) for at in INPUTS]
    near = [("/cars", at + 0.01, poses(at, (10 * at, beside))) for at in INPUTS]
    assert found(case(wall + near), KEEPS_AWAY).outcome == outcome


def test_a_bad_stamp_after_the_end_is_of_nobody_s_message() -> None:
    """What a node says while it is shut down takes the stamps of all before from none."""
    for measure in (LATENCY, RATE, PRESENCE, BOUNDS, HOLDS, ERROR, GOAL):
        finding = found(case([*RIGHT, NO_STAMP]), measure)
        assert (finding.outcome, finding.clock) == ("passed", "header")
    assert found(case([*RIGHT, *unstamped([15.2])]), LATENCY).outcome == "passed"


def test_all_bad_stamps_after_the_end_are_named_where_nothing_came_before_it() -> None:
    wall = [answer(at, late=6.0, stamp=at + 3300 * DAY) for at in INPUTS]
    finding = found(case(wall), LATENCY)
    assert "50 of 50 messages on /pose are stamped later than they came" in finding.message
    assert found(case(wall), PRESENCE).outcome == "invalid"


@pytest.mark.parametrize("share", [0.5, 0.76])
def test_where_a_stamp_is_bad_the_others_still_show_what_was_answered(share: float) -> None:
    """A stack that answers the first inputs alone, over the whole window."""
    inputs = [10 + n * share / 10 for n in range(50)]
    slow = [answer(at, late=(at - 10) * (1 / share - 1)) for at in inputs]
    finding = found(case([*slow, answer(12.3, stamp=500.0)]), BOUNDS)
    assert finding.outcome == ("invalid" if share < 0.75 else "passed")
    assert finding.coverage == pytest.approx(share, abs=0.02)
    assert finding.clock == "receipt"
    goal = {"finalPose": {"topic": "/pose", "position": [inputs[-1], 0.0], "maxDistance": 1}}
    last = found(case([*slow, answer(12.3, stamp=500.0)]), goal)
    assert last.outcome == "invalid"
    assert last.coverage == pytest.approx(share, abs=0.02)
    rate = found(case([*slow, answer(12.3, stamp=500.0)]), RATE)
    assert rate.outcome == finding.outcome
    assert rate.coverage == pytest.approx(share, abs=0.02)


def test_where_all_stamps_are_bad_receipts_show_what_was_answered() -> None:
    """Of a wall clock, and empty ones of a node that has no time yet."""
    for off in (3300 * DAY, None):
        wall = [answer(at, stamp=0.0 if off is None else at + off) for at in INPUTS]
        for measure in (RATE, PRESENCE, BOUNDS, HOLDS, GOAL):
            finding = found(case(wall), measure)
            assert (finding.outcome, finding.clock) == ("passed", "receipt")
    # As of a node that has its clock from the third message on only.
    mixed = [answer(at, stamp=0.0 if n < 2 else at) for n, at in enumerate(INPUTS)]
    for measure in (RATE, PRESENCE, BOUNDS, HOLDS, GOAL):
        finding = found(case(mixed), measure)
        assert finding.outcome == "passed"
        assert (finding.coverage or 0) >= 0.98


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


@pytest.mark.parametrize("base", [0.0, 0.9, 10.0])
def test_a_topic_without_stamps_has_none_whenever_the_case_begins(base: float) -> None:
    """As in a simulation, whose time begins with second 0."""
    times = [base + n / 10 for n in range(50)]
    ego = [("/pose", at, stamped(0.0, 10 * (at - base), 0.0)) for at in times]
    cars = [("/cars", at, poses(0.0, (10 * (at - base) + 20, 0.0))) for at in times]
    given = evidence(ego + cars, start=base, end=base + 5)
    goal = {"finalPose": {"topic": "/pose", "position": [49.0, 0.0], "maxDistance": 0.2}}
    for measure in (RATE, PRESENCE, BOUNDS, HOLDS, goal, KEEPS_AWAY):
        finding = found(given, measure)
        assert (finding.outcome, finding.clock) == ("passed", "receipt")
    assert "/pose have an empty header.stamp" in found(given, LATENCY).message
    # In mode max nothing shows when they were.
    unpaced = evidence(ego + cars, start=base, end=base + 5, paced=False)
    assert found(unpaced, BOUNDS).coverage is None
    assert found(unpaced, KEEPS_AWAY).outcome == "invalid"


@pytest.mark.parametrize("paced", [True, False])
def test_second_zero_is_a_time_where_only_the_rest_is_answered_late(paced: bool) -> None:
    """Two lanes for each input, of which those for the first one alone come before the end."""
    lanes = [
        ("/pose", 4.95 if at == 10 else 5.1, stamped(at - 10, at, y))
        for at in INPUTS
        for y in (0.0, 0.1)
    ]
    truth = [("/truth", at - 10, stamped(at - 10, at, 0.0)) for at in INPUTS]
    given = evidence(lanes, truth, start=0.0, end=5.0, paced=paced)
    for measure in (ERROR, BOUNDS, HOLDS):
        finding = found(given, measure)
        assert (finding.outcome, finding.clock) == ("passed", "header")
    gaps = found(given, {"rate": {"topic": "/pose", "min": 9.5, "over": "worst"}})
    assert gaps.outcome == ("failed" if paced else "passed")


@pytest.mark.parametrize("lead", [None, 0])
def test_a_stamp_of_no_input_of_the_window_gives_no_times_to_a_topic_without(lead: Any) -> None:
    """As at a node's shutdown, in a simulation that begins with second 0."""
    start = 0.0 if lead is None else 2.0
    empty = [("/pose", start + at - 10, stamped(0.0, at, 0.0)) for at in INPUTS]
    last = ("/pose", start + 5.4, stamped(start + 5.3, 999.0, 0.0))
    given = evidence([*empty, last], start=start, end=start + 5, lead_in_start=lead)
    for measure in (RATE, PRESENCE, BOUNDS, HOLDS):
        finding = found(given, measure)
        assert (finding.outcome, finding.clock) == ("passed", "receipt")


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
        (["base_link"] * 50, "/pose is in the frame base_link and /truth in the frame map"),
        ([""] * 50, "/pose is in no frame and /truth in the frame map"),
        (["map"] * 25 + ["odom"] * 25, "/pose is in the frame map, then odom and /truth in"),
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


def test_several_frames_of_one_topic_are_a_doubt_whatever_it_is_compared_with() -> None:
    half = [in_frame(answer(at), "map" if at < 12 else "odom") for at in INPUTS]
    bare = [("/truth", at, number(at)) for at in INPUTS]
    cars = [in_frame(("/cars", at, poses(at, (at, 10.0))), "") for at in INPUTS]
    error = ERROR["error"] | {"fields": ["pose.position.x"], "truthFields": ["data"]}
    for measure, given in (
        ({"error": error}, case(half, truth=bare)),
        (GOAL, case(half)),
        (KEEPS_AWAY, case(half + cars)),
    ):
        finding = found(given, measure)
        assert finding.outcome == "invalid", finding
        assert "/pose is in the frames map, odom: " in finding.message
        [(kind, fields)] = measure.items()
        assert found(given, {kind: fields | {"anyFrame": True}}).outcome == "passed"
    turned = [("/pose", at, number(at)) for at in INPUTS]
    truth = [in_frame(("/truth", *each[1:]), each[2].header.frame_id) for each in half]
    swapped = error | {"fields": ["data"], "truthFields": ["pose.position.x"]}
    assert "/truth is in the frames" in found(case(turned, truth=truth), {"error": swapped}).message


@pytest.mark.parametrize("frames", [("", "map"), ("/map", "map")])
def test_one_frame_is_one_also_where_some_messages_name_none(frames: tuple[str, str]) -> None:
    given = [in_frame(answer(at), frames[n % 2]) for n, at in enumerate(INPUTS)]
    bare = [("/truth", at, number(at)) for at in INPUTS]
    error = ERROR["error"] | {"fields": ["pose.position.x"], "truthFields": ["data"]}
    assert found(case(given, truth=bare), {"error": error}).outcome == "passed"
    assert found(case(given), GOAL).outcome == "passed"


# The window, and what comes after it.


def test_messages_after_the_window_save_no_rate() -> None:
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


def test_mode_max_leaves_open_when_a_message_without_a_stamp_was_published() -> None:
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
        measure = {"finalPose": {"topic": "/pose", "position": [11.9, 0.0], "maxDistance": 0.2}}
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


@pytest.mark.parametrize("apart", [0, 20_000, 5_000_000])
@pytest.mark.parametrize("measure", [LATENCY, BOUNDS, HOLDS, GOAL, KEEPS_AWAY], ids=named)
def test_a_stack_that_is_dead_after_its_first_answer_has_no_gap_of_the_recording(
    measure: dict[str, Any], apart: int
) -> None:
    """Inputs come twice at each second, as of a stereo camera."""
    if measure == GOAL:
        measure = {"finalPose": {"topic": "/pose", "position": [10.0, 0.0], "maxDistance": 0.2}}
    inputs = [at * 1_000_000_000 + more for at in range(10, 15) for more in (0, apart)]
    finding = found(case([RIGHT[0], CARS[0]], inputs=lambda: inputs), measure)
    assert finding.outcome == "invalid"
    assert finding.coverage is not None
    assert finding.coverage < 0.3


def test_what_a_timer_publishes_on_after_the_end_saves_no_rate_and_fails_nothing() -> None:
    """A filter that drifts off while nothing more comes, and keeps its last input's stamp."""
    inputs = INPUTS[::2]
    drifts = [answer(14.8, late=0.3 + n / 50, x=14.8 + n) for n in range(200)]
    given = case([*(answer(at) for at in inputs), *drifts])
    assert {found(given, wanted).outcome for wanted in (RATE, PRESENCE)} == {"failed"}
    assert {found(given, each).outcome for each in (BOUNDS, HOLDS, GOAL, LATENCY)} == {"passed"}


def test_what_a_timer_publishes_on_with_a_keyframe_s_stamp_exceeds_no_greatest_number() -> None:
    """At 10 Hz until 18 s, with the stamp of its last input, of which one comes every 3 s."""
    ticks = [10.01 + n / 10 for n in range(80)]
    given = case([
        ("/pose", at, stamped(13.0 if at >= 13 else 10.0, 999.0 if at > 15 else at, at))
        for at in ticks
    ])  # fmt: skip
    rate = {"rate": {"topic": "/pose", "min": 8, "max": 11, "minCoverage": 0.3}}
    for measure, figure in (({"presence": {"topic": "/pose", "max": 55}}, 50.0), (rate, 10.0)):
        finding = found(given, measure)
        assert (finding.outcome, finding.figure) == ("passed", figure)
    assert found(given, less(BOUNDS, 0.3)).outcome == "passed"
