"""What belongs to a window and how much of it messages speak for, to the nanosecond."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from bagpipe.evaluate.evidence import Evidence, Received, Recording, Sample
from bagpipe.evaluate.finding import NoEvidenceError
from bagpipe.evaluate.window import (
    TopicMessages,
    backward,
    credible,
    frames_differ,
    messages_of,
    over_window,
    samples,
    spread,
    stamp_fault,
    times_of,
)
from tests.unit.evaluate.recordings import evidence, number, stamped

SECOND = 1_000_000_000


def seconds(*times: float) -> list[int]:
    return [round(time * SECOND) for time in times]


def window(start: float = 0.0, end: float = 10.0, **more: Any) -> Evidence:
    """A window of which nothing is read."""
    empty = Recording(lambda: b"", 0, None)
    first, last = seconds(start, end)
    return Evidence(empty, empty, first, last, **more)


def received(time: float, stamp: float | None = None, latching: bool = False) -> Received:
    class Connection:
        pass

    connection = Connection()
    connection.latching = latching  # type: ignore[attr-defined]
    of = None if stamp is None else round(stamp * SECOND)
    return Received(round(time * SECOND), memoryview(b""), connection, of)


# A rounded stamp, a millisecond of ten seconds.
A_BIT = 0.0001


@pytest.mark.parametrize(
    ("times", "usual", "share"),
    [
        (range(10), 0.0, 1.0),
        ([], 0.0, 0.0),
        ([-0.5, 10.0], 0.0, 0.0),  # the window's end is not in it
        ([0.0, 11.0], 0.0, A_BIT),  # nor is what comes after it
        ([0.0], 0.0, A_BIT),  # and its start is
        ([1, 2], 0.0, 0.2 + A_BIT),
        ([1, 2], 2.0, 0.4 + A_BIT),
        # Of three messages no step is usual, of four it is.
        ([0, 1, 2], 0.0, 0.2 + A_BIT),
        ([0, 1, 2, 3], 0.0, 0.4 + A_BIT),
        ([0, 1, 2, 3], 0.5, 0.4 + A_BIT),
        ([0, 1, 2, 3], 3.0, 0.6 + A_BIT),
        ([0, 1, 2, 6], 0.0, 0.7 + A_BIT),  # the usual one is the median
        ([6, 7, 8, 9], 0.0, 0.5 + A_BIT),
        ([9, 8, 3, 2, 1, 0], 0.0, 0.6 + A_BIT),  # stamps may come in any order
    ],
)
def test_messages_speak_for_all_but_the_longest_silence(
    times: Sequence[float], usual: float, share: float
) -> None:
    assert spread(seconds(*times), window(), 0.0, usual * SECOND) == pytest.approx(share, rel=1e-9)


@pytest.mark.parametrize("apart", [0.0, 0.02, 0.049])
def test_of_messages_that_come_together_the_step_to_the_first_is_usual(apart: float) -> None:
    def pairs(*times: float) -> float:
        return spread(seconds(*(at + more for at in times for more in (0, apart))), window(), 0.0)

    assert pairs(*range(10)) == pytest.approx(1.0, abs=0.0101)
    assert pairs(0, 1, 2, 3) == pytest.approx(0.4, abs=0.0101)
    # Of three such pairs no step is usual: whoever answers two of ten has not a step of 5 s.
    assert pairs(0, 5) == pytest.approx(0.5, abs=0.0101)
    assert pairs(0, 1, 2) == pytest.approx(0.2, abs=0.0101)


def test_without_a_usual_time_every_nanosecond_of_silence_counts() -> None:
    assert spread(seconds(0), window(), 0.0) == pytest.approx(A_BIT, rel=1e-9)
    assert spread(seconds(*range(10)), window(), 0.0) == 1.0
    assert spread(seconds(12, 13), window(10.0, 20.0), 0.0) == pytest.approx(0.3 + A_BIT)


def test_a_window_without_length_is_not_covered() -> None:
    assert spread(seconds(5), window(5.0, 5.0), 0.0) == 0.0
    assert spread(seconds(5), window(6.0, 5.0), 0.0) == 0.0


@pytest.mark.parametrize(("least", "share"), [(0.5, 0.5 + A_BIT), (0.51, 1.0)])
def test_where_too_little_is_covered_a_silence_counts_as_far_as_inputs_came(
    least: float, share: float
) -> None:
    """Inputs and answers of the first four seconds: six of ten are silent, and nobody asked."""
    inputs = seconds(*(n / 10 for n in range(41)))
    given = window(inputs=lambda: inputs)
    assert spread(seconds(0, 1, 2, 3, 4), given, least) == pytest.approx(share, rel=1e-9)


def test_where_enough_is_covered_nobody_asks_when_inputs_came() -> None:
    def asked() -> list[int]:
        raise AssertionError

    # Of four seconds without a message one is usual.
    share = spread(seconds(*range(7)), window(inputs=asked), 0.5)
    assert share == pytest.approx(0.7 + A_BIT)


def test_of_the_time_in_which_inputs_came_a_silence_takes_its_share() -> None:
    inputs = seconds(*(n / 10 for n in range(51)))
    # Five seconds of inputs, of which the last three were answered by nobody.
    share = spread(seconds(0, 1, 2), window(inputs=lambda: inputs), 1.0)
    assert share == pytest.approx(1 - (3 - 0.001) / 5, rel=1e-9)


@pytest.mark.parametrize("apart", [0, 20_000, 5_000_000, 40_000_000])
def test_inputs_that_come_together_are_no_stretches_between_gaps(apart: int) -> None:
    """As of a stereo camera with a picture a second; the recording has a gap of 16 s."""
    inputs = [at + more for at in seconds(*range(10), 25) for more in (0, apart)]
    given = window(end=30.0, inputs=lambda: inputs)
    assert given.input_time_between(0, 30 * SECOND) == pytest.approx(9 * SECOND, abs=2 * apart)
    assert spread(seconds(0.05), given, 0.75) < 0.01
    assert spread(seconds(0, 1, 2, 3), given, 0.75) == pytest.approx(0.45, abs=0.01)
    assert spread(seconds(*range(10)), given, 0.75) == pytest.approx(1.0, abs=0.01)


def test_behind_inputs_of_one_moment_alone_nobody_is_expected_to_answer() -> None:
    for inputs in (seconds(0, 0), seconds(0), seconds(-5, 0, 30)):
        given = window(inputs=lambda inputs=inputs: inputs)
        assert spread(seconds(0.05), given, 0.5) == 1.0


def test_the_usual_time_between_messages_passes_in_gaps_as_well() -> None:
    """Second-long stretches of inputs every ten seconds; the stack dies after four of them."""
    inputs = [at + n * SECOND // 10 for at in seconds(*range(0, 100, 10)) for n in range(10)]
    given = window(end=100.0, inputs=lambda: inputs)
    assert spread(seconds(0, 10, 20, 30), given, 0.75) == pytest.approx(0.4, abs=0.001)
    assert spread(seconds(0), given, 0.75, 10 * SECOND) == pytest.approx(0.1, abs=0.001)
    assert spread(seconds(*range(0, 100, 10)), given, 0.75) == 1.0


def test_a_usual_time_with_a_gap_in_it_is_longer_by_that() -> None:
    """One answer to five seconds of inputs, which lack for eight."""
    inputs = seconds(*(n / 10 for n in range(200) if not 50 < n < 130))
    given = window(end=20.0, inputs=lambda: inputs)
    assert spread(seconds(0, 5, 18), given, 0.75, 20 * SECOND / 3) == pytest.approx(0.916, abs=0.01)
    # After the first one of three it is dead.
    assert spread(seconds(0), given, 0.75, 20 * SECOND / 3) < 0.6


def on_topic(clock: str, inside: list[Received], late: Sequence[Received] = ()) -> TopicMessages:
    return TopicMessages("/t", inside, list(late), [], clock, "")  # type: ignore[arg-type]


def test_a_latched_message_speaks_for_all_that_comes_after_it() -> None:
    latched = on_topic("receipt", [received(6, latching=True), received(8, latching=True)])
    assert over_window(latched, window(), 0.0) == (
        0.4, "2 latched messages, in force for 40% of the window",
    )  # fmt: skip
    before = on_topic("header", [received(6, 0.0, latching=True)])
    assert over_window(before, window(5.0), 0.0)[0] == 1.0
    # One that is not latched among them lets the others lapse.
    mixed = on_topic("receipt", [received(6, latching=True), received(8)])
    assert over_window(mixed, window(), 0.0)[0] == pytest.approx(0.4 + A_BIT)
    # Stamped half a millisecond after the end, it was never in force; nor in no time.
    after = on_topic("header", [received(9.9996, 10.0005, latching=True)])
    assert over_window(after, window(), 0.0)[0] == 0.0
    assert over_window(before, window(5.0, 5.0), 0.0)[0] == 0.0
    nobody = over_window(on_topic("receipt", []), window(), 0.0)
    assert nobody == (0.0, "0 messages without a longer silence in 0% of the window")


def test_receipts_of_mode_max_leave_open_what_they_cover_and_stamps_do_not() -> None:
    given = window(paced=False)
    receipts = on_topic("receipt", [received(1), received(2)])
    assert over_window(receipts, given, 0.0) == (
        None, "2 messages, whose times mode max leaves open",
    )  # fmt: skip
    # As the log of a node of ROS 2, whose publisher is transient local.
    latched = on_topic("receipt", [received(9, latching=True), received(9, latching=True)])
    assert over_window(latched, given, 0.0) == (
        None, "2 messages, whose times mode max leaves open",
    )  # fmt: skip
    at_first = on_topic("receipt", [received(0, latching=True)])
    assert over_window(at_first, window(0.0, paced=False), 0.0)[0] == 1.0
    assert over_window(at_first, window(1.0, paced=False), 0.0)[0] == 1.0
    stamps = on_topic("header", [received(1, 5)], [received(12, 9)])
    assert over_window(stamps, given, 0.0)[0] == pytest.approx(0.5 + A_BIT)


@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        ([1, 1, 1], "2 of 2 times its stamp stands still: does /clock reach the node?"),
        ([1, 1, 1, 1, 2], "3 of 4 times its stamp stands still"),
        ([3, 2, 1], "2 of 2 times its stamp goes back"),
        ([4, 3, 2, None, 5], "2 of 3 times its stamp goes back"),
        # Half of the times is not yet a hint, and nor are two messages.
        ([1, 1, 2], ""),
        ([2, 1, 2], ""),
        ([1, 1, 0.5, 2], ""),  # one stands still and one goes back
        ([1, 1], ""),
        ([2, 1, None], ""),
        ([1, 2, 3], ""),
    ],
)
def test_stamps_that_mostly_stand_still_or_go_back_are_a_hint(
    stamps: list[float | None], words: str
) -> None:
    found = backward([received(9, stamp) for stamp in stamps])
    assert found.startswith(words)
    assert bool(found) == bool(words)


@pytest.mark.parametrize(
    ("stamp", "can_be"),
    [(39.999, False), (40.0, True), (105.0, True), (107.0, True), (107.001, False)],
)
def test_a_stamp_may_be_a_minute_older_than_the_play_and_so_much_later_than_its_receipt(
    stamp: float, can_be: bool
) -> None:
    time, at, begin, ahead = seconds(105, stamp, 100, 2)
    assert credible(time, at, begin, ahead) == can_be


def split(*entries: tuple[float, float], **more: Any) -> tuple[list[float], ...]:
    """Receipts of what was received in a window from 100 to 110 s: inside, late, and nobody's."""
    recorded = [("/t", at, stamped(stamp, 0, 0)) for at, stamp in entries]
    found = messages_of("/t", evidence(recorded, start=100.0, end=110.0, **more))
    assert (found.clock, found.fault) == ("header", "")
    return tuple(
        [e.time / SECOND for e in each] for each in (found.inside, found.late, found.others)
    )


def test_what_comes_after_the_end_belongs_to_the_window_that_its_stamp_lies_in() -> None:
    assert split((109, 108.5), (110, 109.5), (111, 109.999), (112, 110)) == (
        [109], [110, 111], [112],
    )  # fmt: skip
    # Stamped after the end, it answers nothing of the window.
    assert split((109, 108.5), (112, 111)) == ([109], [], [112])
    # What was answered already is not answered again.
    assert split((109, 108.5), (111, 108.5), (112, 109), (113, 109)) == ([109], [112], [111, 113])


@pytest.mark.parametrize("early", [0, 1, 5])
def test_as_many_messages_answer_a_stamp_after_the_end_as_another_one(early: int) -> None:
    """Two of each stamp, as of two lanes, of which so many are late."""
    both = [(109.0 + at, x) for at in (0, 0.1, 0.2, 0.3) for x in (1, 2)]
    recorded = [
        ("/t", (109.5 if n < early else 111) + n / 100, stamped(at, x, 0))
        for n, (at, x) in enumerate(both)
    ]
    # What is published on and on has one stamp, and a repeated one is the same to the byte.
    repeated = [("/t", 112.0, stamped(109.0, 1, 0))]
    on_and_on = [("/t", 113 + x / 10, stamped(109.3, x, 0)) for x in range(3, 9)]
    given = evidence([*recorded, *repeated, *on_and_on], start=100.0, end=110.0)
    found = messages_of("/t", given)
    assert (len(found.inside), len(found.late), len(found.others)) == (early, 8 - early, 7)
    alone = [
        ("/t", 109.5, stamped(109, 0, 0)),
        *(("/t", 109 + x, stamped(109, x, 0)) for x in (1, 2)),
    ]
    found = messages_of("/t", evidence(alone, start=100.0, end=110.0))
    assert (len(found.inside), len(found.late), len(found.others)) == (1, 0, 2)


def held(step: float, keyframes: float, until: float, ahead: float = 0.0) -> list[Any]:
    """What a timer publishes from 100 s on, with the stamp of the last keyframe before 110 s."""
    ticks = [n * step for n in range(round((until - 100) / step))]
    stamps = [min(at + ahead, 9.99) // keyframes * keyframes for at in ticks]
    return [
        ("/t", 100.004 + at, stamped(100 + stamp, at, 0))
        for at, stamp in zip(ticks, stamps, strict=True)
    ]


@pytest.mark.parametrize("until", [110.1, 110.4, 113.0, 130.0])
@pytest.mark.parametrize(
    ("step", "keyframes", "ahead"), [(0.1, 3, 0), (0.1, 4, 2.9), (0.1, 0.2, 0), (0.2, 0.5, 0)]
)
def test_no_tick_of_a_timer_after_the_end_answers_the_stamp_that_it_holds(
    step: float, keyframes: float, ahead: float, until: float
) -> None:
    given = evidence(held(step, keyframes, until, ahead), start=100.0, end=110.0)
    found = messages_of("/t", given)
    assert (len(found.inside), len(found.late)) == (round(10 / step), 0)


@pytest.mark.parametrize("apart", [0.0, 0.02, 0.25])
@pytest.mark.parametrize("late", [0.03, 0.95, 1.0, 10.0])
def test_what_answers_one_stamp_in_a_burst_or_beside_others_is_of_the_window(
    apart: float, late: float
) -> None:
    """Two lanes for each input at 10 Hz, by one node or by two of which one takes longer."""
    lanes = [
        ("/t", at + late + n * apart, stamped(at, n, 0))
        for at in (100 + n / 10 for n in range(100))
        for n in (0, 1)
    ]
    found = messages_of("/t", evidence(lanes, start=100.0, end=110.0))
    assert (len(found.answers), len(found.others)) == (200, 0)


@pytest.mark.parametrize(("paced", "answers"), [(True, 199), (False, 200)])
def test_of_lanes_that_may_be_a_timer_s_only_those_to_the_last_input_are_in_doubt(
    paced: bool, answers: int
) -> None:
    lanes = [
        ("/t", at + 10.0 + n * 0.06, stamped(at, n, 0))
        for at in (100 + n / 10 for n in range(100))
        for n in (0, 1)
    ]
    found = messages_of("/t", evidence(lanes, start=100.0, end=110.0, paced=paced))
    assert (len(found.late), len(found.others)) == (answers, 200 - answers)


def test_what_answers_the_lead_in_is_nobody_s_unless_there_was_none() -> None:
    entries = [(109.0, 108.5), (111.0, 99.0), (112.0, 100.0)]
    assert split(*entries, lead_in_start=95 * SECOND) == ([109], [112], [111])
    for none in (None, 100 * SECOND):
        assert split(*entries, lead_in_start=none) == ([109], [111, 112], [])


TENTHS = [n / 10 for n in range(100)]


@pytest.mark.parametrize(
    ("stamps", "end", "behind"),
    [
        (TENTHS, 110.0, 0.0),
        ([at - 0.15 for at in TENTHS], 110.0, 0.15),
        ([at - 1.0 for at in TENTHS], 110.0, 1.0),
        ([at - 1.001 for at in TENTHS], 110.0, 0.0),  # such a stack has died
        ([at - 0.3 for at in TENTHS if at < 2], 102.0, 0.0),  # more than a tenth of the window
        ([at - 0.2 for at in TENTHS if at < 2], 102.0, 0.2),
        # A message that is lost, and several for each input.
        ([at - 0.2 for at in TENTHS if at != 5.0], 110.0, 0.2),
        ([at + more for at in TENTHS for more in (0.0, 0.001)], 110.0, 0.0),
        ([at for at in TENTHS if at in (0.1, 4.0, 9.5)], 110.0, 0.0),  # no usual step
        ([], 110.0, 0.0),
    ],
)
def test_stamps_are_behind_by_how_much_they_end_before_the_window(
    stamps: list[float], end: float, behind: float
) -> None:
    recorded = [("/t", 101.5 + at, stamped(100 + at, 0, 0)) for at in stamps]
    found = messages_of("/t", evidence(recorded, start=100.0, end=end))
    # With half of their usual step.
    assert found.behind / SECOND == pytest.approx(behind + 0.05 if behind else 0.0, abs=1e-6)


def test_one_message_without_a_stamp_takes_the_clock_from_all() -> None:
    recorded = [("/t", 11.0, stamped(10.5, 0, 0)), ("/u", 11.0, number(1.0))]
    given = evidence(recorded)
    assert [messages_of(topic, given).clock for topic in ("/t", "/u", "/none")] == [
        "header", "receipt", "receipt",
    ]  # fmt: skip


def fault(*pairs: tuple[float, float | None], start: float = 100.0, ahead: float = 0.0) -> str:
    messages = [received(*pair) for pair in pairs]
    return stamp_fault("/t", messages, window(start, start + 10), round(ahead * SECOND))


def test_stamps_that_can_t_be_are_counted_with_the_first_of_them() -> None:
    assert fault((101, 100), (102, None), (103, 103)) == ""
    assert fault((101, 0), (102, 101), (103, 0)) == "2 messages on /t have an empty header.stamp"
    late = fault((101, 100), (102, 105.5), (103, 104), ahead=1.0)
    assert late.startswith(
        "1 of 3 messages on /t are stamped later than they came, the first at 2.000 s by 3.500 s:"
    )
    early = fault((101, 30), (102, 39.5), (103, 101))
    assert early.startswith(
        "2 of 3 messages on /t have stamps from before the recording, the first at 1.000 s by"
        " 70.000 s:"
    )
    days = fault((101, 101 + 2 * 86_400), (102, 102 + 3 * 86_400))
    assert "2 of 2 messages on /t are stamped later" in days
    assert "by 2 days:" in days
    assert "by 3 days:" in fault((101, 101 + 3 * 86_400))
    assert "by 172799.000 s:" in fault((101, 100 + 2 * 86_400))
    # A second has 1,000,000,000 ns, neither more nor fewer.
    assert "by 172799.001 s:" in fault((101, 100.0006 + 2 * 86_400))
    assert "by 172799.000 s:" in fault((101, 100.0004 + 2 * 86_400))
    assert "the first at 1000000.000 s by" in fault((1_000_100, 1_000_101))


def test_second_zero_is_empty_where_the_play_begins_with_second_one() -> None:
    assert fault((1.5, 0), start=1.0) == "1 messages on /t have an empty header.stamp"
    assert fault((1.5, 0), start=0.999) == ""


def test_a_topic_s_times_are_those_of_its_clock() -> None:
    messages = [received(1, 0), received(2, 1.5)], [received(11, 3)]
    assert times_of(on_topic("header", *messages)) == seconds(0, 1.5, 3)
    assert times_of(on_topic("receipt", *messages)) == seconds(1, 2, 11)


def test_the_messages_of_a_window_are_decoded_in_the_order_of_their_receipt() -> None:
    entries = [("/t", at, stamped(at - 0.5, x, 0)) for at, x in ((11, 1), (20.4, 2), (21, 3))]
    given = evidence(entries)
    found = samples(messages_of("/t", given), given)
    assert [(each.time, each.message.pose.position.x) for each in found] == [
        (11 * SECOND, 1.0), (20_400_000_000, 2.0),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("message", "words"),
    [(stamped(20.5, 0, 0), "with stamps outside of it"),
     (number(1.0), "and no stamp shows what they answer")],
)  # fmt: skip
def test_where_all_came_too_late_it_says_by_which_clock(message: Any, words: str) -> None:
    given = evidence([("/t", 21.0, message), ("/t", 22.0, message)])
    with pytest.raises(NoEvidenceError) as refused:
        samples(messages_of("/t", given), given)
    assert str(refused.value) == (
        f"no message on /t belongs to the case's window: all 2 came after its end, {words}"
    )


def in_frames(*frames: str | None) -> list[Sample]:
    """Messages with these frames; None is one without a header."""
    headers = [None if name is None else SimpleNamespace(frame_id=name) for name in frames]
    return [Sample(0, SimpleNamespace(header=header)) for header in headers]


@pytest.mark.parametrize(
    ("ours", "theirs", "shown"),
    [
        (["map"], ["map"], None),
        (["/map", "map"], ["map", "/map"], None),  # of tf, and of tf2
        (["map"], ["odom"], ("the frame map", "the frame odom")),
        ([""], ["map"], ("no frame", "the frame map")),
        (["map"], ["map", ""], ("the frame map", "the frame no frame, then map")),
        # Several frames are no one's, also where both have the same ones.
        (["a", "b"], ["b", "a"], ("the frame a, then b", "the frame a, then b")),
        (["d", "c", "b", "a"], ["a"], ("the frame a, then b, then c", "the frame a")),
        # Who names none can't be asked.
        (["map"], [""], None),
        (["map"], [None], None),
        ([None], ["map"], None),
        ([None, "odom"], ["map"], ("the frame odom", "the frame map")),
    ],
)
def test_frames_differ_where_a_figure_would_be_of_two(
    ours: list[str | None], theirs: list[str | None], shown: tuple[str, str] | None
) -> None:
    found = frames_differ(in_frames(*ours), in_frames(*theirs), "/t", "/other")
    wanted = "" if shown is None else f"/t is in {shown[0]} and /other in {shown[1]}: figures of"
    assert found[: len(wanted) or None] == wanted
