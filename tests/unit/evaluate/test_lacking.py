"""Answers to the lead-in make up for none of the window's where the inputs' stamps show them.

Each world is a recording with sensors that are recorded late, and two stacks: an honest one answers
every input of one sensor, a bad one lacks some of the answers to the window.
"""

import random
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import pytest

from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.finding import Finding
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion
from tests.unit.evaluate.recordings import SECOND, evidence, stamped

BEGIN, START, END = 8 * SECOND, 10 * SECOND, 20 * SECOND
Inputs = dict[str, list[tuple[int, int]]]


def answering(inputs: Inputs) -> Any:
    """As a source answers."""

    def between(begin: int, end: int) -> Inputs:
        return {
            topic: [(time, stamp) for time, stamp in each if begin <= time < end]
            for topic, each in inputs.items()
        }

    return between


def judged(kind: str, wanted: dict[str, Any], given: Evidence, **more: Any) -> Finding:
    [finding] = evaluate([Criterion.model_validate({"name": "c", kind: wanted} | more)], given)
    return finding


@dataclass(frozen=True)
class World:
    """Inputs as (time, stamp) in ns; the stack follows /camera, and needs so long for each."""

    inputs: Inputs
    takes: int
    paced: bool

    @classmethod
    def of(cls, seed: int) -> "World":
        chance = random.Random(seed)  # noqa: S311
        inputs = {"/camera": sensor(chance, chance.choice([5, 10, 20]))}
        if chance.random() < 0.3:  # a stereo camera's other half
            inputs["/right"] = list(inputs["/camera"])
        for topic in ("/imu", "/lidar")[: chance.randrange(3)]:
            inputs[topic] = sensor(chance, chance.choice([1, 10, 50]))
        return cls(inputs, chance.randrange(5, 600) * 1_000_000, paced=chance.random() < 0.8)

    @property
    def window(self) -> list[tuple[int, int]]:
        """The camera's inputs in it."""
        return [each for each in self.inputs["/camera"] if START <= each[0] < END]

    def evidence(self, lacks: Collection[int] = (), *, known: bool = True) -> Evidence:
        """Of a stack that answers no input with one of these stamps; the inputs' are `known`."""
        answered = [each for each in self.inputs["/camera"] if each[1] not in lacks]
        recorded = [
            ("/p", (time + self.takes) / SECOND, stamped(stamp / SECOND, 0.0, 0.0))
            for time, stamp in answered
            if time + self.takes >= START
        ]
        times = sorted(time for each in self.inputs.values() for time, _ in each)
        given = evidence(recorded, lead_in_start=BEGIN, paced=self.paced, inputs=lambda: times)
        return replace(given, input_stamps=answering(self.inputs) if known else None)


def sensor(chance: random.Random, hertz: int) -> list[tuple[int, int]]:
    """Its inputs, recorded 0 to 900 ms late and at uneven times."""
    step = SECOND // hertz
    late, uneven = chance.randrange(901) * 1_000_000, chance.choice([0, 0, step // 10, step // 3])
    first = BEGIN - SECOND + chance.randrange(step)
    stamps = range(first, END, step)
    recorded = [(stamp + late + chance.randrange(uneven + 1), stamp) for stamp in stamps]
    return [each for each in recorded if BEGIN <= each[0] < END]


def lacked(world: World, seed: int) -> set[int]:
    """The stamps of the window's inputs that a bad stack leaves out: the last ones, as it dies, or
    any.
    """
    chance = random.Random(seed)  # noqa: S311
    stamps = [stamp for _, stamp in world.window]
    count = chance.randrange(1, max(2, len(stamps) // 12))
    return set(stamps[-count:] if chance.random() < 0.7 else chance.sample(stamps, count))


def outcomes(world: World, lacks: Collection[int] = ()) -> list[tuple[str, str]]:
    """Of presence and rate, without the inputs' stamps and with them."""
    count = len(world.window)
    found: list[tuple[str, str]] = []
    for kind, least in (("presence", count), ("rate", count * SECOND / (END - START))):
        wanted = {"topic": "/p", "min": least}
        before, after = (
            judged(kind, wanted, world.evidence(lacks, known=known)).outcome
            for known in (False, True)
        )
        found.append((before, after))
    return found


# Promise: lead-in-not-judged
def test_who_lacks_answers_passes_by_none_of_the_lead_in_and_no_honest_pass_is_lost() -> None:
    """Of eighty worlds, by presence and by rate."""
    honest, bad = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    for seed in range(80):
        world = World.of(seed)
        honest.update(outcomes(world))
        bad.update(outcomes(world, lacked(world, seed)))
    assert honest == {("passed", "passed"): 156, ("failed", "failed"): 4}
    # Without the inputs' stamps 62 of the 160 pass.
    assert bad == {("failed", "failed"): 98, ("passed", "invalid"): 62}


LATE = 300_000_000
TENTH = SECOND // 10
# Recorded 0.3 s late in a window from 10 to 20 s: three are stamped before it.
CAMERA = [(time, time - LATE) for time in range(BEGIN, END, TENTH)]
# Who dies 0.3 s before the last input has as many answers as that.
DIES = [(time, time) for time in range(BEGIN, END, TENTH)]
# Inputs that no answer has the stamp of.
NOBODYS = [(time, stamp + 2) for time, stamp in DIES]
EXACT = {"topic": "/p", "min": 100}


def given(
    answered: list[tuple[int, int]], inputs: Inputs, takes: int = LATE, **more: Any
) -> Evidence:
    """Of a stack that answers these inputs."""
    recorded = [
        ("/p", (time + takes) / SECOND, stamped(stamp / SECOND, 0.0, 0.0))
        for time, stamp in answered
        if time + takes >= START
    ]
    times = sorted(time for each in inputs.values() for time, _ in each)
    made = evidence(recorded, lead_in_start=BEGIN, inputs=lambda: times, **more)
    return replace(made, input_stamps=answering(inputs))


def test_the_message_names_the_topic_how_many_answer_and_what_to_do() -> None:
    found = judged("presence", EXACT, given(DIES[:-3], {"/camera": DIES}))
    assert (found.outcome, found.figure) == ("invalid", 100.0)
    assert found.message == (
        "by the stamps of the inputs on /camera no more than 97 of 100 messages answer the window,"
        " and the others inputs from before it: look for the answers that lack, or demand no more"
        " than these 97; 100 messages on /p"
    )
    less = judged("presence", EXACT | {"min": 97}, given(DIES[:-3], {"/camera": DIES}))
    assert less.outcome == "passed"
    rate = {"topic": "/p", "min": 10.0}
    assert judged("rate", rate, given(DIES[:-3], {"/camera": DIES})).outcome == "invalid"
    assert (
        judged("rate", {"topic": "/p", "min": 9.7}, given(DIES[:-3], {"/camera": DIES})).outcome
        == "passed"
    )
    # A known fault is not shown by it, and neither is it gone.
    known = judged("presence", EXACT, given(DIES[:-3], {"/camera": DIES}), expectFailure=True)
    assert known.outcome == "invalid"


def test_the_same_answers_of_a_sensor_that_is_recorded_late_pass() -> None:
    found = judged("presence", EXACT, given(CAMERA, {"/camera": CAMERA}, takes=TENTH // 2))
    assert found.outcome == "passed"


@pytest.mark.parametrize("paced", [True, False])
def test_in_every_mode(paced: bool) -> None:
    found = judged("presence", EXACT, given(DIES[:-3], {"/camera": DIES}, paced=paced))
    assert found.outcome == "invalid"


def asked(times: list[tuple[int, int]], given: Evidence) -> Evidence:
    """The same, of which it is noted what it is asked."""

    def noted(begin: int, end: int) -> Inputs:
        times.append((begin, end))
        return dict(answering({"/camera": DIES})(begin, end))

    return replace(given, input_stamps=noted)


def test_only_a_pass_that_depends_on_it_asks_and_for_the_second_around_the_start() -> None:
    times: list[tuple[int, int]] = []
    bad = asked(times, given(DIES[:-3], {"/camera": DIES}))
    assert judged("presence", EXACT | {"min": 97}, bad).outcome == "passed"
    assert judged("presence", EXACT | {"min": 101}, bad).outcome != "passed"
    assert judged("rate", {"topic": "/p", "max": 11.0}, bad).outcome == "passed"
    assert judged("rate", {"topic": "/p", "min": 2.0, "over": "worst"}, bad).outcome == "passed"
    without = replace(bad, lead_in_start=START)
    assert judged("presence", EXACT, without).outcome == "passed"
    assert (
        judged(
            "presence", {"topic": "/p", "min": 97}, asked(times, given(DIES, {"/camera": DIES}))
        ).outcome
        == "passed"
    )
    assert times == []
    assert judged("presence", EXACT, bad).outcome == "invalid"
    # So is another that is less far behind: what was read for one is had for both.
    one_less = asked(times, given(DIES[:-1], {"/camera": DIES}, takes=TENTH))
    assert judged("presence", EXACT, one_less).outcome == "invalid"
    assert times == [(START - SECOND, START + SECOND)] * 2


def test_where_several_topics_have_the_stamps_it_lacks_by_all_of_them() -> None:
    def outcome(**inputs: list[tuple[int, int]]) -> str:
        both = {"/camera": DIES} | {f"/{name}": each for name, each in inputs.items()}
        return judged("presence", EXACT, given(DIES[:-3], both)).outcome

    # What was made of the pictures was recorded later, and a stack may have answered that.
    assert outcome(detections=[(time + LATE, stamp) for time, stamp in DIES]) == "passed"
    assert outcome(right=DIES) == "invalid"
    # A topic with other stamps is nothing to it, nor is one that has a few of them.
    others = [(time + LATE, stamp + 1) for time, stamp in DIES]
    assert outcome(imu=others) == "invalid"
    some = [(time + LATE, stamp + (stamp // TENTH % 10 > 6)) for time, stamp in DIES]
    assert outcome(imu=some) == "invalid"


def test_where_no_input_has_the_stamps_the_guess_stands() -> None:
    others = [(time, stamp + 1) for time, stamp in DIES]
    known: list[Inputs] = [{}, {"/camera": []}, {"/camera": others}]
    for inputs in known:
        assert judged("presence", EXACT, given(DIES[:-3], inputs)).outcome == "passed"
    unknown = replace(given(DIES[:-3], {"/camera": DIES}), input_stamps=None)
    assert judged("presence", EXACT, unknown).outcome == "passed"


@pytest.mark.parametrize(("share", "outcome"), [(3, "invalid"), (4, "passed")])
def test_three_quarters_of_the_answers_have_to_have_them(share: int, outcome: str) -> None:
    """Of the stamps that are compared, of which the window's are changed one by one."""
    answered = [
        (time, stamp + (START <= stamp < START + share * TENTH)) for time, stamp in DIES[:-3]
    ]
    # Thirteen are compared, from the first that is let in on.
    assert judged("presence", EXACT, given(answered, {"/camera": DIES})).outcome == outcome


@pytest.mark.parametrize("ahead", [SECOND, 20 * SECOND])
def test_one_input_that_is_stamped_in_the_future_hides_none_that_lacks(ahead: int) -> None:
    glitch = START + 5 * TENTH
    inputs = [(at, stamp + ahead * (at == glitch)) for at, stamp in DIES]
    answered = [each for each in DIES[:-3] if each[0] != glitch]
    found = judged("presence", EXACT | {"min": 99}, given(answered, {"/camera": inputs}))
    assert (found.outcome, found.figure) == ("invalid", 99.0)


def test_who_answers_two_cameras_in_turn_lacks_by_both_together() -> None:
    def right(left: list[tuple[int, int]]) -> list[tuple[int, int]]:
        return [(at + TENTH // 2, stamp + TENTH // 2) for at, stamp in left]

    inputs = {"/left": DIES, "/right": right(DIES)}
    wanted = EXACT | {"min": 200}
    found = judged("presence", wanted, given(sorted(DIES[:-3] + right(DIES[:-3])), inputs))
    assert (found.outcome, found.figure) == ("invalid", 200.0)
    assert "the inputs on /left and /right no more than 194 of 200 messages" in found.message
    # Those that are recorded late have as many that are stamped before the window.
    late = {"/left": CAMERA, "/right": right(CAMERA)}
    honest = given(sorted(CAMERA + right(CAMERA)), late, takes=TENTH // 4)
    assert judged("presence", wanted, honest).outcome == "passed"
    # With a third of answers to nothing that is known, it is not known what they follow.
    third = [(at + TENTH // 4, stamp + TENTH // 4) for at, stamp in DIES[:-3]]
    mixed = given(sorted(DIES[:-3] + right(DIES[:-3]) + third), inputs)
    assert judged("presence", EXACT | {"min": 300}, mixed).outcome == "passed"
    # Nor with others from then on where one of the cameras stops.
    stops = START + 4 * TENTH
    fewer = inputs | {"/left": [each for each in DIES if each[0] <= stops]}
    both = sorted(DIES[:-3] + right(DIES[:-3]))
    others = [(at, stamp + (stamp > stops + TENTH)) for at, stamp in both]
    assert judged("presence", wanted, given(others, fewer)).outcome == "passed"
    assert judged("presence", wanted, given(both, fewer)).outcome == "invalid"


def test_just_three_quarters_are_enough() -> None:
    """Nine of the twelve up to the last input that is looked at, which is the ninth."""
    imu = sorted([*NOBODYS, (START + 3 * TENTH, START + 3 * TENTH)])
    inputs = {"/camera": [each for each in DIES if each[0] < START + 9 * TENTH], "/imu": imu}
    answered = [(time, stamp + (START <= stamp < START + 3 * TENTH)) for time, stamp in DIES[:-3]]
    found = judged("presence", EXACT, given(answered, inputs))
    assert found.message.startswith("by the stamps of the inputs on /camera no more than 97 of 100")


def test_just_three_quarters_together_are_enough() -> None:
    """Eighteen of twenty-four."""
    right = [(at + TENTH // 2, stamp + TENTH // 2) for at, stamp in DIES]
    until = START + 9 * TENTH
    looked_at = {"/left": DIES, "/right": right}
    inputs = {
        topic: [each for each in every if each[0] < until] for topic, every in looked_at.items()
    }
    for changed, outcome in ((6, "invalid"), (7, "passed")):
        answered = [
            (at, stamp + (START <= stamp < START + changed * TENTH // 2))
            for at, stamp in sorted(DIES[:-3] + right[:-3])
        ]
        given_these = given(answered, inputs | {"/imu": NOBODYS, "/gps": [(END - 1, 1)]})
        assert judged("presence", EXACT | {"min": 200}, given_these).outcome == outcome


def test_one_answer_is_enough_to_know_what_it_follows() -> None:
    last = START - 3 * TENTH
    inputs = {"/camera": [(at, at) for at in range(BEGIN, last + 1, TENTH)], "/imu": NOBODYS}
    found = judged("presence", EXACT, given(DIES[:-3], inputs))
    assert found.message.startswith("by the stamps of the inputs on /camera no more than 99 of 100")


def test_a_topic_of_whose_time_no_answer_is_was_not_followed() -> None:
    """Its last input is stamped before any that may be the window's."""
    old = START - 8 * TENTH
    inputs = {"/camera": DIES, "/map": [(old, old)]}
    found = judged("presence", EXACT, given(DIES[:-3], inputs, takes=9 * TENTH))
    assert found.message.startswith("by the stamps of the inputs on /camera no more than")


def test_a_stamp_that_both_sides_have_may_be_the_windows() -> None:
    """The driver stamps two pictures alike, one of them in the lead-in."""
    again = [(START + TENTH // 3 * n, START - n * TENTH) for n in (1, 2, 3)]
    both = sorted(DIES + again)
    assert judged("presence", EXACT, given(DIES[:-3], {"/camera": both})).outcome == "passed"


def test_what_is_stamped_long_before_it_is_recorded_leaves_it_open() -> None:
    late = [*DIES, (START + TENTH // 2, START - SECOND + TENTH // 2)]
    assert judged("presence", EXACT, given(DIES[:-3], {"/camera": late})).outcome == "invalid"
    later = [*DIES, (START + TENTH // 2, START - SECOND + TENTH // 2 - 1)]
    assert judged("presence", EXACT, given(DIES[:-3], {"/camera": later})).outcome == "passed"


def test_inputs_that_overtake_others_are_where_they_were_recorded() -> None:
    """One that is stamped sooner than any that is let in was recorded in the window."""
    sooner = START - LATE - TENTH
    swapped = [(START, sooner) if each == (sooner, sooner) else each for each in DIES]
    answered = sorted(swapped)[:-3]
    found = judged("presence", EXACT | {"min": 98}, given(answered, {"/camera": swapped}))
    assert found.outcome == "passed"


def test_what_repeats_an_answer_makes_up_for_none() -> None:
    again = sorted([*DIES[:-3], *DIES[50:60]])
    found = judged("presence", EXACT, given(again, {"/camera": DIES}))
    assert found.outcome == "invalid"
    assert "no more than 97 of 100 messages answer the window" in found.message


@pytest.mark.parametrize(
    ("shared", "outcome"),
    [
        # In the window, as of a stack that answers this sensor, too.
        ([(START + n, START - n * TENTH) for n in (1, 2, 3)], "passed"),
        ([(START + n, START - n * TENTH) for n in (1, 2)], "invalid"),
        # No sensor's message is stamped so long before it is recorded.
        ([(START + 7 * TENTH, START - 3 * TENTH)], "invalid"),
        ([(START + 7 * TENTH + 1, START - 3 * TENTH)], "passed"),
    ],
)
def test_a_topic_that_has_few_of_the_stamps_may_be_what_was_answered(
    shared: list[tuple[int, int]], outcome: str
) -> None:
    others = [(START + n * TENTH, START + n * TENTH + 1) for n in range(1, 10)]
    inputs = {"/camera": DIES, "/imu": shared + others}
    assert judged("presence", EXACT, given(DIES[:-3], inputs)).outcome == outcome


def test_the_stamps_of_inputs_that_are_not_looked_at_are_not_compared() -> None:
    """Of a slow stack more answers to the lead-in come in the window than can be the window's."""
    found = judged("presence", EXACT, given(DIES[:-3], {"/camera": DIES}, takes=8 * TENTH))
    assert found.outcome == "invalid"
    # Its first answers, five of eighteen, may have stamps of its own.
    own = [(at, stamp + (stamp < START - 3 * TENTH)) for at, stamp in DIES[:-3]]
    found = judged("presence", EXACT, given(own, {"/camera": DIES}, takes=8 * TENTH))
    assert found.outcome == "invalid"


@pytest.mark.parametrize("sooner", [350_000_000, 351_000_000])
def test_what_is_stamped_as_soon_as_any_answer_of_the_window_is_asked_for(sooner: int) -> None:
    """Half a step sooner than the last inputs that lack, or a rounding more."""
    shifted = [(at, START - sooner if at == START - 3 * TENTH else stamp) for at, stamp in DIES]
    found = judged("presence", EXACT, given(shifted[:-3], {"/camera": shifted}))
    assert "no more than 97 of 100 messages answer the window" in found.message


def test_a_topic_without_any_of_the_stamps_is_not_looked_at() -> None:
    """One that is recorded so late would leave it open."""
    inputs = {"/camera": DIES, "/gps": [(at, stamp - 5 * SECOND + 1) for at, stamp in DIES]}
    assert judged("presence", EXACT, given(DIES[:-3], inputs)).outcome == "invalid"


def test_the_lead_in_ends_with_the_nanosecond_before_the_window() -> None:
    for last, count in ((START - 1, 97), (START, 98)):
        inputs = [(last, stamp) if stamp == START - TENTH else (at, stamp) for at, stamp in DIES]
        found = judged("presence", EXACT, given(DIES[:-3], {"/camera": inputs}))
        assert f"no more than {count} of 100 messages" in found.message


def test_what_is_stamped_in_the_window_and_recorded_before_it_is_the_windows() -> None:
    """The sensor's clock runs ahead."""
    ahead = [(time, time + TENTH) for time in range(BEGIN, END, TENTH)]
    found = judged("presence", {"topic": "/p", "min": 98}, given(ahead[:-3], {"/camera": ahead}))
    assert found.outcome == "passed"


def test_an_answer_that_one_of_two_topics_lacks_is_left_open() -> None:
    """What was made of a picture is recorded so late that it is not looked at."""
    detections = [(time + LATE, time) for time in range(BEGIN, END - LATE, TENTH)]
    last = START - TENTH
    late = [(at + 2 * SECOND * (stamp == last), stamp) for at, stamp in detections]
    inputs = {"/camera": DIES, "/found": late}
    count = sum(START <= at < END for at, _ in late)
    wanted = EXACT | {"min": count}
    assert judged("presence", wanted, given(late, inputs, takes=TENTH // 5)).outcome == "passed"
