"""User logic as the caller names it: a command to start, or named pipes that something serves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

# Nothing may wait for ever; a day is longer than a partition should take.
DEFAULT_TIMEOUT_SECONDS = 86_400.0
DEFAULT_RECORD_TIMEOUT_SECONDS = 600.0


@dataclass(frozen=True)
class Deadlines:
    """Seconds of the program's own time; while Spark takes results the clock stands still.

    `partition` bounds all records of a partition. `record` bounds how long the program may take
    no byte and give none: the longest that it may work on one record.
    """

    partition: float = DEFAULT_TIMEOUT_SECONDS
    record: float = DEFAULT_RECORD_TIMEOUT_SECONDS

    def __post_init__(self) -> None:
        if self.partition <= 0 or self.record <= 0:
            raise ValueError("timeout and record_timeout are seconds above 0")


@dataclass(frozen=True)
class Command:
    """A program that is started once for each partition: `arguments` as execve takes them."""

    arguments: tuple[str, ...]
    environment: tuple[tuple[str, str], ...] = ()
    folder: str | None = None


@dataclass(frozen=True)
class Fifos:
    """Named pipes of a program that runs elsewhere; one session at a time, by a lease file."""

    to_program: str
    from_program: str


@dataclass(frozen=True)
class Slots:
    """A folder of pairs, `slots/<name>/{to-agent,from-agent,lease}`: any that is free.

    The layout is the agent's, the program is not: an agent runs cases and refuses records.
    """

    folder: str


Logic = Command | Fifos | Slots


def user_logic(
    command: Sequence[str] | None,
    fifo: tuple[str, str] | str | None,
    environment: Mapping[str, str] | None,
    folder: str | None,
) -> Logic:
    """The one that was named. Raises ValueError or TypeError with what to write instead."""
    if (command is None) == (fifo is None):
        raise ValueError("name the user logic once: by command=[...] or by fifo=(to, from)")
    if command is not None:
        if isinstance(command, str):
            raise TypeError(
                "command is a list of strings, for example ['python3', 'rotate.py']: no shell"
                " reads it, so a single string would be one long program name"
            )
        if not command:
            raise ValueError("command is empty: its first string is the program")
        settings = tuple(sorted((environment or {}).items()))
        return Command(tuple(command), settings, folder)
    if environment or folder:
        raise ValueError("environment and cwd belong to command=: a fifo's program runs already")
    if isinstance(fifo, str):
        return Slots(fifo)
    if fifo is None or len(fifo) != 2:
        raise ValueError("fifo is a pair (to_program, from_program) or the folder of the slots")
    return Fifos(*fifo)
