"""Criteria over when messages came: presence, rate, latency."""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from operator import itemgetter

from bagpipe.evaluate.evidence import Evidence, Received
from bagpipe.evaluate.finding import Clock, Finding, NoEvidenceError, covering
from bagpipe.evaluate.lacking import lacking
from bagpipe.evaluate.limits import bounded
from bagpipe.evaluate.model import Latency, Presence, Rate
from bagpipe.evaluate.window import (
    ROUNDING,
    TopicMessages,
    backward,
    coming_over,
    messages_of,
    refuse_timeless,
)
from bagpipe.texts import duration_seconds

_REMEDY = "look at when they came, or lower minCoverage"


def presence(name: str, wanted: Presence, evidence: Evidence) -> Finding:
    """Counts messages; none is an answer here, and no lack of evidence.

    Where no stamp shows what a message after the window's end answers, it counts as one that is
    late, and the most must have come in the window.
    """
    found = messages_of(wanted.topic, evidence)
    least = _least(found)
    own = _own(least)
    count = len(own) if len(own) < wanted.min else len(least)
    finding = bounded(
        Finding(name, "presence", "passed", float(count), "messages"),
        float(wanted.min),
        None if wanted.max is None or len(found.answers) <= wanted.max else float(wanted.max),
        f"on {wanted.topic}{_repeated(least, own)}{_of_lead_in(found)}",
    )
    if len(own) < wanted.min <= len(own) + found.doubtful:
        finding = _in_doubt(finding, found)
    late = len(least) - len(found.answers)
    share = 1.0 if not least else len(found.answers) / len(least)
    covered = f"the whole window, and {late} of {len(least)} messages after its end"
    finding = covering(
        _with_limits(finding, wanted),
        share,
        covered if late else "the whole window",
        found.clock,
        wanted.min_coverage,
        lasting=True,
        remedy="play slower, let the stack stamp its answers, or lower minCoverage",
    )
    return _by_inputs(finding, found, least, lambda number: number >= wanted.min, evidence)


def counted_by_presence(wanted: Presence, evidence: Evidence) -> list[Received]:
    """The messages that count for its least number."""
    return _least(messages_of(wanted.topic, evidence))


def _least(found: TopicMessages) -> list[Received]:
    return found.answers + (found.others if found.clock == "receipt" else [])


def _with_limits(finding: Finding, wanted: Presence) -> Finding:
    most = "" if wanted.max is None else f"{wanted.min} to {wanted.max} messages"
    return replace(finding, limit=most or finding.limit)


def _own(messages: Sequence[Received]) -> set[object]:
    """What the messages are without those that repeat another one, to the byte."""
    return {each.identity for each in messages}


def _repeated(messages: Sequence[Received], own: set[object]) -> str:
    repeated = len(messages) - len(own)
    return f", {repeated} of {len(messages)} repeat another one" if repeated else ""


def rate(name: str, wanted: Rate, evidence: Evidence) -> Finding:
    """Messages per second. Raises NoEvidenceError for a window that is too short."""
    found = messages_of(wanted.topic, evidence)
    if evidence.seconds <= 0:
        raise NoEvidenceError("the case's window has no length")
    counted = found.answers
    own = _own(counted)
    if not counted and not (wanted.min or 0) > 0:
        besides = _of_lead_in(found)
        raise NoEvidenceError(
            f"no message on {wanted.topic}{besides}: a stack that is silent shows no rate"
        )
    moments = moments_of(found, evidence) if wanted.over == "worst" else None
    if moments is None:
        figure = _figure(wanted, _hertz(len(own), evidence), _hertz(len(counted), evidence))
    else:
        figure = _figure(wanted, *_of_longest_gaps(moments, evidence))
    finding = bounded(
        Finding(name, "rate", "passed", figure, "Hz", direction=_better_rate(wanted)),
        wanted.min,
        wanted.max,
        f"on {wanted.topic}{_repeated(counted, own)}{_besides(found)}",
    )
    if moments is not None:
        return _covering_gaps(finding, moments, found, evidence, wanted.min_coverage)
    if figure < (wanted.min or 0) <= _hertz(len(own) + found.doubtful, evidence):
        finding = _in_doubt(finding, found)
    usual = (evidence.end - evidence.start) / max(1, len(own))
    share, covered = coming_over(found, evidence, wanted.min_coverage, usual)
    finding = covering(
        finding, share, covered, found.clock, wanted.min_coverage, lasting=True, remedy=_REMEDY
    )
    least = wanted.min or 0
    return _by_inputs(
        finding, found, counted, lambda number: _hertz(number, evidence) >= least, evidence
    )


def _by_inputs(
    finding: Finding,
    found: TopicMessages,
    counted: Sequence[Received],
    enough: Callable[[int], bool],
    evidence: Evidence,
) -> Finding:
    """The finding; invalid where it passed by what answers the lead-in."""
    if finding.outcome != "passed" or not (lack := lacking(found, counted, enough, evidence)):
        return finding
    return replace(finding, outcome="invalid", message=f"{lack}; {finding.message}")


def _in_doubt(finding: Finding, found: TopicMessages) -> Finding:
    """That of a topic which lacks no more messages than may be of the lead-in or not."""
    if finding.outcome != "failed":
        return finding
    doubt = (
        "one more is stamped less than a step before the window, and may answer its first input:"
        " demand one less"
    )
    if found.doubtful > 1:
        doubt = (
            f"{found.doubtful} more are stamped shortly before the window, and may answer its first"
            f" inputs: demand {found.doubtful} less"
        )
    return replace(finding, outcome="invalid", message=f"{doubt}; {finding.message}")


def _hertz(count: int, evidence: Evidence) -> float:
    # Of whole numbers, so that it is rounded once: 7 / 0.28 is below 25 in binary.
    return count * 1_000_000_000 / (evidence.end - evidence.start)


def _figure(wanted: Rate, own: float, counted: float) -> float:
    """Of the rates without and with messages that repeat another one: these count towards a
    greatest rate alone. Of two bounds the figure is that which misses one, and neither is better.
    """
    few = wanted.min is not None and own < wanted.min
    return own if few or wanted.max is None else counted


def _of_longest_gaps(
    moments: Sequence[tuple[int, Received]], evidence: Evidence
) -> tuple[float, float]:
    """Hertz where a message that repeats another one fills no gap, and where it does."""
    first = {each.identity: time for time, each in reversed(moments)}
    every = (time for time, _ in moments)
    return _of_longest_gap(first.values(), evidence), _of_longest_gap(every, evidence)


def moments_of(found: TopicMessages, evidence: Evidence) -> list[tuple[int, Received]]:
    """The messages between which gaps are looked for, in order, with their times in ns.

    Raises NoEvidenceError where nothing shows these.
    """
    if evidence.paced:
        # Until a slow stack answers the window, what it answers to the lead-in is no silence.
        first = found.inside[0].time if found.inside else evidence.start
        until = [each for each in found.early if each.time < first]
        return [(each.time, each) for each in until + found.inside]
    refuse_timeless(found, evidence, "how long its gaps are")
    # Bag time runs ahead of the stack there: a receipt is no time of what it answers.
    stamped = [(each.stamp or 0, each) for each in found.answers]
    # By no more than the first answer shows: where it is stamped in the window, its input is, too.
    oldest = evidence.start - found.behind
    first = min((at for at, _ in stamped if at >= oldest), default=evidence.start)
    later = min(found.behind, max(0, evidence.start - first))
    moments = [
        (at + later, each) for at, each in stamped if at + later >= evidence.start - ROUNDING
    ]
    return sorted(moments, key=itemgetter(0))


def _covering_gaps(
    finding: Finding,
    moments: Sequence[object],
    found: TopicMessages,
    evidence: Evidence,
    least: float,
) -> Finding:
    clock: Clock = "receipt" if evidence.paced else found.clock
    # Of a topic that is silent throughout no gap is seen that a known fault would make.
    if not moments:
        return covering(finding, 0.0, "no message", clock, least, lasting=True)
    if not found.early:
        return covering(finding, 1.0, "the whole window", clock, 0.0)
    usual = (evidence.end - evidence.start) / len(moments)
    share, covered = coming_over(found, evidence, least, usual)
    return covering(finding, share, covered, clock, least, lasting=True, remedy=_REMEDY)


def _better_rate(wanted: Rate) -> str:
    """The direction away from the one bound; of two, neither is better."""
    if wanted.min is None:
        return "lower"
    return "higher" if wanted.max is None else ""


def _of_longest_gap(times: Iterable[int], evidence: Evidence) -> float:
    """Hertz; the window's ends are among the times."""
    edges = [evidence.start, *sorted(times), evidence.end]
    return 1e9 / max(after - before for before, after in itertools.pairwise(edges))


def _besides(found: TopicMessages) -> str:
    """What came on the topic, and is none of the window's."""
    after = f", {len(found.others)} more after the window's end" if found.others else ""
    return _of_lead_in(found) + after


def _of_lead_in(found: TopicMessages) -> str:
    return f", beside {len(found.early)} of the lead-in" if found.early else ""


def latency(name: str, wanted: Latency, evidence: Evidence) -> Finding:
    """Seconds of real time from stamp to receipt, and never fewer than there were.

    Raises NoEvidenceError where no stamp can be believed.
    """
    evidence.recorded.samples(wanted.topic)  # what can't be decoded is no evidence
    found = messages_of(wanted.topic, evidence)
    if found.fault:
        raise NoEvidenceError(found.fault)
    if found.clock != "header":
        raise NoEvidenceError(f"messages on {wanted.topic} have no header.stamp to measure from")
    delays = [each.time - (each.stamp or 0) for each in found.answers]
    if not delays:
        raise NoEvidenceError(f"no message on {wanted.topic} belongs to the case's window")
    figure = evidence.real_seconds(percentile(delays, wanted.percentile))
    slowed = f", in real time at a rate of {evidence.rate:g}" if evidence.rate < 1 else ""
    finding = bounded(
        Finding(name, "latency", "passed", figure, "s", direction="lower"),
        None,
        duration_seconds(wanted.max),
        f"at percentile {wanted.percentile:g} of {len(delays)} messages on {wanted.topic}{slowed}",
    )
    share, covered = coming_over(found, evidence, wanted.min_coverage)
    return covering(
        finding,
        share,
        covered,
        "header",
        wanted.min_coverage,
        remedy=backward(found.answers) or _REMEDY,
    )


def percentile(values: Sequence[int], percent: float) -> int:
    """The nearest-rank percentile, above 0: a value that was measured, never one between two."""
    ordered = sorted(values)
    # As it is written: 99.9 / 100 * 1000 is above 999 in binary, and would be the next rank.
    rank = math.ceil(Fraction(repr(percent)) * len(ordered) / 100)
    return ordered[rank - 1]
