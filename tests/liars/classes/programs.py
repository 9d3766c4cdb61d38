"""Files and results by a program: the exec engine."""

from tests.liars.jobs import PROGRAM
from tests.liars.row import Row, program

OF = "files and results by a program"
CRASHED = ("failed", "StackCrashed")


def _row(name: str, does: str, outcome: str, reason: str = "", *says: str) -> Row:
    return Row(f"program-{name}", OF, does, PROGRAM, program(name), outcome, reason, says)


LIARS = [
    _row("leaves", "gives all, says passed, and ends with status 3", *CRASHED, "3"),
    _row("segfault", "gives all, says passed, and dies by SIGSEGV", *CRASHED, "signal 11"),
    _row("killed", "gives all, says passed, and is killed", *CRASHED, "signal 9"),
    _row(
        "segfault-before-the-end",
        "dies by SIGSEGV between its file and its end",
        *CRASHED,
        "SIGSEGV",
    ),
    _row("gives-nothing", "gives back neither a file nor a word", "invalid", "NothingRecorded"),
    _row(
        "caught-the-error",
        "swallows its own error and gives nothing back",
        "invalid",
        "NothingRecorded",
    ),
    _row("empty-file", "gives a file of no bytes, and no word", "invalid"),
    _row("no-word", "gives a RESULT that says nothing, and no file", "invalid"),
    _row(
        "own-word",
        "says PASS, which is none of the three words",
        "invalid",
        "UnknownOutcome",
        "PASS",
    ),
    _row("true-word", "says true, which is none of the three words", "invalid", "UnknownOutcome"),
    _row("null-word", "says null, which is none of the three words", "invalid", "UnknownOutcome"),
    _row(
        "misspelt",
        "gives a file, and says failed in a key that nobody reads",
        "invalid",
        "UnknownOutcome",
        "outcom",
    ),
    _row(
        "only-figures",
        "gives a file and figures, and no verdict on them",
        "invalid",
        "UnknownOutcome",
    ),
    _row("says-failed", "says failed", "failed", "ProgramFailed"),
    _row("nan-figure", "has a figure that is NaN", "failed|errored|invalid"),
    _row("infinite-figure", "has a figure that is infinite", "failed|errored|invalid"),
    _row("two-words", "says failed, and then passed", "failed|errored|invalid"),
    _row("prints", "prints between its frames", "failed|errored"),
    _row("no-end", "ends with status 0 before its end", "failed|errored"),
    _row("never-ends", "has published all, and stays", "failed|errored", "StackNeverExited"),
    _row("short-file", "promises a hundred bytes and gives one", "failed|errored"),
    _row("same-name-twice", "gives two files of one name", "failed|errored"),
]

HONEST = [
    _row("plain", "gives a file and says passed", "passed"),
    _row("only-a-file", "gives a file and no word", "passed"),
    _row("talkative", "says a thousand lines that look like errors on stderr", "passed"),
    _row("slow-program", "takes a second and a half", "passed"),
    _row("child-says-no", "runs a child whose status 1 is an answer, as that of grep", "passed"),
]
