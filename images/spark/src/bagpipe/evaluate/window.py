"""Which messages belong to a case's window, by which clock, and how much of it they cover.

The recorder goes on after the window's end, until the stack has answered. What comes then belongs
to the input that it answers, which its stamp names, or to none.
"""

import itertools
import math
import statistics
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from bagpipe.evaluate.evidence import Evidence, Received, Sample, steps_of
from bagpipe.evaluate.finding import Clock, NoEvidenceError

_SECOND = 1_000_000_000
# Nodes that keep a time as a floating-point number of seconds or of milliseconds round it.
ROUNDING = 1_000_000
# An answer to a latched map, or to a sensor that was slow, may be stamped before the play began.
_LONGEST_BEFORE = 60 * _SECOND
# Between messages: of fewer steps none can be called usual.
_LEAST_STEPS = 3
# Of a sensor, or of what takes several of its messages together, from its stamp to its recording.
_MOST_BEHIND = _SECOND
# Of a stamp's time a timer with two ticks fills a half, and hardly less as it is not exact.
_LEAST_HELD = 0.45
_DAY = 86_400 * _SECOND


@dataclass(frozen=True)
class TopicMessages:
    """The messages of one topic. `fault` says what is wrong with their stamps.

    With the clock `header` all that were received in the window have stamps that can be true.
    """

    topic: str
    inside: list[Received]  # received in the window
    late: list[Received]  # received after its end, and stamped in it
    others: list[Received]  # received after its end, and nobody's
    clock: Clock
    fault: str
    # Received in the window, and stamped in the lead-in.
    early: list[Received] = field(default_factory=list)
    # How many ns the stamps are before the times at which the inputs were recorded.
    behind: int = 0
    # How many of the last of `early` may answer the window's first inputs.
    doubtful: int = 0

    @property
    def answers(self) -> list[Received]:
        """All that belong to the window, in the order of their receipt."""
        return self.inside + self.late

    @property
    def latching(self) -> bool:
        """Whether the last message holds until the next, however long that takes."""
        return bool(self.answers) and all(each.connection.latching for each in self.answers)


def messages_of(topic: str, evidence: Evidence, ahead: int = ROUNDING) -> TopicMessages:
    """The messages of a recorded topic; none is an empty answer.

    `ahead` is how many ns a stamp may be later than its message's receipt.
    """
    received = evidence.recorded.received(topic)
    came = [each for each in received if each.time < evidence.end]
    after = [each for each in received if each.time >= evidence.end]
    # A message from after the end, as of a node's shutdown, takes their clock from none before it.
    deciding = came or after
    none = unstamped(came + _stamped_before(evidence.end, after))
    fault = stamp_fault(topic, deciding, evidence, ahead, none=none)
    unknown = fault or not deciding or any(each.stamp is None for each in deciding)
    stamps = {id(each): stamp_of(each, evidence, ahead, none=none) for each in received}
    behind, perhaps = _behind(received, evidence)
    # Without a lead-in there is nothing else that an older stamp could belong to.
    before = behind + ROUNDING if evidence.led_in else _LONGEST_BEFORE
    begin = evidence.start - before
    inside: list[Received] = []
    early: list[Received] = []
    for each in came:
        stamp = stamps[id(each)]
        (inside if stamp is None or stamp >= begin else early).append(each)
    known = [each for each in inside if stamps[id(each)] is not None]
    late = [each for each in after if _within(stamps[id(each)], begin, evidence.end)]
    late = _late(known, late, evidence.paced)
    answering = {id(each) for each in late}
    others = [each for each in after if id(each) not in answering]
    clock: Clock = "receipt" if unknown else "header"
    doubtful = _doubtful(early, known + late, evidence.start, perhaps)
    return TopicMessages(topic, inside, late, others, clock, fault, early, behind, doubtful)


def _doubtful(early: list[Received], answers: list[Received], start: int, perhaps: int) -> int:
    """How many of the lead-in may answer the window's first inputs: what is stamped no more before
    the window than the stamps may be behind. Where nothing shows how late a sensor is recorded, the
    last one may: that sensor may have stamped its first input less than a step before the window.
    """
    if not early:
        return 0
    stamps = sorted({each.stamp or 0 for each in early + answers})
    steps = [after - before for before, after in itertools.pairwise(stamps)]
    if not steps:
        return 0
    last = max(early, key=lambda each: each.stamp or 0)
    step = min(statistics.median(steps), _MOST_BEHIND)
    near = [each for each in early if start - (each.stamp or 0) <= perhaps]
    if not near and start - (last.stamp or 0) < step:
        near = [last]
    # What came after an answer to a later input answers none of the first ones.
    first = min((each.time for each in answers), default=math.inf)
    return len({each.identity for each in near if each.time <= first})


def _stamped_before(end: int, after: list[Received]) -> list[Received]:
    """Of what came after the end, what may answer the window: it shows that 0 is a time of a topic
    of which only the first answers came before.
    """
    return [each for each in after if each.stamp is not None and each.stamp < end]


def _within(stamp: int | None, begin: int, end: int) -> bool:
    return stamp is not None and begin <= stamp < end


def _late(inside: list[Received], after: list[Received], paced: bool) -> list[Received]:
    """Of what came after the end with a stamp of the window, what answers it: as many different
    messages to a stamp as another stamp has. What is published on and on has one stamp.
    """
    if not after:
        return []
    together = Counter(each.stamp for each in inside + after)
    by_stamp: dict[int | None, dict[object, Received]] = defaultdict(dict)
    for each in inside + after:
        # Where one alone has its stamp, nobody needs to know what is in it.
        identity = each.identity if together[each.stamp] > 1 else each.stamp
        by_stamp[each.stamp].setdefault(identity, each)
    fewer, most = sorted([1, 1, *map(len, by_stamp.values())])[-2:]
    held = _held(by_stamp) if paced else None
    own: set[int] = set()
    for stamp, found in by_stamp.items():
        count = fewer if len(found) == most else most
        own.update(map(id, itertools.islice(found.values(), 1 if stamp == held else count)))
    return [each for each in after if id(each) in own]


def _held(by_stamp: dict[int | None, dict[object, Received]]) -> int | None:
    """The last stamp, where the messages with one stamp fill the time until the next one, and no
    more, as a timer's do: what comes on with it answers nothing. Several answers to one input come
    together, or beside those to others.
    """
    stamps = sorted(stamp for stamp in by_stamp if stamp is not None)
    whole = [[each.time for each in by_stamp[stamp].values()] for stamp in stamps[:-1]]
    filled = [max(times) - min(times) for times in whole if len(times) > 1]
    if not filled:
        return None
    step = statistics.median(after - before for before, after in itertools.pairwise(stamps))
    holds = _LEAST_HELD * step <= statistics.median_high(filled) <= step
    return stamps[-1] if holds else None


def _behind(received: list[Received], evidence: Evidence) -> tuple[int, int]:
    """A sensor's message may be stamped a while before it was recorded, and so its answer is. It is
    by how much the stamps end before the inputs do: as far as that is shown, and as it may be.
    """
    came = {each.stamp: each.time for each in received if each.stamp is not None}
    inside = sorted(each for each in came if evidence.start <= each < evidence.end)
    steps = sorted(after - before for before, after in itertools.pairwise(inside))
    if len(steps) < _LEAST_STEPS:
        return 0, 0
    # A step that is hardly ever longer: of messages in bursts the median is none between them.
    step = steps[len(steps) * 9 // 10]
    # Whose answers end sooner has lost some, or answers no more.
    most = most_behind(evidence)
    least = evidence.start - most - step - ROUNDING
    if not any(least <= each < evidence.start for each in came):
        return 0, 0  # which nothing that was recorded depends on
    short = evidence.inputs_until - inside[-1] - step
    if short <= 0:
        return 0, 0
    # Half a step, as steps are not all alike: the one before is a whole step away.
    behind = min(short, most) + step // 2
    last = max(came[each] for each in inside)
    # What died before the last input came shows nothing, unless its sensor may have stopped.
    if short <= most and last >= evidence.inputs_until - 2 * step:
        return behind, behind
    return 0, behind if evidence.inputs_thin_out(last) else 0


def most_behind(evidence: Evidence) -> int:
    """How long before it is recorded a message may be stamped, in ns."""
    return min(_MOST_BEHIND, (evidence.end - evidence.start) // 10)


def samples(found: TopicMessages, evidence: Evidence) -> list[Sample]:
    """The decoded messages that belong to the window, in the order of their receipt.

    Raises NoEvidenceError where there is none or one can't be decoded.
    """
    decoded = evidence.recorded.samples(found.topic)
    answers = {id(each) for each in found.answers}
    received = evidence.recorded.received(found.topic)
    chosen = [sample for sample, each in zip(decoded, received, strict=True) if id(each) in answers]
    if not chosen:
        raise NoEvidenceError(
            f"no message on {found.topic} belongs to the case's window: {_elsewhere(found)}"
        )
    return chosen


def _elsewhere(found: TopicMessages) -> str:
    """Why none of a topic's messages belongs to the window."""
    early, after = len(found.early), len(found.others)
    why = "with stamps outside of it"
    if found.clock == "receipt":
        why = "and no stamp shows what they answer"
    if not early:
        return f"all {after} came after its end, {why}"
    if not after:
        return f"all {early} are stamped in the lead-in"
    of = early + after
    return f"{early} of {of} are stamped in the lead-in, {after} came after its end, {why}"


def stamp_fault(
    topic: str,
    received: Sequence[Received],
    evidence: Evidence,
    ahead: int = ROUNDING,
    *,
    none: bool = False,
) -> str:
    """A sentence where stamps can't be times of this recording; else nothing. With `none` 0 is no
    time, whenever the recording begins.
    """
    begin = begin_of(evidence)
    stamped = [(each.time, each.stamp) for each in received if each.stamp is not None]
    empty = sum(1 for _, stamp in stamped if is_empty(stamp, begin) or (none and stamp == 0))
    if empty:
        return f"{empty} messages on {topic} have an empty header.stamp"
    odd = [each for each in stamped if not credible(*each, begin, ahead)]
    future = [(time, stamp) for time, stamp in odd if stamp > time]
    if future:
        time, stamp = future[0]
        return (
            f"{len(future)} of {len(stamped)} messages on {topic} are stamped later than they"
            f" came, the first at {_since(time, evidence)} by {_length(stamp - time)}: is"
            " /use_sim_time set for the node, and does it stamp with ROS time or its input's"
            " stamp? Else it stamps with this machine's clock"
        )
    if odd:
        time, stamp = odd[0]
        return (
            f"{len(odd)} of {len(stamped)} messages on {topic} have stamps from before the"
            f" recording, the first at {_since(time, evidence)} by {_length(begin - stamp)}: is"
            " /use_sim_time set for the node, and are the recording's own stamps of its time?"
        )
    return ""


def stamps_of(
    messages: Sequence[Received | Sample], evidence: Evidence, ahead: int = ROUNDING
) -> list[int | None]:
    """The stamps of a topic's messages where they can be true, else None."""
    none = unstamped(messages)
    return [stamp_of(each, evidence, ahead, none=none) for each in messages]


def stamp_of(
    each: Received | Sample, evidence: Evidence, ahead: int = ROUNDING, *, none: bool = False
) -> int | None:
    """A message's stamp where it can be true, else None; with `none` 0 is no time."""
    begin = begin_of(evidence)
    if each.stamp is None or is_empty(each.stamp, begin) or (none and each.stamp == 0):
        return None
    return each.stamp if credible(each.time, each.stamp, begin, ahead) else None


def is_empty(stamp: int, begin: int) -> bool:
    """Whether a stamp is none: a simulated drive may begin with second 0, which is a time there."""
    return stamp == 0 and begin >= _SECOND


def unstamped(messages: Sequence[Received | Sample]) -> bool:
    """Whether there are several, and all of them have an empty stamp: one may be of second 0."""
    return len(messages) > 1 and all(each.stamp == 0 for each in messages)


def begin_of(evidence: Evidence) -> int:
    """When the play began, in ns of bag time."""
    return evidence.start if evidence.lead_in_start is None else evidence.lead_in_start


def credible(time: int, stamp: int, begin: int, ahead: int) -> bool:
    """Whether a message that came at a time can have a stamp."""
    return begin - _LONGEST_BEFORE <= stamp <= time + ahead


def backward(received: Sequence[Received]) -> str:
    """A hint where stamps stand still or go back while messages come."""
    stamps = [each.stamp for each in received if each.stamp is not None]
    if len(stamps) < 3:
        return ""
    back = sum(1 for a, b in itertools.pairwise(stamps) if b < a)
    still = sum(1 for a, b in itertools.pairwise(stamps) if b == a)
    steps = len(stamps) - 1
    if still > steps / 2:
        return f"{still} of {steps} times its stamp stands still: does /clock reach the node?"
    if back > steps / 2:
        return (
            f"{back} of {steps} times its stamp goes back: does the node's clock run backward, or"
            " is /use_sim_time not set?"
        )
    return ""


def frames_differ(
    answers: Sequence[Sample], others: Sequence[Sample], topic: str, other: str
) -> str:
    """A sentence where messages are in several frames, or in another one than those that they
    are compared with; nothing where these have no header, or name none.
    """
    ours, theirs = _frames(answers), _frames(others)
    if not theirs - {""} or not ours or (ours == theirs and len(ours) == 1):
        return ""
    return (
        f"{topic} is in {_named(ours)} and {other} in {_named(theirs)}: figures of"
        " two frames can't be compared; transform one of them, or write anyFrame: true if they"
        " are the same"
    )


def _frames(messages: Sequence[Sample]) -> set[str]:
    # tf2 knows no leading slashes, tf writes them.
    return {name.lstrip("/") for each in messages for name in _frames_of(each.message)}


def _frames_of(message: Any) -> set[str]:
    """What the message and each of its poses name; no frame where none of them names one."""
    headers = [getattr(each, "header", None) for each in (message, *getattr(message, "poses", ()))]
    names = {str(header.frame_id) for header in headers if header is not None}
    return names - {""} or names


def _named(frames: set[str]) -> str:
    names = [name or "no frame" for name in sorted(frames)]
    shown = ", then ".join(names[:3])
    return f"the frame {shown}" if names != ["no frame"] else "no frame"


def times_of(found: TopicMessages) -> list[int]:
    """When the messages are, by the topic's clock."""
    if found.clock == "header":
        return [each.stamp or 0 for each in found.answers]
    return [each.time for each in found.answers]


def _own_times(found: TopicMessages, evidence: Evidence) -> list[int]:
    """By the stamp of each message, or by its receipt where that can't be true: beside one bad
    stamp the others still show what was answered.
    """
    stamps = stamps_of(found.answers, evidence)
    return [
        each.time if stamp is None else stamp
        for each, stamp in zip(found.answers, stamps, strict=True)
    ]


def spread(times: Iterable[int], evidence: Evidence, least: float, usual: float = 0.0) -> float:
    """The share of the window that messages speak for: all of it but the longest silence.

    A silence counts as far as it is longer than the usual time between two messages, if there are
    enough to have one, and than `usual` ns. Where that would be below `least`, only as far as
    inputs came meanwhile.
    """
    inside = sorted(time for time in times if evidence.start <= time < evidence.end)
    if not inside:
        return 0.0
    length = evidence.end - evidence.start
    between = list(itertools.pairwise(inside))
    if len(steps := steps_of(inside)) >= _LEAST_STEPS:
        usual = max(usual, statistics.median(steps))
    silences = [(evidence.start, inside[0]), *between, (inside[-1], evidence.end)]
    longest = max(after - before for before, after in silences)
    if 1.0 - (longest - usual) / length >= least:
        return 1.0 - max(0.0, longest - usual - ROUNDING) / length
    return 1.0 - _longest_of_inputs(silences, math.ceil(usual) + ROUNDING, evidence)


def _longest_of_inputs(
    silences: Iterable[tuple[int, int]], forgiven: int, evidence: Evidence
) -> float:
    """The longest silence as a share of the time in which inputs came, without what is forgiven: so
    long a time of the recording, gaps and all, or what inputs usually have of such a time.
    """
    # Of inputs of one moment there is no time in which others are awaited.
    whole = max(1, evidence.input_time_between(evidence.start, evidence.end))
    usual = forgiven * whole / (evidence.end - evidence.start)
    longest = max(
        min(
            evidence.input_time_between(before + forgiven, after),
            evidence.input_time_between(before, after) - usual,
        )
        for before, after in silences
    )
    return max(0.0, longest) / whole


def over_window(found: TopicMessages, evidence: Evidence, least: float) -> tuple[float | None, str]:
    """How much of the window a topic's messages speak for, as a share and in words; a latched one
    holds until the next.
    """
    times = times_of(found)
    # When a message came may not show what it covers: not of one that was in force at the start.
    known = not timeless(found, evidence) or min(times, default=0) <= evidence.start
    if found.latching and known:
        held = evidence.end - max(min(times), evidence.start)
        share = max(0.0, held / max(1, evidence.end - evidence.start))
        return share, f"{len(times)} latched messages, in force for {share:.0%} of the window"
    return coming_over(found, evidence, least)


def timeless(found: TopicMessages, evidence: Evidence) -> bool:
    """Whether receipts alone show when a topic's messages are, and in mode max these show nothing:
    bag time runs ahead of the stack there.
    """
    return found.clock == "receipt" and not evidence.paced and bool(found.inside or found.others)


def refuse_timeless(found: TopicMessages, evidence: Evidence, what: str) -> None:
    """Raises NoEvidenceError where what is measured needs the times of such messages."""
    if timeless(found, evidence):
        raise NoEvidenceError(
            found.fault
            or f"mode max leaves open when messages on {found.topic} were published, and so"
            f" {what}: let the stack stamp them, or play in another mode"
        )


def coming_over(
    found: TopicMessages, evidence: Evidence, least: float, usual: float = 0.0
) -> tuple[float | None, str]:
    """In how much of the window messages came, as a share and in words; latched ones are like
    others.
    """
    times = times_of(found)
    if timeless(found, evidence):
        stamps = stamps_of(found.answers, evidence)
        times = [stamp for stamp in stamps if stamp is not None]
        if not times:
            return None, f"{len(found.answers)} messages, whose times mode max leaves open"
    share = spread(times, evidence, least, usual)
    if found.clock == "receipt" and evidence.paced:
        share = min(share, spread(_own_times(found, evidence), evidence, least, usual))
    return share, f"{len(times)} messages without a longer silence in {share:.0%} of the window"


def _since(time: int, evidence: Evidence) -> str:
    return f"{(time - evidence.start) / 1e9:.3f} s"


def _length(span: int) -> str:
    if span >= 2 * _DAY:
        return f"{span / _DAY:,.0f} days"
    return f"{span / 1e9:.3f} s"
