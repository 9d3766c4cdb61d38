"""Counts, rates and delays of messages, each worked out by hand."""

from typing import Any

import pytest

from bagpipe.evaluate.delivery import percentile
from bagpipe.evaluate.finding import Finding
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion
from tests.unit.evaluate.recordings import evidence, number, stamped

SECOND = 1_000_000_000


def plain(*times: float) -> list[Any]:
    return [("/t", at, number(at)) for at in times]


def with_stamps(*pairs: tuple[float, float]) -> list[Any]:
    return [("/t", at, stamped(stamp, at, 0.0)) for at, stamp in pairs]


def found(kind: str, entries: list[Any], wanted: dict[str, Any], **more: Any) -> Finding:
    """In a window from 10 to 20 s."""
    criterion = Criterion.model_validate({"name": "c", kind: {"topic": "/t"} | wanted})
    [finding] = evaluate([criterion], evidence(entries, **more))
    return finding


@pytest.mark.parametrize(
    ("percent", "value"), [(0.1, 15), (20, 15), (20.1, 20), (30, 20), (40, 20), (50, 35), (100, 50)]
)
def test_a_percentile_is_the_value_of_the_nearest_rank(percent: float, value: float) -> None:
    assert percentile([50, 20, 15, 40, 35], percent) == value


@pytest.mark.parametrize(
    ("rate", "seconds"),
    # Above 1 what lies in the recording itself would be divided, too.
    [(1.0, 0.05), (0.1, 0.5), (0.5, 0.1), (4.0, 0.05)],
)
def test_a_play_at_another_rate_makes_no_stack_faster(rate: float, seconds: float) -> None:
    entries = with_stamps(*((10.05 + n, 10.0 + n) for n in range(10)))
    for most, outcome in ((seconds + 0.001, "passed"), (seconds - 0.001, "failed")):
        finding = found("latency", entries, {"max": f"{most:.3f}s"}, rate=rate)
        assert finding.figure == pytest.approx(seconds, abs=1e-8)
        assert finding.outcome == outcome
        assert ("in real time at a rate of" in finding.message) == (rate < 1)


@pytest.mark.parametrize("tenths", range(1, 1001))
def test_the_rank_is_that_of_the_percentile_as_it_is_written(tenths: int) -> None:
    for count in (1, 7, 10, 999, 1000, 2000):
        rank = -(-tenths * count // 1000)
        assert percentile(range(1, count + 1), tenths / 10) == rank


def test_the_delay_is_that_of_the_percentile_that_is_asked() -> None:
    entries = with_stamps(*((10.0 + n + 0.001 * (9 - n), 10.0 + n) for n in range(10)))
    for percent, delay in ((90, 0.008), (91, 0.009), (10, 0.0), (50, 0.004)):
        finding = found("latency", entries, {"percentile": percent, "max": "8ms"})
        assert finding.figure == pytest.approx(delay, abs=1e-8)
        assert finding.outcome == ("failed" if percent == 91 else "passed")
        assert f"at percentile {percent} of 10 messages on /t" in finding.message


def test_delays_in_too_little_of_the_window_are_reported_with_a_remedy() -> None:
    still = found("latency", with_stamps((11, 10), (12, 10), (13, 10)), {"max": "9s"})
    few = found("latency", with_stamps((11, 10), (12, 11), (13, 12)), {"max": "9s"})
    assert (still.outcome, few.outcome) == ("invalid", "invalid")
    assert "2 of 2 times its stamp stands still" in still.message
    assert "look at when they came, or lower minCoverage" in few.message


def test_a_delay_from_second_zero_is_exact() -> None:
    finding = found("latency", with_stamps((0.25, 0.0)), {"max": "1s"}, start=0.0, end=1.0)
    assert finding.figure == 0.25


@pytest.mark.parametrize(
    ("least", "outcome", "figure"), [(4, "passed", 10.0), (5, "passed", 10.0), (6, "failed", 5.0)]
)
def test_where_too_few_are_their_own_these_are_counted(
    least: int, outcome: str, figure: float
) -> None:
    entries = [("/t", 10.2 + n / 2, stamped(10 + n // 2, n // 2, 0.0)) for n in range(10)]
    finding = found("presence", entries, {"min": least})
    assert (finding.outcome, finding.figure) == (outcome, figure)
    assert "on /t, 5 of 10 repeat another one" in finding.message


def test_silence_that_is_allowed_is_seen_in_the_whole_window() -> None:
    finding = found("presence", [], {"min": 0, "max": 3})
    assert (finding.outcome, finding.figure, finding.coverage) == ("passed", 0.0, 1.0)
    assert (finding.covered, finding.limit) == ("the whole window", "0 to 3 messages")


def test_what_comes_after_the_end_without_a_stamp_is_late_and_not_too_much() -> None:
    entries = plain(*(10 + n for n in range(10)), 20, 21)
    most = found("presence", entries, {"max": 10})
    assert (most.outcome, most.figure, most.limit) == ("passed", 12.0, "1 to 10 messages")
    assert (most.coverage, most.covered) == (
        0.8333, "the whole window, and 2 of 12 messages after its end",
    )  # fmt: skip
    assert found("presence", entries, {"max": 9}).outcome == "failed"
    assert found("presence", entries, {"max": 11}).outcome == "passed"
    assert found("presence", entries, {"min": 12}).outcome == "passed"
    assert found("presence", entries, {"min": 12}).limit == "at least 12 messages"
    assert found("presence", entries, {"min": 13}).outcome == "failed"


def test_too_few_stay_too_few_however_late_they_were() -> None:
    late = plain(19, 21, 22, 23)
    assert found("presence", late, {"min": 5}).outcome == "failed"
    doubt = found("presence", late, {"min": 4})
    assert (doubt.outcome, doubt.coverage, doubt.clock) == ("invalid", 0.25, "receipt")


def test_what_a_stamp_puts_elsewhere_is_no_late_answer() -> None:
    entries = with_stamps((12, 11), (21, 19), (22, 20.5))
    finding = found("presence", entries, {"min": 2})
    assert (finding.outcome, finding.figure, finding.coverage) == ("passed", 2.0, 1.0)
    assert found("presence", entries, {"min": 3}).outcome == "failed"


@pytest.mark.parametrize(
    ("times", "hertz"),
    [
        ([12, 14, 16, 18], 0.5),
        ([13, 14, 16, 18], 1 / 3),  # until the first
        ([12, 14, 16], 0.25),  # from the last
        ([12, 14, 17.5, 18, 19], 1 / 3.5),
        ([15], 0.2),
    ],
)
def test_the_worst_rate_is_that_of_the_longest_gap_with_the_window_s_ends(
    times: list[float], hertz: float
) -> None:
    finding = found("rate", plain(*times), {"min": 0.3, "over": "worst"})
    assert finding.figure == hertz
    assert finding.outcome == ("passed" if hertz > 0.3 else "failed")
    assert (finding.coverage, finding.covered) == (1.0, "the whole window")
    assert (finding.clock, finding.unit, finding.direction) == ("receipt", "Hz", "higher")


def test_silence_is_too_low_a_rate_and_no_rate_that_is_low_enough() -> None:
    assert found("rate", [], {"min": 0.1}).outcome == "failed"
    for wanted in ({"max": 5.0}, {"min": 0.0, "max": 5.0}):
        finding = found("rate", [], wanted)
        assert finding.outcome == "invalid"
        assert finding.message == "no message on /t: a stack that is silent shows no rate"


def test_repeated_messages_fill_no_gap() -> None:
    """One answer that is published again and again is a long silence, however often it comes."""
    stuck = [("/t", 10 + n / 2, stamped(10, 1.0, 0.0)) for n in range(20)]
    finding = found("rate", stuck, {"min": 1.0, "over": "worst"})
    assert (finding.outcome, finding.figure) == ("failed", 0.1)
    assert "19 of 20 repeat another one" in finding.message
    often = found("rate", stuck, {"max": 1.0, "over": "worst"})
    assert (often.outcome, often.figure) == ("failed", 2.0)
    pairs = [("/t", 10 + n / 2, stamped(10 + n // 2, n // 2, 0.0)) for n in range(20)]
    enough = found("rate", pairs, {"min": 1.0, "over": "worst"})
    assert (enough.outcome, enough.figure) == ("passed", 1.0)
    both = found("rate", pairs, {"min": 1.0, "max": 1.9, "over": "worst"})
    assert (both.outcome, both.figure) == ("failed", 2.0)


def test_in_mode_max_the_longest_gap_is_one_of_stamps() -> None:
    """Bag time runs ahead of the stack: all that it answers may come at the window's end."""
    wanted = {"min": 5.0, "over": "worst"}
    all_at_the_end = with_stamps(*((19.9 + n / 2000, 10 + n / 10) for n in range(100)))
    finding = found("rate", all_at_the_end, wanted, paced=False)
    assert (finding.outcome, finding.clock, finding.coverage) == ("passed", "header", 1.0)
    assert finding.figure == pytest.approx(10.0)
    after = with_stamps(*((19.9 + n / 100, 10 + n / 10) for n in range(100)))
    assert found("rate", after, wanted, paced=False).outcome == "passed"
    gap = found("rate", all_at_the_end[:40] + all_at_the_end[45:], wanted, paced=False)
    assert gap.outcome == "failed"
    assert gap.figure == pytest.approx(1 / 0.6)
    dead = found("rate", all_at_the_end[:50], wanted, paced=False)
    assert dead.outcome == "failed"
    assert dead.figure == pytest.approx(1 / 5.1)
    assert finding.course is not None
    assert {round(hertz, 3) for _, hertz in finding.course["points"]} == {10.0}
    # Paced, the same is a gap of almost the whole window.
    assert found("rate", all_at_the_end, wanted).figure == pytest.approx(1 / 9.9)


def test_in_mode_max_a_stamp_from_before_the_window_begins_no_gap() -> None:
    entries = with_stamps((10.5, 5.0), *((11.0 + n, 10.0 + n) for n in range(10)))
    finding = found("rate", entries, {"min": 1.0, "over": "worst"}, paced=False)
    assert (finding.outcome, finding.figure) == ("passed", 1.0)


@pytest.mark.parametrize("paced", [True, False])
@pytest.mark.parametrize("old", [[], [(18.5, 5.0)]])
def test_a_silence_at_the_end_is_a_gap_in_each_mode(paced: bool, old: list[Any]) -> None:
    """Twice a second until 18.5 s; in mode max all comes at the end."""
    stamps = [10 + n / 2 for n in range(18)]
    entries = with_stamps(*old, *((at if paced else 19.9, at) for at in stamps))
    finding = found("rate", entries, {"min": 0.8, "over": "worst"}, paced=paced)
    assert finding.outcome == "failed"
    assert finding.figure == pytest.approx(1 / 1.5)


def test_in_mode_max_no_gap_is_known_without_stamps() -> None:
    wanted = {"min": 5.0, "over": "worst"}
    for times in ([19.9] * 100, [10 + n / 10 for n in range(100)], [20.5] * 100):
        finding = found("rate", plain(*times), wanted, paced=False)
        assert finding.outcome == "invalid"
        assert finding.message.startswith("mode max leaves open when messages on /t were published")
    assert found("rate", [], wanted, paced=False).outcome == "failed"


@pytest.mark.parametrize("over", ["window", "worst"])
def test_a_topic_that_is_silent_fails_and_shows_no_known_fault(over: str) -> None:
    wanted = {"topic": "/t", "min": 5.0, "over": over}
    given = [{"name": "c", "rate": wanted}, {"name": "d", "rate": wanted, "expectFailure": True}]
    criteria = [Criterion.model_validate(each) for each in given]
    silent, known = evaluate(criteria, evidence([]))
    assert (silent.outcome, known.outcome) == ("failed", "invalid")
    assert known.message.startswith("expected to fail, but not like this")
    # A gap as long as the window is no rate that is high enough, either.
    barely = found("rate", [], {"min": 0.05, "over": over})
    assert barely.outcome == ("failed" if over == "window" else "invalid")
    seen = evaluate(criteria, evidence(plain(*(10 + n for n in range(9)))))
    assert [each.outcome for each in seen] == ["failed", "passed"]


def test_a_window_without_length_has_no_rate() -> None:
    for end in (10.0, 9.0):
        finding = found("rate", plain(10), {"min": 1.0}, end=end)
        assert (finding.outcome, finding.message) == (
            "invalid", "the case's window has no length",
        )  # fmt: skip


def test_repeated_messages_are_a_rate_where_it_may_not_be_too_high_only() -> None:
    entries = [("/t", 10 + n / 2, stamped(10 + n // 2, n // 2, 0.0)) for n in range(20)]
    enough = found("rate", entries, {"min": 1.0})
    assert (enough.outcome, enough.figure) == ("passed", 1.0)
    assert found("rate", entries, {"min": 0.9}).figure == 1.0
    assert found("rate", entries, {"min": 0.9, "max": 2.0}).figure == 2.0
    few = found("rate", entries, {"min": 1.01})
    assert (few.outcome, few.figure) == ("failed", 1.0)
    assert few.message.startswith("1 Hz on /t, 10 of 20 repeat another one, and may be")
    many = found("rate", entries, {"max": 1.9})
    assert (many.outcome, many.figure) == ("failed", 2.0)


@pytest.mark.parametrize("least", [4.0, 5.2, 9.0])
@pytest.mark.parametrize("over", ["window", "worst"])
def test_another_least_rate_changes_no_figure(least: float, over: str) -> None:
    """A version with each message twice is no better than one with more of its own."""
    twice = [
        ("/t", 10 + n / 5.2 + more, stamped(10 + n / 5.2, 1.0, 0.0))
        for n in range(52)
        for more in (0.0, 0.05)
    ]
    more = [("/t", 10 + n / 8, stamped(10 + n / 8, 1.0, 0.0)) for n in range(80)]
    for entries, hertz in ((twice, 5.2), (more, 8.0)):
        finding = found("rate", entries, {"min": least, "over": over})
        assert finding.figure == pytest.approx(hertz)
        assert finding.direction == "higher"


@pytest.mark.parametrize("late", [2.5, 5.0])
def test_of_stamps_and_receipts_those_are_counted_that_are_more(late: float) -> None:
    """Answers to ten inputs of the window and to two of the lead-in, after so long."""
    entries = with_stamps(*((8.0 + n + late, 8.0 + n) for n in range(12)), (19.9, 19.8))
    wanted = {"min": 0.1, "minCoverage": 0}
    # Eleven come in the window, or eight; eleven are stamped in it.
    assert found("rate", entries, wanted, lead_in_start=8 * SECOND).figure == 1.1
    # Without a lead-in an older stamp could belong to nothing else.
    assert found("rate", entries[:-1], wanted, lead_in_start=8 * SECOND).figure == 1.0
    assert found("rate", entries[:-1], wanted).figure == 1.2


def test_messages_after_the_end_that_answer_nothing_are_reported() -> None:
    entries = with_stamps((12.0, 11.0), (21.0, 20.5), (22.0, 20.7))
    finding = found("rate", entries, {"min": 0.1, "minCoverage": 0})
    assert finding.message == "0.1 Hz on /t, 2 more after the window's end"


def test_a_window_of_half_a_second_has_a_rate() -> None:
    finding = found("rate", plain(10, 10.1, 10.2, 10.3, 10.4), {"min": 9.0}, end=10.5)
    assert (finding.outcome, finding.figure) == ("passed", 10.0)


@pytest.mark.parametrize(
    ("count", "length", "hertz"), [(7, 0.28, 25.0), (7, 5.6, 1.25), (3, 30.0, 0.1), (41, 8.2, 5.0)]
)
def test_a_rate_that_is_just_the_least_is_enough(count: int, length: float, hertz: float) -> None:
    """7 / 0.28 is below 25 in binary."""
    entries = plain(*(10 + n * length / count for n in range(count)))
    finding = found("rate", entries, {"min": hertz, "max": hertz}, end=10 + length)
    assert (finding.outcome, finding.figure) == ("passed", hertz)


def test_a_rate_is_covered_but_for_the_longest_silence_beyond_its_usual_step() -> None:
    finding = found("rate", plain(10, 12, 14, 16), {"min": 0.1, "minCoverage": 0})
    # Of 4 s, 2.5 s are the rate's own step, and one millisecond is rounding.
    assert finding.coverage == 0.8501
    assert finding.covered == "4 messages without a longer silence in 85% of the window"
    assert found("rate", plain(16), {"min": 0.1}).coverage == 1.0
    doubt = found("rate", plain(10, 12, 14, 16), {"min": 0.1, "minCoverage": 0.86})
    assert doubt.outcome == "invalid"
    assert "look at when they came, or lower minCoverage" in doubt.message


def test_receipts_of_mode_max_leave_open_what_a_rate_covers() -> None:
    wanted = {"min": 0.1, "minCoverage": 0}
    unpaced = found("rate", plain(16), wanted, paced=False)
    assert (unpaced.figure, unpaced.coverage) == (0.1, None)
    by_stamp = found("rate", with_stamps((16, 15)), wanted, paced=False)
    assert (by_stamp.clock, by_stamp.coverage) == ("header", 1.0)


def test_a_latched_topic_that_dies_has_no_rate_and_no_latency_in_the_rest() -> None:
    """What a latched message says holds on; that it came does not, as with a pose of amcl."""
    half = with_stamps(*((10.02 + n / 10, 10 + n / 10) for n in range(50)))
    for kind, wanted in (("rate", {"min": 5.0}), ("latency", {"max": "100ms"})):
        for latching in ((), {"/t"}):
            finding = found(kind, half, wanted, latching=latching)
            assert finding.outcome == "invalid"
            assert finding.coverage == pytest.approx(0.5, abs=0.02)
    holds = {"topic": "/t", "field": "pose.position.y", "max": 1.0}
    assert found("bounds", half, holds, latching={"/t"}).coverage == 1.0


def test_a_latched_topic_that_goes_on_has_a_rate_and_a_latency() -> None:
    entries = with_stamps(*((10.02 + n / 10, 10 + n / 10) for n in range(100)))
    for kind, wanted in (("rate", {"min": 10.0}), ("latency", {"max": "100ms"})):
        finding = found(kind, entries, wanted, latching={"/t"})
        assert (finding.outcome, finding.coverage) == ("passed", 1.0)
    once = found("latency", entries[:1], {"max": "100ms", "minCoverage": 0}, latching={"/t"})
    assert once.outcome == "passed"


@pytest.mark.parametrize(
    ("bounds", "better"),
    [({"min": 1}, "higher"), ({"max": 20}, "lower"), ({"min": 1, "max": 20}, "")],
)
def test_a_rate_is_better_away_from_its_one_bound(bounds: dict[str, float], better: str) -> None:
    """A version that warns more often is not better for it."""
    for over in ("window", "worst"):
        finding = found("rate", plain(13, 14, 16), {**bounds, "over": over})
        assert finding.direction == better
