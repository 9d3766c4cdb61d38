"""Answers and the truth's samples, brought together by their times."""

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median_low

from bagpipe.evaluate.evidence import Evidence, Sample
from bagpipe.evaluate.fields import no_number, number_at, turned
from bagpipe.evaluate.finding import Clock, Finding, NoEvidenceError
from bagpipe.evaluate.model import Error
from bagpipe.evaluate.window import (
    begin_of,
    credible,
    frames_differ,
    is_empty,
    messages_of,
    most_behind,
    samples,
    unstamped,
)
from bagpipe.texts import duration_nanoseconds

# In a gap of the truth, of so many usual steps or more, it may have been anywhere.
_GAP = 3

# When it was received, its time by the answers' clock, and the numbers of its fields.
_Answer = tuple[int, int, list[float]]


@dataclass(frozen=True)
class Pair:
    """An answer and the truth at the nearest time: `at` by the answer's clock, in ns."""

    received: int
    at: int
    truth: int
    distance: float


@dataclass(frozen=True)
class Matched:
    """All pairs in the order of receipt; `odd` is a failed finding where an answer is no number.

    `between` are answers between two of the truth's samples, and near neither in time; their
    distance is what they are further from both than these are from each other, so it is never too
    great for a truth that goes from one sample to the next, and below zero for one on that way.
    """

    pairs: list[Pair]
    answers: int
    truth_times: list[int]
    answered: list[bool]  # which of the truth's samples have an answer that is near enough
    clock: Clock
    odd: Finding | None = None
    between: list[Pair] = field(default_factory=list)
    # When the truth was there, sample by sample, as the window counts; None where nothing says so.
    there: list[int] | None = None

    @property
    def strays(self) -> list[Pair]:
        """Those of them that are off in any case."""
        return [each for each in self.between if each.distance > 0]


def matched(name: str, wanted: Error, evidence: Evidence) -> Matched:
    """Raises NoEvidenceError for stamps that can't be true, and for a truth that is no number."""
    most = duration_nanoseconds(wanted.stamp_tolerance)
    found = messages_of(wanted.topic, evidence, most)
    answers = samples(found, evidence)
    truth = truth_of(wanted, evidence)
    apart = frames_differ(answers, truth, wanted.topic, wanted.truth or "the truth")
    apart = apart or several_frames(answers, wanted.topic)
    apart = apart or several_frames(truth, wanted.truth or "the truth")
    if apart and not wanted.any_frame:
        raise NoEvidenceError(apart)
    foreign = wanted.recording and _of_another_clock(truth, evidence, most)
    if found.fault and not foreign:
        raise NoEvidenceError(found.fault)
    if unstamped(answers):
        raise NoEvidenceError(f"{len(answers)} messages on {wanted.topic} have an empty stamp")
    numbers = [[(each.time, number_at(each.message, f)) for f in wanted.fields] for each in answers]
    odd = no_number(
        name, "error", f"{', '.join(wanted.fields)} of {wanted.topic}",
        (value for values in numbers for value in values), evidence.start,
    )  # fmt: skip
    times, order = _times(truth, evidence), _times(answers, evidence)
    given = [
        (sample.time, at, [value for _, value in values])
        for sample, at, values in zip(answers, order, numbers, strict=True)
    ]
    pairs, between = ([], []) if odd else _compared(wanted, truth, times, given)
    ordered = sorted(order)
    near = [abs(ordered[_nearest(ordered, time)] - time) <= most for time in times]
    clock: Clock = "header" if found.fault else found.clock
    there = _there(wanted, truth, times, max(order), evidence, foreign=foreign)
    return Matched(pairs, len(answers), times, near, clock, odd, between, there)


def several_frames(messages: Sequence[Sample], topic: str) -> str:
    """A sentence where messages of one topic name several frames; else nothing."""
    headers = [getattr(each.message, "header", None) for each in messages]
    # tf2 knows no leading slashes, tf writes them.
    names = {str(each.frame_id).lstrip("/") for each in headers if each is not None} - {""}
    if len(names) < 2:
        return ""
    return (
        f"{topic} is in the frames {', '.join(sorted(names)[:3])}: what they say of places is"
        " not of one frame; record one of them, or write anyFrame: true if they are the same"
    )


def _compared(
    wanted: Error, truth: list[Sample], times: list[int], given: list[_Answer]
) -> tuple[list[Pair], list[Pair]]:
    """The pairs, and what lies between the truth's samples."""
    most = duration_nanoseconds(wanted.stamp_tolerance)
    fields = wanted.truth_fields or wanted.fields
    true = [[number_at(each.message, path) for path in fields] for each in truth]
    widest = _GAP * usual_step(times, most)
    pairs, between = [], []
    for received, at, answer in given:
        nearest = _nearest(times, at)
        if abs(times[nearest] - at) <= most:
            distance = _distance(answer, true[nearest], angle=wanted.angle)
            pairs.append(Pair(received, at, nearest, distance))
        elif times[0] < at < times[-1]:
            after = bisect.bisect_left(times, at)
            if times[after] - times[after - 1] > widest:
                continue
            distance = _beyond(answer, true[after - 1], true[after], angle=wanted.angle)
            between.append(Pair(received, at, nearest, distance))
    return pairs, between


def _there(
    wanted: Error,
    truth: list[Sample],
    times: list[int],
    last: int,
    evidence: Evidence,
    *,
    foreign: bool,
) -> list[int] | None:
    if foreign:
        return [each.time for each in truth]
    # In mode max the receipt of what the stack publishes shows no time of the window.
    unknown = not evidence.paced and not wanted.recording
    if unknown:
        return None if any(each.stamp is None for each in truth) else times
    # What is always stamped a while before it comes, as a slow sensor's, ends before the window; so
    # do answers to it, while others go on without a truth.
    step = usual_step(times, duration_nanoseconds(wanted.stamp_tolerance))
    behind = min(each.time - at for each, at in zip(truth, times, strict=True))
    # One that is in the window from its first stamp on is stamped no while before.
    most = min(most_behind(evidence), evidence.start - times[0])
    shift = max(0, min(behind, most, evidence.end - max(last, times[-1]) - step))
    return [at + shift for at in times]


def usual_step(times: list[int], most: int) -> int:
    """The usual time between two of the truth's samples, in ns; 0 for fewer than two.

    A sample that is published again, or by a second source at about the same time (within `most`
    and half the mean step), is no step: else an answer between two others would lie in a gap.
    """
    apart = min(most, (times[-1] - times[0]) // max(1, 2 * (len(times) - 1)))
    steps, last = [], times[0]
    for time in times:
        if time - last > apart:
            steps.append(time - last)
            last = time
    return median_low(steps) if steps else 0


def _distance(one: Sequence[float], other: Sequence[float], *, angle: bool) -> float:
    differences = [mine - theirs for mine, theirs in zip(one, other, strict=True)]
    return math.hypot(*(turned(each) if angle else each for each in differences))


def _beyond(
    answer: Sequence[float], before: Sequence[float], after: Sequence[float], *, angle: bool
) -> float:
    """How much further an answer is from both of two truths than these are from each other: below
    zero for one that is nearer.
    """
    nearest = min(_distance(answer, truth, angle=angle) for truth in (before, after))
    return nearest - _distance(before, after, angle=angle)


def truth_of(wanted: Error, evidence: Evidence) -> list[Sample]:
    """The truth's samples of the window, by time. Raises NoEvidenceError."""
    topic = wanted.truth or wanted.topic
    if wanted.recording:
        found = evidence.source.samples(topic)
    else:
        found = samples(messages_of(topic, evidence), evidence)
    where = "the recording's" if wanted.recording else "the truth's"
    fields = wanted.truth_fields or wanted.fields
    odd = no_number(
        "", "error", f"{where} {', '.join(fields)} of {topic}",
        ((each.time, number_at(each.message, field)) for each in found for field in fields),
        evidence.start,
    )  # fmt: skip
    if odd is not None:
        raise NoEvidenceError(f"nothing can be compared: {odd.message}")
    times = _times(found, evidence)
    return [found[place] for place in sorted(range(len(found)), key=times.__getitem__)]


def _of_another_clock(truth: list[Sample], evidence: Evidence, ahead: int) -> bool:
    """Whether the recording's own stamps are no times of it, as those of a sensor that counts from
    its own start, or of one that was played before: answers that repeat such stamps are right.
    """
    begin = begin_of(evidence)
    return any(each.stamp and not credible(each.time, each.stamp, begin, ahead) for each in truth)


def _times(messages: Sequence[Sample], evidence: Evidence) -> list[int]:
    """The stamps, or the receipts of messages that have none."""
    none = (None, 0) if is_empty(0, begin_of(evidence)) or unstamped(messages) else (None,)
    return [each.time if each.stamp in none else each.stamp or 0 for each in messages]


def _nearest(times: list[int], time: int) -> int:
    """The place of the nearest time; of two that are as near, the earlier."""
    after = bisect.bisect_left(times, time)
    if after == 0:
        return 0
    if after == len(times) or time - times[after - 1] <= times[after] - time:
        return after - 1
    return after
