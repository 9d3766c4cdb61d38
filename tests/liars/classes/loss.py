"""Messages that a stack does not take, and those that it throws away itself."""

from tests.liars.jobs import (
    ALLOWED,
    ERROR_LIVE,
    LEAD_IN_LIVE,
    PRESENCE_LIVE,
    SOME_LIVE,
    SOME_MAX,
)
from tests.liars.row import Row, cpp, python

OF = "loss"
LOST = ("failed", "MessagesLost")
UNSURE = ("invalid", "NotEnoughEvidence")


def _loss(which: str) -> tuple[str, ...]:
    return python("loss", which)


LIARS = [
    Row(
        "short-queue",
        OF,
        "has a queue of one and takes 200 ms for each pose",
        SOME_LIVE,
        _loss("short-queue"),
        *LOST,
        ("/localiser", "/pose"),
    ),
    Row(
        "short-queue-cpp",
        OF,
        "the same, with roscpp",
        SOME_LIVE,
        cpp("short-queue"),
        *LOST,
        ("/localiser", "/pose"),
    ),
    Row(
        "short-queue-max",
        OF,
        "the same, played as fast as it can",
        SOME_MAX,
        cpp("short-queue"),
        *LOST,
        ("/localiser",),
    ),
    Row(
        "two-runs-of-three",
        OF,
        "loses poses in two runs of three, and none in each third",
        SOME_LIVE,
        _loss("loses-two-runs-of-three"),
        *LOST,
        marks=("ran", "begun"),
    ),
    Row(
        "second-node-loses",
        OF,
        "has a second node with a queue of one",
        SOME_LIVE,
        _loss("second-node-loses"),
        *LOST,
        ("/planner",),
    ),
    Row(
        "stops-reading",
        OF,
        "stops its own process after ten poses",
        SOME_LIVE,
        _loss("stops"),
        "failed",
    ),
    Row(
        "never-done",
        OF,
        "takes two seconds for each pose, with a queue of a thousand",
        ERROR_LIVE,
        cpp("never-done"),
        *UNSURE,
    ),
    Row(
        "drops-by-itself",
        OF,
        "throws three poses of four away itself",
        ERROR_LIVE,
        _loss("drops-by-itself"),
        *UNSURE,
        ("of 50",),
    ),
    Row(
        "drops-by-chance",
        OF,
        "throws three of four poses away, other ones in each run",
        ERROR_LIVE,
        _loss("drops-by-chance"),
        *UNSURE,
    ),
    Row(
        "keeps-the-newest",
        OF,
        "works at the newest pose every 200 ms, after ROS has counted each as received",
        ERROR_LIVE,
        _loss("keeps-the-newest"),
        *UNSURE,
    ),
    Row(
        "listens-late",
        OF,
        "has the node that answers begin to listen a second after the start",
        ERROR_LIVE,
        _loss("listens-late"),
        "failed|invalid",
        "",
        (),
    ),
]

HONEST = [
    Row(
        "blocks-at-first",
        OF,
        "blocks for 1.6 s at the first pose of the lead-in, and loses none of the window",
        LEAD_IN_LIVE,
        _loss("first-callback-blocks"),
        "passed",
    ),
    Row(
        "many-threads",
        OF,
        "takes its poses with four threads",
        PRESENCE_LIVE,
        cpp("many-threads"),
        "passed",
    ),
    Row(
        "loss-allowed",
        OF,
        "loses poses, which the job allows",
        ALLOWED,
        _loss("short-queue"),
        "passed",
    ),
]
