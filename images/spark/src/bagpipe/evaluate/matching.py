"""Answers and the truth's samples, brought together by their times."""

import bisect
import math
from dataclasses import dataclass

from bagpipe.evaluate.evidence import Evidence, Sample
from bagpipe.evaluate.fields import no_number, number_at, turned
from bagpipe.evaluate.finding import Clock, Finding, NoEvidenceError
from bagpipe.evaluate.limits import seconds
from bagpipe.evaluate.model import Error
from bagpipe.evaluate.window import begin_of, credible, frames_differ, heard, samples


@dataclass(frozen=True)
class Pair:
    """An answer and the truth at the nearest time: `at` by the answer's clock, in ns."""

    received: int
    at: int
    truth: int
    distance: float


@dataclass(frozen=True)
class Matched:
    """All pairs in the order of receipt; `odd` is a failed finding where an answer is no number."""

    pairs: list[Pair]
    answers: int
    truth_times: list[int]
    answered: list[bool]  # which of the truth's samples have an answer that is near enough
    clock: Clock
    odd: Finding | None = None


def matched(name: str, wanted: Error, evidence: Evidence) -> Matched:
    """Raises NoEvidenceError for stamps that can't be true, and for a truth that is no number."""
    most = int(seconds(wanted.within) * 1e9)
    found = heard(wanted.topic, evidence, most)
    answers = samples(found, evidence)
    truth = _truth(wanted, evidence)
    apart = frames_differ(answers, truth, wanted.topic, wanted.truth or "the truth")
    if apart and not wanted.any_frame:
        raise NoEvidenceError(apart)
    stamped = bool(found.fault and wanted.recording) and _of_another_clock(truth, evidence, most)
    if found.fault and not stamped:
        raise NoEvidenceError(found.fault)
    numbers = [[(each.time, number_at(each.message, f)) for f in wanted.fields] for each in answers]
    odd = no_number(
        name, "error", f"{', '.join(wanted.fields)} of {wanted.topic}",
        (value for values in numbers for value in values), evidence.start,
    )  # fmt: skip
    times, order = [_when(each) for each in truth], [_when(each) for each in answers]
    fields = wanted.truth_fields or wanted.fields
    pairs = []
    for sample, at, values in zip(answers, order, numbers, strict=True):
        nearest = _nearest(times, at)
        if abs(times[nearest] - at) > most or odd:
            continue
        differences = [
            value - number_at(truth[nearest].message, theirs)
            for (_, value), theirs in zip(values, fields, strict=True)
        ]
        if wanted.angle:
            differences = [turned(difference) for difference in differences]
        pairs.append(Pair(sample.time, at, nearest, math.hypot(*differences)))
    ordered = sorted(order)
    near = [abs(ordered[_nearest(ordered, time)] - time) <= most for time in times]
    clock: Clock = "header" if stamped else found.clock
    return Matched(pairs, len(answers), times, near, clock, odd)


def _truth(wanted: Error, evidence: Evidence) -> list[Sample]:
    """The truth's samples of the window, by time."""
    topic = wanted.truth or wanted.topic
    if wanted.recording:
        found = evidence.source.samples(topic)
    else:
        found = samples(heard(topic, evidence), evidence)
    where = "the recording's" if wanted.recording else "the truth's"
    fields = wanted.truth_fields or wanted.fields
    odd = no_number(
        "", "error", f"{where} {', '.join(fields)} of {topic}",
        ((each.time, number_at(each.message, field)) for each in found for field in fields),
        evidence.start,
    )  # fmt: skip
    if odd is not None:
        raise NoEvidenceError(f"nothing can be compared: {odd.message}")
    return sorted(found, key=_when)


def _of_another_clock(truth: list[Sample], evidence: Evidence, ahead: int) -> bool:
    """Whether the recording's own stamps are no times of it, as those of a sensor that counts from
    its own start, or of one that was played before: answers that repeat such stamps are right.
    """
    begin = begin_of(evidence)
    return any(each.stamp and not credible(each.time, each.stamp, begin, ahead) for each in truth)


def _when(sample: Sample) -> int:
    return sample.stamp or sample.time


def _nearest(times: list[int], time: int) -> int:
    """The place of the nearest time; of two that are as near, the earlier."""
    after = bisect.bisect_left(times, time)
    if after == 0:
        return 0
    if after == len(times) or time - times[after - 1] <= times[after] - time:
        return after - 1
    return after
