"""Stamps and clocks."""

from tests.liars.jobs import (
    BY_STAMPS,
    ERROR,
    ERROR_LATER,
    ERROR_LIVE,
    LATENCY,
    LATENCY_LOOSE,
    LATENCY_SIM,
    RATE_STEADY,
)
from tests.liars.row import Row, cpp, python

OF = "time"
CLOCK = ("use_sim_time",)


def _times(which: str) -> tuple[str, ...]:
    return python("times", which)


UNSURE = ("invalid", "NotEnoughEvidence")

LIARS = [
    Row(
        "wall-clock",
        OF,
        "stamps its answers with the time of day, over a drive of 2017",
        LATENCY,
        _times("wall-clock"),
        *UNSURE,
        CLOCK,
    ),
    Row(
        "wall-clock-cpp",
        OF,
        "the same, with roscpp",
        LATENCY,
        cpp("wall-clock"),
        *UNSURE,
        CLOCK,
    ),
    Row(
        "hour-ahead",
        OF,
        "stamps an hour ahead, so that no answer is late",
        LATENCY,
        _times("hour-ahead"),
        *UNSURE,
    ),
    Row(
        "slow-and-ahead",
        OF,
        "is 300 ms late, and stamps 600 ms ahead",
        LATENCY,
        _times("slow-and-ahead"),
        *UNSURE,
    ),
    Row(
        "zero-stamps",
        OF,
        "leaves all its stamps empty",
        LATENCY,
        _times("zero-stamps"),
        *UNSURE,
    ),
    Row(
        "mostly-zero",
        OF,
        "stamps its first two answers, and leaves 48 stamps empty",
        LATENCY,
        _times("mostly-zero"),
        *UNSURE,
    ),
    Row(
        "backward-clock",
        OF,
        "has a clock that runs backward",
        LATENCY,
        _times("backward"),
        *UNSURE,
    ),
    Row(
        "last-second",
        OF,
        "stamps with the last second that a stamp can hold, in 2106",
        LATENCY,
        _times("after2106"),
        *UNSURE,
    ),
    Row(
        "after-2038",
        OF,
        "stamps with a second that is negative if it is read as signed",
        LATENCY,
        _times("after2038"),
        *UNSURE,
    ),
    Row(
        "zero-stamps-error",
        OF,
        "leaves its stamps empty where they say what an answer belongs to",
        ERROR_LIVE,
        _times("zero-stamps"),
        *UNSURE,
    ),
    Row(
        "day-behind",
        OF,
        "stamps a day before the drive",
        ERROR,
        _times("day-behind"),
        *UNSURE,
    ),
    Row(
        "one-stamp",
        OF,
        "gives all its answers the stamp of the first pose",
        ERROR_LIVE,
        _times("one-stamp"),
        "failed",
        "CriterionFailed",
    ),
    Row(
        "far-future-then-silent",
        OF,
        "gives one answer of the far future, which would end each later wait by stamp",
        BY_STAMPS,
        _times("far-future-then-silent"),
        *UNSURE,
    ),
    Row(
        "far-future-beside",
        OF,
        "ends each wait by stamp with an answer of the far future, beside the right one",
        BY_STAMPS,
        _times("far-future-now"),
        *UNSURE,
    ),
    Row(
        "old-stamps",
        OF,
        "stamps each answer as that of the pose before it",
        BY_STAMPS,
        _times("old-stamps"),
        "failed",
        "CriterionFailed",
    ),
]

HONEST = [
    Row(
        "wall-clock-rate",
        OF,
        "stamps with the time of day, where nothing but messages per second is asked",
        RATE_STEADY,
        _times("wall-clock"),
        "passed",
    ),
    Row(
        "late-but-right",
        OF,
        "answers half a second late",
        ERROR_LIVE,
        _times("late-but-right"),
        "passed",
    ),
    Row(
        "slow-but-right",
        OF,
        "takes 10 ms for each pose",
        LATENCY_LOOSE,
        _times("slow-but-right"),
        "passed",
    ),
    Row(
        "slow-but-right-cpp",
        OF,
        "the same, with roscpp",
        LATENCY_LOOSE,
        cpp("slow-but-right"),
        "passed",
    ),
    Row(
        "second-zero",
        OF,
        "stamps at second 0, under simulated time",
        LATENCY_SIM,
        _times("simulated-time"),
        "passed",
    ),
    Row(
        "drive-of-2040",
        OF,
        "answers a drive of after 2038",
        ERROR_LATER,
        python("localiser", "localiser"),
        "passed",
    ),
]
