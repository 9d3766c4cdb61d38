"""Numbers that are none."""

from tests.liars.jobs import (
    APART,
    ARRIVED,
    BOUNDS,
    BOUNDS_ABOVE,
    ERROR,
    ERROR_FINAL,
    ERROR_LIVE,
    ERROR_RMSE,
    EXPECTED,
    HOLDS,
)
from tests.liars.row import Row, cpp, launched, python

OF = "arithmetic"
WRONG = ("failed", "CriterionFailed")


def _numbers(which: str) -> tuple[str, ...]:
    return python("figures", which)


LIARS = [
    Row(
        "nan-from-the-tenth",
        OF,
        "answers NaN from the tenth message on",
        ERROR,
        _numbers("nan-from-the-tenth"),
        *WRONG,
        ("no finite number",),
    ),
    Row("nan-cpp", OF, "the same, with roscpp", ERROR, cpp("nan"), *WRONG, ("no finite number",)),
    Row("nan-first", OF, "answers NaN once, at first", ERROR, _numbers("nan-first"), *WRONG),
    Row(
        "nan-in-y",
        OF,
        "answers NaN once, in the second of two fields",
        ERROR,
        _numbers("nan-in-the-second-field"),
        *WRONG,
    ),
    Row("infinity", OF, "answers infinity once", ERROR, _numbers("infinity-once"), *WRONG),
    Row(
        "nan-rmse",
        OF,
        "answers NaN once, where the root mean square is asked",
        ERROR_RMSE,
        _numbers("nan-once"),
        *WRONG,
    ),
    Row(
        "huge",
        OF,
        "answers a number whose square is infinite",
        ERROR_RMSE,
        _numbers("huge-once"),
        "failed|invalid",
    ),
    Row("all-nan", OF, "answers NaN alone", ERROR_RMSE, _numbers("nan-everywhere"), *WRONG),
    Row(
        "nan-last",
        OF,
        "answers NaN at last, where the last distance is asked",
        ERROR_FINAL,
        _numbers("nan-last"),
        *WRONG,
    ),
    Row(
        "nan-midway-final",
        OF,
        "answers NaN midway, where the last distance is asked",
        ERROR_FINAL,
        _numbers("nan-once"),
        *WRONG,
    ),
    Row(
        "nan-bounds",
        OF,
        "answers NaN once, where a least value is asked",
        BOUNDS,
        _numbers("nan-once"),
        *WRONG,
    ),
    Row(
        "nan-first-bounds",
        OF,
        "answers NaN at first, where a least value is asked",
        BOUNDS,
        _numbers("nan-first"),
        *WRONG,
    ),
    Row(
        "infinity-bounds",
        OF,
        "answers infinity, where only a least value is asked",
        BOUNDS,
        _numbers("infinity-once"),
        *WRONG,
    ),
    Row(
        "minus-infinity-bounds",
        OF,
        "answers minus infinity, where only a greatest value is asked",
        BOUNDS_ABOVE,
        _numbers("minus-infinity-once"),
        *WRONG,
    ),
    Row(
        "nan-expression",
        OF,
        "answers NaN, of which no comparison is true",
        HOLDS,
        _numbers("nan-once"),
        *WRONG,
    ),
    Row("nan-goal", OF, "is nowhere at the end: NaN", ARRIVED, _numbers("nan-last"), *WRONG),
    Row(
        "nan-heading",
        OF,
        "looks nowhere at the end: its rotation has a NaN",
        ARRIVED,
        _numbers("nan-heading"),
        *WRONG,
    ),
    Row(
        "turned-round",
        OF,
        "is where it should be at the end, and looks back",
        ARRIVED,
        _numbers("turned-round"),
        *WRONG,
    ),
    Row(
        "no-rotation",
        OF,
        "has a rotation of four zeros, which is none",
        ARRIVED,
        _numbers("no-heading"),
        "failed|invalid",
        "",
        ("quaternion",),
    ),
    Row(
        "nan-ego",
        OF,
        "is nowhere, from the tenth message on",
        APART,
        python("traffic", "nan-place"),
        *WRONG,
    ),
    Row(
        "nan-expected",
        OF,
        "answers NaN from the tenth message on, where another fault is expected",
        EXPECTED,
        _numbers("nan-from-the-tenth"),
        "failed|invalid",
    ),
    Row(
        "second-voice",
        OF,
        "has a second node that answers NaN on the same topic",
        ERROR_LIVE,
        launched(
            python("localiser", "localiser"),
            (*_numbers("nan-everywhere"), "__name:=second"),
            options="--together",
        ),
        *WRONG,
    ),
    Row(
        "plainly-wrong",
        OF,
        "answers the pose itself in place of where that is on the map",
        ERROR,
        _numbers("one-offset"),
        *WRONG,
    ),
]

HONEST = [
    Row(
        "keeps-away", OF, "keeps away from others", APART, python("traffic", "keeps-away"), "passed"
    ),
    Row(
        "nan-unjudged",
        OF,
        "says NaN in a field that nobody judges",
        ERROR,
        _numbers("nan-nobody-judges"),
        "passed",
    ),
    Row(
        "known-fault",
        OF,
        "has a fault that the job expects",
        EXPECTED,
        _numbers("one-offset"),
        "passed",
    ),
]
