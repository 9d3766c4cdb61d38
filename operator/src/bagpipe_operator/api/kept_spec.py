"""How much of a spec the operator keeps between two visits: little, whatever its author wrote.

A tenant may have thousands of jobs of a megabyte that wait, and Python takes ten bytes for one of
JSON. What decides at each visit is kept as it is, the rest packed if it is small; a larger one is
asked for when a driver is made of it (issue 13).
"""

import json
from typing import Any

from bagpipe_operator.api import readings
from bagpipe_operator.receivers import MOST_NAMED

Json = dict[str, Any]

# 10,000 specs of this size are 80 MB. Jobs are mostly smaller; with a robot's description, 9 KB.
LARGEST_KEPT_BYTES = 8 << 10
# The longest text that a field can have by which the operator decides: a name or a duration.
_LONGEST_TEXT = 256
_LONGEST_NAME = 63  # of a receiver


def scalars(spec: Json, fields: frozenset[str] | None = None) -> Json:
    """Those fields (None: all) that are numbers, booleans or short texts."""
    return {
        key: value
        for key, value in spec.items()
        if (fields is None or key in fields) and _is_small(value)
    }


def what_decides(spec: Json, fields: frozenset[str] | None = None) -> Json:
    """Those scalars of a job's spec, how many executors it wants and of which pool, what its
    baseline follows, and who is to be notified."""
    spark = readings.mapping(spec.get("spark"))
    width = {
        "executors": _executors(spark.get("executors")),
        "slots": readings.whole(spark.get("slots")),
        "pool": scalars(spark, frozenset({"pool"})).get("pool"),
    }
    known = {key: value for key, value in width.items() if value is not None}
    wanted: Json = {"spark": known} if known else {}
    followed = scalars(readings.mapping(spec.get("baseline")), frozenset({"lastPassed"}))
    baseline: Json = {"baseline": followed} if followed else {}
    names = [name for name in readings.texts(spec.get("notify")) if len(name) <= _LONGEST_NAME]
    notify: Json = {"notify": names[:MOST_NAMED]} if names else {}
    return scalars(spec, fields) | wanted | baseline | notify


def _executors(value: object) -> int | Json | None:
    """A number, or the least and the most."""
    bounds = {key: readings.whole(readings.mapping(value).get(key)) for key in ("min", "max")}
    return readings.whole(value) if None in bounds.values() else bounds


def _is_small(value: object) -> bool:
    if isinstance(value, str):
        return len(value) <= _LONGEST_TEXT
    return isinstance(value, bool | int | float)


def packed(value: Json) -> bytes:
    """The value as JSON; nothing where that is larger than LARGEST_KEPT_BYTES."""
    text = json.dumps(value, separators=(",", ":")).encode()
    return text if len(text) <= LARGEST_KEPT_BYTES else b""


def unpacked(text: bytes) -> Json | None:
    """What was packed; None where it was too large."""
    value: Json | None = json.loads(text) if text else None
    return value
