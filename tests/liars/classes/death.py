"""Stacks that do not live to the end, and those that end as they should."""

from dataclasses import replace

from tests.liars.jobs import ALLOWED, ERROR, EXPECTED, PRESENCE, PRESENCE_LIVE, SOME_LIVE, SOME_MAX
from tests.liars.row import Row, cpp, launched, python

OF = "death"
CRASHED = ("failed", "StackCrashed")
SEGV = ("signal 11",)


def _death(which: str) -> tuple[str, ...]:
    return python("death", which)


OTHER = python("death", "slow-to-end")
PLANNER = python("loss", "quiet-planner")

LIARS = [
    Row(
        "crash-expected",
        OF,
        "dies by SIGSEGV after its last answer, where another fault is expected",
        EXPECTED,
        _death("segfault-after-the-last"),
        *CRASHED,
        SEGV,
    ),
    Row(
        "kills-the-master",
        OF,
        "kills the ROS master midway",
        SOME_LIVE,
        _death("kills-the-master"),
        "failed|errored",
    ),
    Row(
        "segfault",
        OF,
        "dies by SIGSEGV right after its last answer",
        PRESENCE,
        _death("segfault-after-the-last"),
        *CRASHED,
        SEGV,
    ),
    Row(
        "segfault-live",
        OF,
        "the same, played by the clock",
        PRESENCE_LIVE,
        _death("segfault-after-the-last"),
        *CRASHED,
        SEGV,
    ),
    Row(
        "segfault-cpp",
        OF,
        "dies by SIGSEGV a moment after its last answer, with roscpp",
        PRESENCE_LIVE,
        cpp("segfault"),
        *CRASHED,
        SEGV,
    ),
    Row(
        "null-pointer",
        OF,
        "writes to address 0 after its last answer",
        PRESENCE_LIVE,
        cpp("null"),
        *CRASHED,
        SEGV,
    ),
    Row(
        "uncaught",
        OF,
        "ends by an exception that nobody catches, after its last answer",
        PRESENCE_LIVE,
        cpp("uncaught"),
        *CRASHED,
        ("signal 6",),
    ),
    Row(
        "killed",
        OF,
        "is killed after its last answer, as where memory is short",
        PRESENCE,
        _death("killed-after-the-last"),
        *CRASHED,
        ("signal 9",),
    ),
    Row(
        "aborted",
        OF,
        "aborts after its last answer",
        PRESENCE,
        _death("abort-after-the-last"),
        *CRASHED,
        ("signal 6",),
    ),
    Row(
        "terminated",
        OF,
        "ends itself by SIGTERM before anybody asks it to",
        PRESENCE,
        _death("terminated-after-the-last"),
        *CRASHED,
        ("signal 15",),
    ),
    Row(
        "status-three",
        OF,
        "ends with status 3 after its last answer",
        PRESENCE,
        _death("status-three"),
        *CRASHED,
        ("3",),
    ),
    Row(
        "status-three-cpp",
        OF,
        "the same, with roscpp",
        PRESENCE_LIVE,
        cpp("status-3"),
        *CRASHED,
        ("3",),
    ),
    Row(
        "raises-in-main",
        OF,
        "ends by a Python exception after its last answer",
        PRESENCE,
        _death("raises-in-main"),
        *CRASHED,
        ("diverged",),
    ),
    Row(
        "segfault-midway",
        OF,
        "dies by SIGSEGV after half of the poses",
        SOME_LIVE,
        _death("segfault-in-the-midst"),
        *CRASHED,
        SEGV,
    ),
    Row(
        "leaves-early",
        OF,
        "ends with status 0 after 40 of 50 poses",
        SOME_LIVE,
        _death("leaves-after40"),
        "failed",
        "StackExited",
    ),
    Row(
        "leaves-the-graph",
        OF,
        "shuts its node down after 45 poses, and its process lives on",
        SOME_LIVE,
        _death("leaves-the-graph"),
        "failed",
        # Its process is there, so that the ledger may be the first to miss it (12 of 50 poses).
        says=("/localiser",),
    ),
    Row(
        "leaves-the-graph-cpp",
        OF,
        "the same, with roscpp",
        SOME_LIVE,
        cpp("leaves-the-graph"),
        "failed",
        says=("/localiser",),
    ),
    Row(
        "hidden-death",
        OF,
        "has a node that dies by SIGSEGV below a launcher that says nothing of it",
        PRESENCE_LIVE,
        launched(_death("segfault-after-the-last"), PLANNER),
        *CRASHED,
        SEGV,
    ),
    Row(
        "hidden-exit",
        OF,
        "has a node that ends with status 0 midway, below a launcher",
        SOME_LIVE,
        launched(_death("leaves-after40"), PLANNER),
        "failed",
        "NodeGone",
        ("/localiser",),
    ),
    Row(
        "respawned",
        OF,
        "has a node that dies midway and is restarted by its launcher",
        SOME_LIVE,
        launched(_death("segfault-in-the-midst"), PLANNER, option="--respawn"),
        "failed",
        "",
    ),
    Row(
        "respawned-quietly",
        OF,
        "has a node that ends with status 0 midway and is restarted",
        SOME_LIVE,
        launched(_death("leaves-after40"), PLANNER, option="--respawn"),
        "failed",
        # Whether the new one has registered by the end is a race.
        says=("/localiser",),
    ),
    Row(
        "helper-dies",
        OF,
        "has a helper, which is no node, that dies by SIGSEGV midway",
        PRESENCE_LIVE,
        _death("helper-dies"),
        *CRASHED,
        SEGV,
    ),
    Row(
        "daemon",
        OF,
        "starts its nodes behind its back and ends with status 0",
        SOME_LIVE,
        launched(python("localiser", "localiser"), option="--leave"),
        "failed",
        "StackExited",
    ),
    Row(
        "segfault-max",
        OF,
        "dies by SIGSEGV after its last answer, played as fast as it can",
        SOME_MAX,
        _death("segfault-after-the-last"),
        *CRASHED,
        SEGV,
    ),
]

# Those that leave a mark when they do what they do.
_LIVE_ON = {"daemon", "kills-the-master", "leaves-the-graph"}
LIARS = [r if r.name in _LIVE_ON else replace(r, marks=("ran", "died")) for r in LIARS]

HONEST = [
    Row(
        "done",
        OF,
        "ends with status 0 when the last pose is answered",
        PRESENCE,
        _death("done-after-the-last"),
        "passed",
    ),
    Row("slow-to-end", OF, "takes a second to end", PRESENCE, _death("slow-to-end"), "passed"),
    Row(
        "helper-ended",
        OF,
        "ends its own helper by SIGTERM and starts another one",
        PRESENCE_LIVE,
        _death("helper-ended"),
        "passed",
    ),
    Row(
        "child-says-no",
        OF,
        "runs a child whose status 1 is an answer, as that of grep",
        PRESENCE,
        _death("child-says-no"),
        "passed",
    ),
    Row(
        "set-up-says-no",
        OF,
        "has a launcher that runs `grep` first, which finds nothing",
        PRESENCE_LIVE,
        launched(
            ("/usr/bin/grep", "-q", "x", "/dev/null"),
            python("localiser", "localiser"),
            option="--set-up",
        ),
        "passed",
    ),
    Row(
        "broken-pipe",
        OF,
        "has a launcher that runs `yes | head -1`, which ends `yes` by SIGPIPE",
        PRESENCE_LIVE,
        launched(
            ("/usr/bin/bash", "-c", "yes | head -1 >/dev/null"),
            python("localiser", "localiser"),
            option="--set-up",
        ),
        "passed",
    ),
    Row(
        "two-nodes",
        OF,
        "is two nodes below a launcher",
        PRESENCE_LIVE,
        launched(python("localiser", "localiser"), PLANNER),
        "passed",
    ),
    Row(
        "many-nodes",
        OF,
        "is five nodes below a launcher",
        ERROR,
        launched(
            python("localiser", "localiser"),
            *[(*PLANNER, f"__name:=planner{n}", "/pose:=/answer") for n in range(4)],
        ),
        "passed",
    ),
    Row(
        "respawned-on-purpose",
        OF,
        "has a node that is respawned, which the job allows",
        ALLOWED,
        launched(_death("leaves-after40"), _death("outlives-it"), option="--respawn"),
        "passed",
        marks=("ran", "died"),
    ),
    Row(
        "crash-allowed",
        OF,
        "dies by SIGSEGV after its last answer, which the job allows",
        ALLOWED,
        _death("segfault-after-the-last"),
        "passed",
    ),
]
