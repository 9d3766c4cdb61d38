"""What a row of the table is: a stack, what it is asked, and what its result must be."""

from dataclasses import dataclass
from pathlib import Path

from tests.liars.jobs import Question

STACKS = Path(__file__).parent / "stacks"
PYTHON = "/usr/bin/python3"


@dataclass(frozen=True)
class Row:
    """One stack. `outcome` may name several, by bars; `says` are pieces of the message."""

    name: str
    of: str
    does: str
    asked: Question
    command: tuple[str, ...]
    outcome: str
    reason: str = ""
    says: tuple[str, ...] = ()
    # What the stack leaves to show that it has run, and has done what it does.
    marks: tuple[str, ...] = ("ran",)

    @property
    def honest(self) -> bool:
        """Whether it has to pass."""
        return self.outcome == "passed"


def python(script: str, which: str) -> tuple[str, ...]:
    """A rospy node of tests/liars/stacks."""
    return (PYTHON, str(STACKS / f"{script}.py"), which)


def cpp(which: str) -> tuple[str, ...]:
    """A roscpp node of tests/liars/stacks/liar.cpp, compiled before the first job."""
    return ("{liar}", which)


def launched(*commands: tuple[str, ...], options: str = "") -> tuple[str, ...]:
    """Nodes below a launcher that hides how they end."""
    words = [PYTHON, str(STACKS / "launcher.py"), *options.split()]
    for place, command in enumerate(commands):
        words += ["++"] * bool(place) + list(command)
    return tuple(words)


def program(which: str) -> tuple[str, ...]:
    """A program of the exec engine."""
    return ("{python}", str(STACKS / "programs.py"), which)
