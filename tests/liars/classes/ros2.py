"""Stacks of the other classes as nodes of ROS 2, and those that only ROS 2 has.

What only a criterion sees is as in ROS 1; here are those that the engine judges, and of the others
some, for their way from CDR to the verdict.
"""

from dataclasses import replace

from tests.liars.classes import arithmetic, death, loss, order, silence, time, wrong
from tests.liars.jobs import (
    ERROR_IN_VAIN,
    ERROR_LIVE,
    ERROR_SIM,
    LEAD_IN_LIVE,
    PRESENCE,
    PRESENCE_LIVE,
    PRESENCE_STEADY,
    SOME_LIVE,
    SOME_MAX,
    of_ros2,
)
from tests.liars.row import Row, launched, python

OF = "as nodes of ROS 2"
UNPROVED = ("invalid", "DeliveryUnproved")
# Of a class that is not here, all that are written in Python.
_SOME = {
    time: """wall-clock hour-ahead zero-stamps backward-clock one-stamp far-future-then-silent
        far-future-beside old-stamps late-but-right second-zero""",
    arithmetic: "nan-from-the-tenth infinity-bounds no-rotation nan-ego second-voice keeps-away",
    silence: """sees-once stamps-ahead-in-the-lead-in nothing nothing-at-all only-the-drain
        two-answers lead-in-only other-name hangs raises unsubscribes last-only bursts plain""",
    wrong: "two-types point no-header old-software hidden-memory modest",
}
_PARTS = (time, arithmetic, silence, death, loss, order, wrong)
# Without a master nobody kills it, and a name is nobody's alone.
_NOT = {"kills-the-master"}


# What is otherwise than in ROS 1: there the master sends a second type away.
_OTHERWISE = {"two-types": ("errored", "RecordingIncomplete")}


def _ros2(row: Row) -> Row:
    asked = replace(row.asked, job=of_ros2(row.asked.job))
    outcome, reason = _OTHERWISE.get(row.name, (row.outcome, row.reason))
    name = f"ros2-{row.name}"
    return replace(row, name=name, of=OF, asked=asked, outcome=outcome, reason=reason)


def _chosen(row: Row, some: str | None) -> bool:
    named = some is None or row.name in some.split()
    return named and row.name not in _NOT and "{liar}" not in row.command


def _traced(*command: str) -> tuple[str, ...]:
    """A node that reports its callbacks, as rclcpp's do."""
    return ("/usr/bin/env", "LIAR_TRACED=1", *command)


def _hidden(*command: str) -> tuple[str, ...]:
    return ("/usr/bin/env", "-u", "LD_PRELOAD", *command)


def _own(which: str) -> tuple[str, ...]:
    return python("ros2_alone", which)


PLAIN = python("localiser", "localiser")
_OWN = [
    Row(
        "uncounted",
        OF,
        "clears its environment, so that nothing counts in it",
        PRESENCE_LIVE,
        _hidden(*PLAIN),
        *UNPROVED,
        ("/localiser", "/pose"),
    ),
    Row(
        "uncounted-namesake",
        OF,
        "has a second node of its name, which counts, and takes no poses",
        PRESENCE_LIVE,
        launched(_hidden(*PLAIN), (*_own("deaf"), "__name:=localiser")),
        "failed|invalid",
    ),
    Row(
        "twin-loses",
        OF,
        "is two nodes of one name, of which one loses poses",
        SOME_LIVE,
        launched(PLAIN, python("loss", "short-queue"), options="--together"),
        "failed",
        "MessagesLost",
        ("/localiser",),
    ),
    Row(
        "slow-executor",
        OF,
        "takes two seconds for each pose, with a queue of a thousand",
        ERROR_LIVE,
        _own("slow-executor"),
        "failed|invalid",
    ),
    Row(
        "sleeps-between",
        OF,
        "sleeps two seconds between two poses, outside of callbacks, with a queue of one",
        SOME_LIVE,
        _own("sleeps-between"),
        "failed",
        "MessagesLost",
    ),
    Row(
        "feeds-itself",
        OF,
        "publishes poses of its own beside the recording's, and answers the recording's alone",
        PRESENCE_LIVE,
        python("wrong", "feeds-itself"),
        "passed",
    ),
    Row(
        "clock-only",
        OF,
        "answers by simulated time alone, and takes no poses",
        ERROR_IN_VAIN,
        _own("clock-only"),
        "errored",
        "NeverSubscribed",
        marks=(),
    ),
    Row(
        "waits-for-time",
        OF,
        "waits in its callback for simulated time to pass",
        ERROR_SIM,
        _own("waits-for-time"),
        "failed|invalid|errored",
    ),
    Row(
        "short-queue-called",
        OF,
        "has a queue of one, takes 200 ms for each pose, and reports its callbacks",
        SOME_LIVE,
        _traced(*python("loss", "short-queue")),
        "failed",
        "MessagesLost",
        ("/localiser", "/pose"),
    ),
    Row(
        "segfault-called",
        OF,
        "dies by SIGSEGV in its last callback, which it reports",
        PRESENCE,
        _traced(*python("death", "segfault-after-the-last")),
        "failed",
        "StackCrashed",
        ("signal 11",),
        marks=("ran", "died"),
    ),
    Row(
        "hangs-called",
        OF,
        "has a deadlock from the 25th pose on, in a callback that it reports",
        ERROR_LIVE,
        _traced(*python("silence", "hangs")),
        "failed|invalid",
    ),
    Row(
        "plain-called",
        OF,
        "answers each pose, and reports its callbacks",
        PRESENCE_LIVE,
        _traced(*PLAIN),
        "passed",
    ),
    Row(
        "blocks-at-first-called",
        OF,
        "blocks for 1.6 s at the first pose of the lead-in, in a callback that it reports",
        LEAD_IN_LIVE,
        _traced(*python("loss", "first-callback-blocks")),
        "passed",
    ),
    Row(
        "short-queue-max",
        OF,
        "has a queue of one and takes 200 ms for each pose, played as fast as it takes them",
        SOME_MAX,
        python("loss", "short-queue"),
        "passed",
    ),
    Row(
        "subscribes-again",
        OF,
        "subscribes again after every tenth pose",
        PRESENCE_STEADY,
        _own("subscribes-again"),
        "passed",
    ),
]
_ALL = [
    _ros2(row)
    for part in _PARTS
    for row in [*part.LIARS, *part.HONEST]
    if _chosen(row, _SOME.get(part))
] + [_ros2(row) for row in _OWN]
LIARS = [row for row in _ALL if not row.honest]
HONEST = [row for row in _ALL if row.honest]
