"""Answers that are repeated, kept, mixed up, or prepared."""

from tests.liars.jobs import (
    ARRIVED,
    ERROR,
    ERROR_LIVE,
    LATCHED_MAP,
    LATENCY,
    PRESENCE,
)
from tests.liars.row import Row, python

OF = "order, repetition and stale answers"
WRONG = ("failed", "CriterionFailed")
UNSURE = ("invalid", "NotEnoughEvidence")


def _order(which: str) -> tuple[str, ...]:
    return python("order", which)


LIARS = [
    Row(
        "each-five-times",
        OF,
        "gives ten answers five times each",
        ERROR_LIVE,
        _order("each-five-times"),
        *UNSURE,
        ("of 50",),
    ),
    Row(
        "first-again",
        OF,
        "gives the first answer to every pose",
        ERROR,
        _order("first-again-and-again"),
        *UNSURE,
    ),
    Row(
        "first-again-latency",
        OF,
        "gives the first answer to every pose, where the latency is asked",
        LATENCY,
        _order("first-again-and-again"),
        "failed|invalid",
    ),
    Row(
        "stale-content",
        OF,
        "says what it knew at the tenth pose, stamped as if it knew it now",
        ERROR,
        _order("stale-with-fresh-stamps"),
        *WRONG,
    ),
    Row(
        "one-behind",
        OF,
        "says what was true of the pose before, under the stamp of this one",
        ERROR,
        _order("one-behind"),
        *WRONG,
    ),
    Row(
        "wrong-then-right",
        OF,
        "gives each answer twice, a wrong one first",
        ERROR_LIVE,
        _order("twice"),
        *WRONG,
    ),
    Row(
        "latched-goal",
        OF,
        "has published before the first pose, latched, that it has arrived",
        ARRIVED,
        _order("latched-goal"),
        *UNSURE,
    ),
    Row(
        "latched-once",
        OF,
        "has given one answer before the first pose, and none since",
        ERROR_LIVE,
        _order("latched"),
        *UNSURE,
    ),
    Row(
        "latched-latency",
        OF,
        "the same, where the latency is asked",
        LATENCY,
        _order("latched"),
        *UNSURE,
    ),
]

HONEST = [
    Row(
        "pairs-swapped",
        OF,
        "answers out of order, with right stamps",
        ERROR_LIVE,
        _order("pairs-swapped"),
        "passed",
    ),
    Row(
        "latched-map",
        OF,
        "gives one latched message before the first pose, as a map server does",
        LATCHED_MAP,
        _order("latched-map"),
        "passed",
    ),
    Row(
        "ready-first",
        OF,
        "says that it is ready before the first pose",
        PRESENCE,
        _order("says-ready-first"),
        "passed",
    ),
    Row(
        "anonymous",
        OF,
        "has a name with a random number in it",
        PRESENCE,
        _order("anonymous"),
        "passed",
    ),
]
