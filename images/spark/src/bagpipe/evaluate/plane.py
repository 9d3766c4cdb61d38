"""Where things were on the ground, for criteria over poses: drawn beside their courses."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bagpipe.evaluate.errors import pose_of
from bagpipe.evaluate.evidence import Evidence, Sample
from bagpipe.evaluate.fields import number_at
from bagpipe.evaluate.matching import truth_of
from bagpipe.evaluate.model import Error, FinalPose, Separation
from bagpipe.evaluate.motion import nearest
from bagpipe.evaluate.rounding import digits_for, rounded
from bagpipe.evaluate.window import messages_of, samples

_DIGITS = 6

# Time of receipt in ns, x and y.
Path = list[tuple[int, float, float]]


@dataclass(frozen=True)
class Plane:
    """Paths by name, the one that was judged first, in the messages' own frame and unit; and where
    it had to end: x, y and a radius.
    """

    paths: list[tuple[str, Path]]
    goal: tuple[float, float, float] | None = None

    def as_json(self, start: int, most: int) -> dict[str, Any]:
        """`paths`, each `name` and at most `most` `points` of [seconds, x, y], and `goal`."""
        thin = [(name, thinned(path, most)) for name, path in self.paths]
        places = [place for _, path in thin for _, *place in path]
        # One range for both, as they are drawn.
        digits = max((digits_for(axis, _DIGITS) for axis in zip(*places, strict=True)), default=0)
        paths = [
            {"name": name, "points": [_point(each, start, digits) for each in path]}
            for name, path in thin
        ]
        return {"paths": paths, "goal": list(self.goal) if self.goal else None}


def thinned(path: Path, most: int) -> Path:
    """At most `most` points of those that are finite, evenly from the first to the last."""
    finite = [each for each in path if math.isfinite(each[1]) and math.isfinite(each[2])]
    if len(finite) <= most or most < 2:
        return finite[:most]
    last = len(finite) - 1
    return [finite[round(number * last / (most - 1))] for number in range(most)]


def _point(point: tuple[int, float, float], start: int, digits: int) -> list[float]:
    time, x, y = point
    return [round((time - start) / 1e9, 4), rounded(x, digits), rounded(y, digits)]


def plane_of_final_pose(wanted: FinalPose, evidence: Evidence) -> Plane:
    """The path of the poses, and the goal. Raises NoEvidenceError."""
    path = []
    for sample in samples(messages_of(wanted.topic, evidence), evidence):
        pose = pose_of(sample.message)
        if pose is not None:
            path.append((sample.time, float(pose[0].x), float(pose[0].y)))
    goal = (wanted.position[0], wanted.position[1], wanted.max_distance)
    return Plane([(wanted.topic, path)], goal)


def plane_of_separation(wanted: Separation, evidence: Evidence) -> Plane:
    """The ego's path, and that of whatever obstacle was nearest. Raises NoEvidenceError."""
    pairs = nearest(wanted, evidence)
    return Plane(
        [
            (wanted.ego, [(time, *ego) for time, ego, _ in pairs]),
            (f"nearest of {wanted.obstacles}", [(time, *other) for time, _, other in pairs]),
        ]
    )


def plane_of_error(wanted: Error, evidence: Evidence) -> Plane | None:
    """The answers' path and the truth's; None where x and y of one place are not compared.

    Raises NoEvidenceError.
    """
    places = _places(wanted.fields)
    if places is None:
        return None
    true = [(wanted.truth_fields or wanted.fields)[place] for place in places]
    answered = [wanted.fields[place] for place in places]
    answers = samples(messages_of(wanted.topic, evidence), evidence)
    return Plane(
        [
            (wanted.topic, _path(answers, answered)),
            ("the truth", _path(truth_of(wanted, evidence), true)),
        ]
    )


def _places(fields: Sequence[str]) -> tuple[int, int] | None:
    for place, field in enumerate(fields):
        other = f"{field[:-1]}y"
        if field.endswith(".x") and other in fields:
            return place, fields.index(other)
    return None


def _path(messages: Sequence[Sample], fields: Sequence[str]) -> Path:
    return [
        (each.time, number_at(each.message, fields[0]), number_at(each.message, fields[1]))
        for each in messages
    ]
