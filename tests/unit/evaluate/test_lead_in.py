"""What a stack answers to its lead-in is not judged, whenever that comes."""

from typing import Any

import pytest

from bagpipe.evaluate.finding import Finding
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion
from tests.unit.evaluate.recordings import evidence, number, poses, stamped

SECOND = 1_000_000_000
X = {"topic": "/p", "field": "pose.position.x", "max": 9.0}
HOLDS = {"topic": "/p", "holds": "msg.pose.position.x < 9.0"}
GOAL = {"topic": "/p", "position": [5.0, 0.0], "maxDistance": 1.0}
CROWD = {"ego": "/p", "obstacles": "/o", "minDistance": 2.0}
WORST = {"topic": "/p", "min": 5.0, "over": "worst"}


def answer(stamp: float, late: float = 0.03, x: float = 5.0) -> Any:
    return ("/p", stamp + late, stamped(stamp, x, 0.0))


def found(kind: str, wanted: dict[str, Any], entries: list[Any], **more: Any) -> Finding:
    """In a window from 10 to 20 s, with a lead-in from 8 s on."""
    expect = more.pop("expectFailure", False)
    criterion = Criterion.model_validate({"name": "c", kind: wanted, "expectFailure": expect})
    [finding] = evaluate([criterion], evidence(entries, lead_in_start=8 * SECOND, **more))
    return finding


WINDOW = [answer(10 + n / 10) for n in range(100)]
STRAGGLER = answer(9.9, late=0.12, x=999.0)
# As of a stack that is still busy with it, in whatever time it takes.
ONLY_LEAD_IN = [answer(8 + n / 50, late=2 + n * 0.08) for n in range(99)]
BAD_STAMP = ("/p", 12.345, stamped(500.0, 5.0, 0.0))
COUNT = {"topic": "/p", "min": 100, "max": 100}
RATE = {"topic": "/p", "min": 10.0, "max": 10.0}


# Promise: lead-in-not-judged
@pytest.mark.parametrize(
    ("kind", "wanted"),
    [
        ("bounds", X),
        ("expression", HOLDS),
        ("presence", COUNT),
        ("rate", RATE),
        ("rate", WORST),
        ("latency", {"topic": "/p", "percentile": 100, "max": "100ms"}),
        ("finalPose", GOAL),
    ],
)
def test_an_answer_to_it_that_comes_late_fails_nothing(kind: str, wanted: dict[str, Any]) -> None:
    finding = found(kind, wanted, [STRAGGLER, *WINDOW])
    assert finding.outcome == "passed"
    assert finding.coverage == pytest.approx(1.0, abs=0.011)


def test_without_one_nothing_but_the_window_is_answered() -> None:
    criterion = Criterion.model_validate({"name": "c", "bounds": X})
    for begin in (None, 10 * SECOND):
        [finding] = evaluate([criterion], evidence([STRAGGLER, *WINDOW], lead_in_start=begin))
        assert finding.outcome == "failed"


def test_obstacles_of_it_are_not_too_near() -> None:
    scenes = [("/o", 10.03 + n / 10, poses(10 + n / 10, (50.0, 0.0))) for n in range(100)]
    near = ("/o", 10.02, poses(9.9, (5.0, 1.0)))
    finding = found("separation", CROWD, [answer(9.9, late=0.12), *WINDOW, near, *scenes])
    assert (finding.outcome, finding.figure) == ("passed", 45.0)


def test_an_answer_to_it_is_no_known_fault() -> None:
    finding = found("bounds", X, [STRAGGLER, *WINDOW], expectFailure=True)
    assert finding.message == "passed although it was expected to fail: remove expectFailure"


# Promise: lead-in-not-judged
@pytest.mark.parametrize("bad", [[], [BAD_STAMP]], ids=["stamps", "bad stamp"])
def test_who_answers_it_alone_has_shown_nothing(bad: list[Any]) -> None:
    given = [*ONLY_LEAD_IN, *bad]
    few = found("presence", {"topic": "/p", "min": 2}, given)
    assert (few.outcome, few.figure) == ("failed", float(len(bad)))
    assert ", beside 99 of the lead-in" in few.message
    for wanted in ({"topic": "/p", "min": 5.0}, WORST):
        assert found("rate", wanted, given).outcome == "failed"
    late: Any = {"topic": "/p", "max": "20s"}
    for kind, measure in (("bounds", X), ("expression", HOLDS), ("latency", late)):
        assert found(kind, measure, given).outcome == "invalid"
    assert found("finalPose", GOAL, ONLY_LEAD_IN).message == (
        "no message on /p belongs to the case's window: all 99 are stamped in the lead-in"
    )


def test_where_some_answer_it_and_the_others_come_too_late_both_are_counted() -> None:
    finding = found("bounds", X, [answer(9.9, late=0.12), answer(20.5), answer(20.6)])
    assert finding.message == (
        "no message on /p belongs to the case's window: 1 of 3 are stamped in the lead-in, 2 came"
        " after its end, with stamps outside of it"
    )


@pytest.mark.parametrize("late", [0.45, 1.0, 2.0])
def test_a_slow_stack_loses_nothing_by_it(late: float) -> None:
    """What it answers to its lead-in in the window it answers to the window after its end."""
    entries = [answer(8 + n / 10, late) for n in range(120) if 8 + n / 10 + late >= 10]
    for kind, wanted in (
        ("presence", COUNT), ("rate", RATE), ("rate", WORST), ("bounds", X), ("expression", HOLDS),
        ("latency", {"topic": "/p", "max": "6s"}), ("finalPose", GOAL),
    ):  # fmt: skip
        finding = found(kind, wanted, entries)
        assert finding.outcome == "passed"
        assert finding.coverage == pytest.approx(1.0, abs=0.011)


def test_no_gap_is_filled_for_one_that_answers_the_window_hardly() -> None:
    """Until its first answer to the window those to the lead-in show that it was not silent."""
    finding = found("rate", WORST, [*ONLY_LEAD_IN, answer(10.0, late=9.9)])
    assert finding.outcome == "invalid"
    assert finding.coverage == pytest.approx(0.0, abs=0.011)
    back = [answer(9.5, late=5 + n / 10) for n in range(11)]
    gap = found("rate", WORST, [*WINDOW[:45], *back, *WINDOW[56:]])
    assert gap.outcome == "failed"
    assert gap.figure == pytest.approx(1 / 1.2)


@pytest.mark.parametrize("behind", [0.05, 0.15, 0.4, 1.0])
@pytest.mark.parametrize("paced", [True, False])
def test_stamps_of_a_sensor_that_is_recorded_late_lose_no_answer(
    behind: float, paced: bool
) -> None:
    """Its inputs in the window are stamped a little before it, and so are the answers to them."""
    entries = [answer(at - behind, behind + 0.03) for at in (10 + n / 10 for n in range(100))]
    before = answer(9.9 - behind, behind + 0.12, x=999.0)
    for kind, wanted in (
        ("presence", COUNT), ("rate", RATE), ("rate", WORST), ("bounds", X), ("expression", HOLDS)
    ):  # fmt: skip
        assert found(kind, wanted, [before, *entries], paced=paced).outcome == "passed"


def test_nor_do_they_where_their_steps_are_not_all_alike() -> None:
    off = [0.02, -0.02, 0.0, 0.01, -0.01]
    entries = [answer(9.84 + n / 10 + off[n % 5], 0.2) for n in range(100)]
    for first in (entries, [answer(9.75, 0.3, x=999.0), *entries]):
        for kind, wanted in (("presence", COUNT), ("rate", RATE), ("bounds", X)):
            assert found(kind, wanted, first).outcome == "passed"


def test_a_stack_that_ends_early_is_no_sensor_that_is_recorded_late() -> None:
    early = [answer(8 + n / 10, late=1.5) for n in range(5, 105)]
    finding = found("presence", {"topic": "/p", "min": 85}, early)
    assert finding.message.startswith("85 messages on /p, beside 15 of the lead-in")
    assert finding.figure == 85.0
    # Nor is one with too few answers to have a usual step.
    few = [answer(9.8, 0.3), answer(10.5), answer(15.0), answer(19.7)]
    assert found("presence", {"topic": "/p", "min": 1}, few).figure == 3.0


@pytest.mark.parametrize("behind", [0.0, 0.15])
def test_a_gap_of_the_recording_at_the_end_is_no_delay_of_a_sensor(behind: float) -> None:
    """Inputs end at 19.3 s, or sooner by more than a sensor may be recorded late."""
    for count in (94, 70):
        times = [10 + n / 10 for n in range(count)]
        inputs = [round(at * SECOND) for at in times]
        entries = [answer(at - behind, behind + 0.03) for at in times]
        before = answer(9.9 - behind, behind + 0.12, x=999.0)
        for kind, wanted in (
            ("bounds", X), ("expression", HOLDS), ("presence", {"topic": "/p", "min": count})
        ):  # fmt: skip
            finding = found(kind, wanted, [before, *entries], inputs=lambda inputs=inputs: inputs)
            assert finding.outcome == "passed", (count, finding)


def test_a_slow_stack_that_dies_before_the_last_input_comes_has_no_such_sensor() -> None:
    """After 0.5 s each, until 19.5 s: answers to the lead-in make up for none of the window."""
    slow = [answer(8 + n / 10, late=0.5) for n in range(15, 111)]
    finding = found("presence", {"topic": "/p", "min": 92}, slow)
    assert (finding.outcome, finding.figure) == ("failed", 91.0)


@pytest.mark.parametrize(
    ("hertz", "until"),
    [(1, 16.0), (1, 19.5), (1, 19.65), (1, 19.75), (100, 16.0), (100, 19.5), (100, 19.65)],
)
def test_of_a_sensor_that_is_recorded_late_and_stops_before_others_no_count_fails(
    hertz: int, until: float
) -> None:
    """It is recorded 0.3 s late, and another one goes on at so many hertz."""
    camera = [10 + n / 10 for n in range(100) if 10 + n / 10 < until]
    other = [10.9 + n / hertz for n in range(9 * hertz + 1)]
    inputs = sorted(round(at * SECOND) for at in camera + other)
    entries = [answer(at - 0.3, 0.35) for at in camera]
    least = len(camera)
    for kind, exact, more in (
        ("presence", least, least + 1),
        ("rate", least / 10, least / 10 + 0.1),
    ):
        finding = found(kind, {"topic": "/p", "min": exact}, entries, inputs=lambda: inputs)
        assert finding.outcome == "invalid"
        assert "3 more are stamped shortly before the window" in finding.message
        assert "may answer its first inputs: demand 3 less" in finding.message
        # Those that came after an answer to a later input answer no first ones.
        late = [answer(at - 0.3, 0.8 if at < 10.25 else 0.35) for at in camera]
        wanted = {"topic": "/p", "min": exact}
        assert found(kind, wanted, late, inputs=lambda: inputs).outcome == "failed"
        # Who has fewer than those may be fails.
        wanted = {"topic": "/p", "min": more}
        assert found(kind, wanted, entries, inputs=lambda: inputs).outcome == "failed"
    less = {"topic": "/p", "min": least - 3}
    assert found("presence", less, entries, inputs=lambda: inputs).outcome == "passed"


@pytest.mark.parametrize("together", [1, 2])
def test_who_dies_while_inputs_go_on_as_before_has_no_sensor_that_stops(together: int) -> None:
    """After 0.5 s each, until 19.53 s, with inputs of one camera or of two."""
    inputs = [round((10 + n / 10) * SECOND) + more for n in range(100) for more in range(together)]
    slow = [answer(8 + n / 10, late=0.53) for n in range(15, 111)]
    wanted = {"topic": "/p", "min": 92}
    finding = found("presence", wanted, slow, inputs=lambda: inputs)
    assert (finding.outcome, finding.figure) == ("failed", 91.0)


@pytest.mark.parametrize("step", [0.1, 0.7, 3.3])
def test_where_one_answer_may_be_of_the_first_input_its_lack_is_no_failure(step: float) -> None:
    """A sensor that is recorded 50 ms late; the window is no multiple of its step."""
    stamps = [9.95 + n * step for n in range(int(9.9 / step))]
    entries = [answer(at, 0.1) for at in stamps]
    count = len(entries)
    shorter = {"end": stamps[-1] + 0.05 + step / 4}
    hertz = count / (shorter["end"] - 10) - 1e-6
    for kind, least in (("presence", count), ("rate", hertz)):
        wanted = {"topic": "/p", "min": least}
        finding = found(kind, wanted, entries, **shorter)
        assert finding.outcome == "invalid"
        assert "may answer its first input: demand one less" in finding.message
        # Who lacks another one fails.
        assert found(kind, wanted, entries[:-1], **shorter).outcome == "failed"
        # Nor is it the first one's where an answer to a later input came before it.
        later = [answer(stamps[0], 0.15 + step), *entries[1:]]
        assert found(kind, wanted, later, **shorter).outcome == "failed"
        # Nor where it is a whole step before the window.
        before = [
            answer(10 - step, step + 0.01),
            *(answer(10 + n * step) for n in range(count - 1)),
        ]
        assert found(kind, wanted, before, **shorter).outcome == "failed"
    less = {"topic": "/p", "min": count - 1}
    assert found("presence", less, entries, **shorter).outcome == "passed"


def test_stamps_that_can_t_be_true_make_the_others_of_no_such_sensor() -> None:
    """The last second's answers are stamped later than they came."""
    ahead = [answer(10 + n / 10, -0.5 if n >= 90 else 0.03, x=0.0) for n in range(100)]
    finding = found("bounds", X, [answer(9.5, late=0.6, x=999.0), *ahead])
    assert (finding.outcome, finding.clock) == ("passed", "receipt")


def test_what_repeats_an_answer_to_it_shows_nothing_of_the_window() -> None:
    """As a stack that is stuck, and a map that is stamped once."""
    stuck = [("/p", 10.5 + n, stamped(9.0, 5.0, 0.0)) for n in range(10)]
    assert found("presence", {"topic": "/p"}, stuck).outcome == "failed"
    holds = {"topic": "/p", "field": "pose.position.x", "max": 9.0}
    assert found("bounds", holds, stuck, latching={"/p"}).outcome == "invalid"


def test_a_rounded_stamp_is_one_of_the_window() -> None:
    entries = [answer(9.9995), *WINDOW[1:]]
    assert found("presence", COUNT, entries).outcome == "passed"
    # A sensor that is recorded so late, or an answer to the lead-in.
    assert found("presence", COUNT, [answer(9.9985), *WINDOW[1:]]).outcome == "invalid"


def test_what_has_no_stamp_is_judged_by_its_receipt() -> None:
    entries = [("/p", 10.02 + n / 10, number(1.0)) for n in range(100)]
    assert found("presence", COUNT, entries).outcome == "passed"
    wall = [("/p", 10.02 + n / 10, stamped(1.0e6 + n, 5.0, 0.0)) for n in range(100)]
    for kind, wanted in (("presence", COUNT), ("rate", RATE), ("rate", WORST), ("bounds", X)):
        assert found(kind, wanted, wall).outcome == "passed"
