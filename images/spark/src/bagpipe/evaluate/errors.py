"""Criteria against a truth: distance of fields over time, and the pose at the end."""

import math
from collections import defaultdict
from dataclasses import replace
from typing import Any, NamedTuple

from bagpipe.evaluate.evidence import Evidence, Sample
from bagpipe.evaluate.fields import no_number, turned, yaw_of
from bagpipe.evaluate.finding import Finding, NoEvidenceError, covering
from bagpipe.evaluate.limits import bounded, of_all_bounds
from bagpipe.evaluate.matching import Matched, Pair, matched, several_frames, usual_step
from bagpipe.evaluate.model import Error, FinalPose
from bagpipe.evaluate.window import (
    TopicMessages,
    messages_of,
    refuse_timeless,
    samples,
    spread,
    stamps_of,
)
from bagpipe.texts import duration_nanoseconds

# Fewer pairs are no evidence of the errors over time; one pair is enough for the last error.
_LEAST_PAIRS = 2
# How far the length of a heading's quaternion may be from 1.
_QUATERNION = 0.1
# Of fewer steps between a truth's samples none is the usual one.
_LEAST_STEPS = 2
_OF_A_FAR_ANSWER = "raise `stampTolerance` if the stamps are further apart, or lower minCoverage"
_OF_A_SPARSE_TRUTH = (
    "the truth must be there throughout; of one that is sparse on purpose lower minCoverage"
)


class _Covered(NamedTuple):
    share: float
    words: str
    remedy: str = _OF_A_FAR_ANSWER


def error(name: str, wanted: Error, evidence: Evidence) -> Finding:
    """RMSE, greatest or last distance. Raises NoEvidenceError where too little can be compared."""
    found = matched(name, wanted, evidence)
    evidence.keep(wanted, found)
    covered = _coverage(wanted, found, evidence)
    if found.odd is not None:
        return covering(found.odd, covered.share, covered.words, found.clock, 0.0)
    _refuse_timeless(wanted, found, evidence)
    if len(found.pairs) < (1 if wanted.metric == "final" else _LEAST_PAIRS):
        raise NoEvidenceError(
            f"{len(found.pairs)} of {found.answers} messages on {wanted.topic} have a truth within"
            f" {wanted.stamp_tolerance}: raise `stampTolerance`, or look at the stamps"
        )
    finding = bounded(
        Finding(name, "error", "passed", _figure(wanted, found), direction="lower"),
        None,
        wanted.max,
        f"{wanted.metric} over {len(found.pairs)} pairs of {wanted.topic}{_astray(found)}",
    )
    finding = covering(
        finding,
        covered.share,
        covered.words,
        found.clock,
        wanted.min_coverage,
        lasting=wanted.metric == "max",
        remedy=covered.remedy,
    )
    times = {found.truth_times[pair.truth] for pair in found.pairs}
    if wanted.metric == "final" or len(times) >= _LEAST_PAIRS or finding.outcome != "passed":
        return finding
    message = (
        f"all {len(found.pairs)} pairs are with the truth at one time, and {wanted.metric} needs"
        f" two: of a truth that comes once write `metric: final`; {finding.message}"
    )
    return replace(finding, outcome="invalid", message=message)


def _refuse_timeless(wanted: Error, found: Matched, evidence: Evidence) -> None:
    """Raises NoEvidenceError where no time of answers, or of a truth that the stack says, is known:
    that of the recording has its own.
    """
    answers = [wanted.topic] if found.clock == "receipt" else []
    truth = [] if wanted.recording else [wanted.truth or wanted.topic]
    for topic in answers + truth:
        refuse_timeless(messages_of(topic, evidence), evidence, "to which sample one belongs")


def _figure(wanted: Error, found: Matched) -> float:
    if wanted.metric == "max":
        return max(pair.distance for pair in [*found.pairs, *found.strays])
    if wanted.metric == "final":
        last = _last_of(found.pairs)
        # What is known of one behind it is the least that it is off by, too.
        behind = [each for each in found.between if each.at > last.at]
        return max(last.distance, _last_of(behind).distance) if behind else last.distance
    # What is known of strays is the least that they may be wrong by: it makes no mean better.
    return max(_mean(found.pairs), _mean([*found.pairs, *found.strays]))


def _last_of(pairs: list[Pair]) -> Pair:
    """Of several with the last stamp the one that came last, as for finalPose."""
    return max(reversed(pairs), key=lambda pair: pair.at)


def _mean(pairs: list[Pair]) -> float:
    """The RMSE; each of the truth's samples counts once, however often it was answered."""
    distances: dict[int, list[float]] = defaultdict(list)
    for pair in pairs:
        distances[pair.truth].append(pair.distance)
    return _rms([_rms(each) for each in distances.values()])


def _astray(found: Matched) -> str:
    if not found.strays:
        return ""
    return f" and {len(found.strays)} answers that stray between the truth's samples"


def _rms(values: list[float]) -> float:
    # Not by squares, which overflow long before a distance does.
    return math.hypot(*values) / math.sqrt(len(values))


def _coverage(wanted: Error, found: Matched, evidence: Evidence) -> _Covered:
    """The truth's samples that are answered, or the window that has a truth: whichever is less."""
    of_truth = len(found.truth_times)
    if wanted.metric == "final":
        last = max((at + 1 for at, near in enumerate(found.answered) if near), default=0)
        words = f"the end: the last answer is at sample {last} of {of_truth}"
        answered = _Covered(last / of_truth, words)
    else:
        last, near = of_truth, sum(found.answered)
        words = f"{near} of {of_truth} samples of the truth, which have an answer within"
        answered = _Covered(near / of_truth, f"{words} {wanted.stamp_tolerance}")
    if found.there is None or last == 0:
        return answered
    share = _truth_over_window(wanted, found.truth_times[:last], found.there[:last], evidence)
    if share >= answered.share:
        return answered
    words = f"the window up to sample {last} of {of_truth} of the truth, the last that is answered"
    if wanted.metric != "final":
        of_times = len(set(found.truth_times))
        words = f"a truth at {of_times} times without a longer silence in {share:.0%} of the window"
    return _Covered(share, words, _OF_A_SPARSE_TRUTH)


def _truth_over_window(
    wanted: Error, times: list[int], there: list[int], evidence: Evidence
) -> float:
    """The share of the window that has a truth; with `final` how far into it the last one is."""
    # A truth whose stamps stand still is one sample, however often it comes.
    first = dict(reversed(list(zip(times, there, strict=True))))
    step = usual_step(times, duration_nanoseconds(wanted.stamp_tolerance))
    usual = step if len(first) > _LEAST_STEPS else 0
    if wanted.metric != "final":
        return spread(first.values(), evidence, wanted.min_coverage, usual)
    return _share_until(min(evidence.end, first[times[-1]] + usual), evidence, wanted.min_coverage)


def _share_until(at: int, evidence: Evidence, least: float) -> float:
    """How much of the window had passed; below `least`, of the time in which inputs came."""
    share = 1.0 - (evidence.end - at) / max(1, evidence.end - evidence.start)
    if share < least:
        silent = evidence.input_time_between(at, evidence.end)
        share = 1.0 - silent / max(1, evidence.input_time_between(evidence.start, evidence.end))
    return min(1.0, max(0.0, share))


def distances_of(wanted: Error, evidence: Evidence) -> list[tuple[int, float]]:
    """Receipt time in ns and distance from the truth, of every message that has one."""
    found: Matched = evidence.kept(wanted) or matched("", wanted, evidence)
    return [(pair.received, pair.distance) for pair in found.pairs]


def final_pose(name: str, wanted: FinalPose, evidence: Evidence) -> Finding:
    """Metres from where the last pose must be. Raises NoEvidenceError for a type without a pose."""
    found = messages_of(wanted.topic, evidence)
    poses = samples(found, evidence)
    apart = several_frames(poses, wanted.topic)
    if apart and not wanted.any_frame:
        raise NoEvidenceError(apart)
    last, at = _last(found, poses, evidence)
    pose = pose_of(last.message)
    if pose is None:
        raise NoEvidenceError(
            f"messages on {wanted.topic} have no pose: PoseStamped, PoseWithCovarianceStamped,"
            " Odometry and TransformStamped have one"
        )
    when = last.time if at is None else at
    finding = _pose_odd(name, wanted, pose, when, evidence) or _off(name, wanted, pose)
    # Latched or not: a goal that was published before the first input is no place that was reached.
    return covering(
        finding,
        None if at is None else _share_until(at, evidence, wanted.min_coverage),
        "the last pose, whose time mode max leaves open"
        if at is None
        else f"the pose at {(at - evidence.start) / 1e9:.3f} s of {evidence.seconds:.3f} s",
        found.clock,
        wanted.min_coverage,
        remedy="the last pose must be near the window's end, or lower minCoverage",
    )


def _last(
    found: TopicMessages, answers: list[Sample], evidence: Evidence
) -> tuple[Sample, int | None]:
    """The last pose and its time, by the topic's clock; None where mode max leaves that open."""
    if found.clock == "header":
        at, _, last = max((each.stamp or 0, number, each) for number, each in enumerate(answers))
        return last, at
    last, stamps = answers[-1], stamps_of(answers, evidence)
    if evidence.paced:
        # Its own stamp, if that can be true, is that of what it answers, whatever others' are.
        return last, last.time if stamps[-1] is None else stamps[-1]
    return last, max((stamp for stamp in stamps if stamp is not None), default=None)


def _pose_odd(
    name: str, wanted: FinalPose, pose: tuple[Any, Any], at: int, evidence: Evidence
) -> Finding | None:
    position, turn = pose
    numbers = [*(getattr(position, n) for n in "xyz"), *(getattr(turn, n) for n in "xyzw")]
    values = [(at, float(number)) for number in numbers]
    odd = no_number(name, "finalPose", f"the last pose of {wanted.topic}", values, evidence.start)
    if odd is None and wanted.yaw is not None:
        length = math.hypot(*(value for _, value in values[3:]))
        if abs(length - 1) > _QUATERNION:
            raise NoEvidenceError(
                f"the last pose of {wanted.topic} has no heading: its quaternion has the length"
                f" {length:.3g} and not 1"
            )
    return odd


def _off(name: str, wanted: FinalPose, pose: tuple[Any, Any]) -> Finding:
    position, orientation = pose
    reached = [float(number) for number in (position.x, position.y, position.z)]
    distance = math.dist(wanted.position, reached[: len(wanted.position)])
    found = bounded(
        Finding(name, "finalPose", "passed", distance, "m", direction="lower"),
        None,
        wanted.max_distance,
        f"from ({wanted.position[0]:g}, {wanted.position[1]:g}),"
        f" at ({position.x:.3f}, {position.y:.3f}) in the end",
    )
    if wanted.yaw is None or wanted.max_yaw_error is None:
        return found
    heading = bounded(
        Finding(
            name, "finalPose", "passed", abs(turned(yaw_of(orientation) - wanted.yaw)), "rad",
            direction="lower",
        ),
        None,
        wanted.max_yaw_error,
        f"from the heading {wanted.yaw:g} rad in the end",
    )  # fmt: skip
    return of_all_bounds([found, heading], found)


def pose_of(message: Any) -> tuple[Any, Any] | None:
    """Position and orientation of a message that has a pose or a transform."""
    transform = getattr(message, "transform", None)
    if transform is not None and hasattr(transform, "translation"):
        return transform.translation, transform.rotation
    pose = getattr(message, "pose", None)
    pose = getattr(pose, "pose", pose)  # PoseWithCovariance holds a Pose
    if pose is None or not hasattr(pose, "position"):
        return None
    return pose.position, pose.orientation
