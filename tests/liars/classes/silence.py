"""Too little said, or when nobody asks."""

from tests.liars.jobs import (
    APART,
    ARRIVED,
    BOUNDS,
    CHEAP,
    CHEAP_LIVE,
    ERROR,
    ERROR_FINAL,
    ERROR_LIVE,
    ERROR_RMSE,
    EXPECTED,
    HOLDS,
    LATENCY,
    LEAD_IN,
    LEAD_IN_LIVE,
    PRESENCE_LIVE,
    QUIET,
    RATE,
    SOME,
)
from tests.liars.row import Row, cpp, python

OF = "silence"
UNSURE = ("invalid", "NotEnoughEvidence")
EMPTY = ("invalid", "NothingRecorded")


def _silence(which: str) -> tuple[str, ...]:
    return python("silence", which)


LIARS = [
    Row(
        "nothing-expected",
        OF,
        "publishes nothing, where a fault is expected",
        EXPECTED,
        _silence("nothing"),
        *EMPTY,
    ),
    Row(
        "two-expected",
        OF,
        "answers two of 50 poses, where a fault is expected",
        EXPECTED,
        _silence("two-answers"),
        "failed|invalid",
    ),
    Row(
        "sees-once",
        OF,
        "sees the other car once, at first",
        APART,
        python("traffic", "sees-once"),
        *UNSURE,
    ),
    Row(
        "blind-at-the-end",
        OF,
        "looks for others in the first fifth of the drive alone",
        APART,
        python("traffic", "blind-at-the-end"),
        *UNSURE,
    ),
    Row(
        "stamps-ahead-in-the-lead-in",
        OF,
        "answers the lead-in with stamps of the window, and nothing of the window",
        LEAD_IN_LIVE,
        _silence("ahead-in-the-lead-in"),
        "failed|invalid",
    ),
    Row("nothing", OF, "publishes nothing", CHEAP, _silence("nothing"), *EMPTY),
    Row(
        "nothing-at-all",
        OF,
        "does not even say that it could publish",
        CHEAP_LIVE,
        _silence("nothing-at-all"),
        *EMPTY,
    ),
    Row(
        "no-alarm",
        OF,
        "publishes nothing, where an alarm must not come",
        QUIET,
        _silence("nothing"),
        *EMPTY,
    ),
    Row(
        "only-the-drain",
        OF,
        "is silent in the window, and gives 70 messages after its end",
        RATE,
        _silence("only-after-the-end"),
        "failed",
        "CriterionFailed",
    ),
    Row(
        "two-answers",
        OF,
        "answers two of 50 poses",
        ERROR,
        _silence("two-answers"),
        *UNSURE,
        ("of 50",),
    ),
    Row(
        "first-half",
        OF,
        "answers the first half",
        ERROR_RMSE,
        _silence("first-half"),
        *UNSURE,
        ("of 50",),
    ),
    Row(
        "every-tenth",
        OF,
        "answers every tenth pose",
        ERROR,
        _silence("every-tenth"),
        *UNSURE,
        ("of 50",),
    ),
    Row(
        "first-only-final",
        OF,
        "answers the first pose alone, where the last distance is asked",
        ERROR_FINAL,
        _silence("one-answer"),
        *UNSURE,
    ),
    Row(
        "goal-at-once",
        OF,
        "says at first that it has arrived, and no more",
        ARRIVED,
        _silence("goal-at-once"),
        *UNSURE,
    ),
    Row(
        "two-latencies", OF, "answers twice, and quickly", LATENCY, _silence("two-answers"), *UNSURE
    ),
    Row(
        "one-bound",
        OF,
        "gives one answer, and that within the bounds",
        BOUNDS,
        _silence("one-answer"),
        *UNSURE,
    ),
    Row(
        "one-expression",
        OF,
        "gives one answer, of which the expression is true",
        HOLDS,
        _silence("one-answer"),
        *UNSURE,
    ),
    Row(
        "lead-in-only",
        OF,
        "answers the lead-in, and nothing of the window",
        LEAD_IN,
        _silence("only-in-the-lead-in"),
        *EMPTY,
    ),
    Row(
        "other-name",
        OF,
        "answers on another topic, which is not recorded",
        SOME,
        _silence("wrong-topic"),
        *EMPTY,
    ),
    Row(
        "debug-topic",
        OF,
        "answers on a topic for debugging alone",
        CHEAP,
        _silence("elsewhere"),
        *EMPTY,
    ),
    Row(
        "hangs", OF, "has a deadlock from the 25th pose on", ERROR_LIVE, _silence("hangs"), *UNSURE
    ),
    Row("hangs-cpp", OF, "the same, with roscpp", ERROR_LIVE, cpp("hangs"), *UNSURE),
    Row(
        "raises",
        OF,
        "raises an error in each callback from the tenth on, which rospy catches",
        ERROR,
        _silence("raises-from-the10th"),
        *UNSURE,
    ),
    Row(
        "unsubscribes",
        OF,
        "stops listening after half of the poses",
        ERROR_LIVE,
        _silence("leaves-the-pose"),
        "failed",
        "MessagesLost",
    ),
]

HONEST = [
    Row(
        "last-only",
        OF,
        "answers the last pose alone, where nothing but the last distance is asked",
        ERROR_FINAL,
        _silence("only-the-last"),
        "passed",
    ),
    Row(
        "bursts",
        OF,
        "answers ten poses at once, after the tenth",
        RATE,
        _silence("bursts"),
        "passed",
    ),
    Row(
        "bursts-error",
        OF,
        "the same, where the truth is known",
        ERROR_LIVE,
        _silence("bursts"),
        "passed",
    ),
    Row(
        "no-alarm-and-works",
        OF,
        "answers, and gives no alarm",
        QUIET,
        python("localiser", "localiser"),
        "passed",
    ),
    Row(
        "plain", OF, "answers each pose", PRESENCE_LIVE, python("localiser", "localiser"), "passed"
    ),
    Row("plain-cpp", OF, "the same, with roscpp", PRESENCE_LIVE, cpp("honest"), "passed"),
]
