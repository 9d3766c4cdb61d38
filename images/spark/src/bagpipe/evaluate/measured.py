"""What a criterion measures, as a mark: figures of one name are compared where it is equal."""

import hashlib
import json

from bagpipe.evaluate.model import Criterion
from bagpipe.texts import duration_seconds

# What is demanded of a figure, or of how much it is judged on, makes it no other figure.
_DEMANDED = frozenset({
    "min", "max", "min_coverage", "share", "max_distance", "max_yaw_error", "min_distance",
    "min_time_to_collision", "max_cpu", "max_memory",
})  # fmt: skip
_DURATIONS = frozenset({"stamp_tolerance", "max_age"})


def mark_of(criterion: Criterion, rate: float) -> str:
    """Equal for criteria that measure the same in plays of that rate, whatever they demand.

    Empty for a user's own evaluator: what it measures is not known, and its ConfigMap may have
    another name in each version.
    """
    if criterion.own is not None:
        return ""
    measurement = criterion.measurement
    # Without defaults, so that a field of a later release makes no figure another one.
    given = measurement.model_dump(exclude={*_DEMANDED, *_DURATIONS}, exclude_defaults=True)
    for name in _DURATIONS & type(measurement).model_fields.keys():
        seconds = duration_seconds(getattr(measurement, name))
        if seconds != duration_seconds(type(measurement).model_fields[name].default):
            given[name] = seconds
    if criterion.latency is not None and rate < 1:
        given["rate"] = rate
    text = json.dumps([criterion.kind, given], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]
