"""Something else than was asked, or from another publisher; and hidden use of the machine."""

from tests.liars.jobs import APART, CHEAP, ERROR, ERROR_LIVE, LATENCY, OLD_ANSWERS, SOME_LIVE
from tests.liars.row import Row, launched, python

OF = "wrong type or frame"
OTHERS = "somebody else's answers"
USE = "hidden use"
WRONG = ("failed", "CriterionFailed")
UNSURE = ("invalid", "NotEnoughEvidence")


def _wrong(which: str) -> tuple[str, ...]:
    return python("wrong", which)


LIARS = [
    Row(
        "other-frames",
        OF,
        "says where it is on the map, and where others are seen from itself",
        APART,
        python("traffic", "other-frames"),
        "failed|invalid",
        "",
        ("base_link",),
    ),
    Row(
        "two-types",
        OF,
        "has a second node that says text on the same topic",
        ERROR_LIVE,
        launched(
            python("localiser", "localiser"),
            (*_wrong("text-in-place"), "__name:=second"),
            options="--together",
        ),
        "failed|invalid",
    ),
    Row(
        "other-frame",
        OF,
        "gives numbers of the map in the frame of the robot",
        ERROR,
        _wrong("of-the-robot"),
        "failed|invalid",
        "",
        ("base_link",),
    ),
    Row(
        "no-frame",
        OF,
        "leaves the frame empty",
        ERROR,
        _wrong("no-frame"),
        "failed|invalid",
        "",
        ("frame",),
    ),
    Row(
        "frame-changes",
        OF,
        "changes its frame midway, and not its numbers",
        ERROR,
        _wrong("frame-changes"),
        "failed|invalid",
        "",
        ("odom",),
    ),
    Row(
        "point",
        OF,
        "gives points where poses were promised",
        ERROR,
        _wrong("point-in-place"),
        *UNSURE,
    ),
    Row(
        "text", OF, "gives text where poses were promised", ERROR, _wrong("text-in-place"), *UNSURE
    ),
    Row(
        "no-header",
        OF,
        "gives a type without a stamp, where the latency is asked",
        LATENCY,
        _wrong("without-header"),
        *UNSURE,
    ),
    Row(
        "old-software",
        OTHERS,
        "says nothing, where the recording has the answers of the old software",
        OLD_ANSWERS,
        _wrong("says-nothing"),
        "failed|invalid",
    ),
    Row(
        "namesake",
        OTHERS,
        "has a second node take the first one's name, which ends the first",
        SOME_LIVE,
        _wrong("namesake-answers"),
        "failed",
        "",
        (),
        marks=("ran", "namesake"),
    ),
    Row(
        "hidden-memory",
        USE,
        "keeps 300 MiB in a process that has left its group and its parent",
        CHEAP,
        python("machine", "hides-memory"),
        *WRONG,
    ),
    Row("memory", USE, "keeps 300 MiB", CHEAP, python("machine", "takes-memory"), *WRONG),
    Row(
        "memory-for-a-moment",
        USE,
        "takes 300 MiB for a moment",
        CHEAP,
        python("machine", "takes-memory-shortly"),
        *WRONG,
    ),
]

HONEST = [
    Row("modest", USE, "takes what a node needs", CHEAP, python("machine", "modest"), "passed"),
]
