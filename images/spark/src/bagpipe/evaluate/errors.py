"""Criteria against a truth: distance of fields over time, and the pose at the end."""

import bisect
import math
from typing import Any

from bagpipe.evaluate.evidence import Evidence, Sample
from bagpipe.evaluate.fields import number_at, turned, yaw_of
from bagpipe.evaluate.finding import Finding, NoEvidenceError
from bagpipe.evaluate.limits import bounded, seconds
from bagpipe.evaluate.model import Error, FinalPose

# Fewer pairs say nothing of a course; one pair is enough for its end.
_LEAST_PAIRS = 2


def error(name: str, wanted: Error, evidence: Evidence) -> Finding:
    """RMSE, greatest or last distance. Raises NoEvidenceError where too little can be compared."""
    distances = [distance for _, distance in distances_of(wanted, evidence)]
    if len(distances) < (1 if wanted.metric == "final" else _LEAST_PAIRS):
        all_messages = len(evidence.recorded.samples(wanted.topic))
        raise NoEvidenceError(
            f"{len(distances)} of {all_messages} messages on {wanted.topic} have a truth within"
            f" {wanted.within}: widen `within`, or look at the stamps"
        )
    figure = {
        "rmse": math.sqrt(sum(d * d for d in distances) / len(distances)),
        "max": max(distances),
        "final": distances[-1],
    }[wanted.metric]
    return bounded(
        Finding(name, "error", "passed", figure, direction="lower"),
        None,
        wanted.max,
        f"{wanted.metric} over {len(distances)} pairs of {wanted.topic}",
    )


def _when(sample: Sample) -> int:
    return sample.time if sample.stamp is None else sample.stamp


def distances_of(wanted: Error, evidence: Evidence) -> list[tuple[int, float]]:
    """Receipt time in ns and distance from the truth, of every message that has one."""
    truth_of = evidence.source if wanted.recording else evidence.recorded
    truth = sorted(truth_of.samples(wanted.truth or wanted.topic), key=_when)
    times = [_when(sample) for sample in truth]
    most = seconds(wanted.within) * 1e9
    fields = wanted.truth_fields or wanted.fields
    distances = []
    for sample in evidence.recorded.samples(wanted.topic):
        nearest = _nearest(times, _when(sample))
        if abs(times[nearest] - _when(sample)) > most:
            continue
        differences = [
            number_at(sample.message, mine) - number_at(truth[nearest].message, theirs)
            for mine, theirs in zip(wanted.fields, fields, strict=True)
        ]
        if wanted.angle:
            differences = [turned(difference) for difference in differences]
        distances.append((sample.time, math.hypot(*differences)))
    return distances


def _nearest(times: list[int], time: int) -> int:
    after = bisect.bisect_left(times, time)
    if after == 0:
        return 0
    if after == len(times) or time - times[after - 1] <= times[after] - time:
        return after - 1
    return after


def final_pose(name: str, wanted: FinalPose, evidence: Evidence) -> Finding:
    """Metres from where the last pose must be. Raises NoEvidenceError for a type without a pose."""
    last = evidence.recorded.samples(wanted.topic)[-1]
    pose = pose_of(last.message)
    if pose is None:
        raise NoEvidenceError(
            f"messages on {wanted.topic} have no pose: PoseStamped, PoseWithCovarianceStamped,"
            " Odometry and TransformStamped have one"
        )
    position, orientation = pose
    reached = [float(number) for number in (position.x, position.y, position.z)]
    distance = math.dist(wanted.position, reached[: len(wanted.position)])
    found = bounded(
        Finding(name, "finalPose", "passed", distance, "m", direction="lower"),
        None,
        wanted.within,
        f"from ({wanted.position[0]:g}, {wanted.position[1]:g}),"
        f" at ({position.x:.3f}, {position.y:.3f}) in the end",
    )
    if wanted.yaw is None or found.outcome == "failed":
        return found
    off = abs(turned(yaw_of(orientation) - wanted.yaw))
    if off <= wanted.yaw_within:
        return found
    return bounded(
        Finding(name, "finalPose", "passed", off, "rad", direction="lower"),
        None,
        wanted.yaw_within,
        f"from the heading {wanted.yaw:g} rad in the end",
    )


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
