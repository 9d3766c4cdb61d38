"""Criteria over when messages came: presence, rate, latency."""

import itertools
import math
from collections.abc import Sequence

from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.finding import Finding, NoEvidenceError
from bagpipe.evaluate.limits import bounded, seconds
from bagpipe.evaluate.model import Latency, Presence, Rate


def presence(name: str, wanted: Presence, evidence: Evidence) -> Finding:
    """Counts messages; none is an answer here, and no lack of evidence."""
    count = len(evidence.recorded.times(wanted.topic))
    return bounded(
        Finding(name, "presence", "passed", float(count), "messages"),
        float(wanted.min),
        None if wanted.max is None else float(wanted.max),
        f"on {wanted.topic}",
    )


def rate(name: str, wanted: Rate, evidence: Evidence) -> Finding:
    """Messages per second. Raises NoEvidenceError for a window that is too short to tell."""
    times = evidence.recorded.times(wanted.topic)
    if evidence.seconds <= 0:
        raise NoEvidenceError("the case's window has no length")
    if wanted.over == "worst":
        edges = [evidence.start, *times, evidence.end]
        gap = max(after - before for before, after in itertools.pairwise(edges))
        figure = 1e9 / gap if gap > 0 else math.inf
    else:
        figure = len(times) / evidence.seconds
    return bounded(
        Finding(name, "rate", "passed", figure, "Hz", direction="higher"),
        wanted.min,
        wanted.max,
        f"on {wanted.topic}",
    )


def latency(name: str, wanted: Latency, evidence: Evidence) -> Finding:
    """Seconds from stamp to receipt. Raises NoEvidenceError where the type has no header."""
    samples = evidence.recorded.samples(wanted.topic)
    delays = [s.time - s.stamp for s in samples if s.stamp is not None]
    if not delays:
        raise NoEvidenceError(f"messages on {wanted.topic} have no header.stamp to measure from")
    unset = sum(1 for s in samples if s.stamp == 0)
    if unset:
        raise NoEvidenceError(f"{unset} messages on {wanted.topic} have an empty header.stamp")
    figure = percentile(delays, wanted.percentile) / 1e9
    return bounded(
        Finding(name, "latency", "passed", figure, "s", direction="lower"),
        None,
        seconds(wanted.max),
        f"at percentile {wanted.percentile:g} of {len(delays)} messages on {wanted.topic}",
    )


def percentile(values: Sequence[float], percent: float) -> float:
    """The nearest-rank percentile: a value that was measured, never one between two."""
    ordered = sorted(values)
    return ordered[max(0, math.ceil(percent / 100 * len(ordered)) - 1)]
