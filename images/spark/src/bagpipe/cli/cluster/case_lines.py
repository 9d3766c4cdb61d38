"""Which lines of an executor's stack container belong to which case. Pure.

The agent writes there what the stack's processes say and what it has to say itself:

    [slot 1 case drive-0003 stack] loading the map
    [slot 1 case drive-0003 rosmaster] started
    [slot 1 case drive-0003] the agent, or the stack where its engine says so
    [slot 1] StackExited: the agent of what its slot is at
"""

import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from bagpipe.engine_fields import engine_names, fields_of

_LINE = re.compile(r"^\[slot (\d+)(?: case ([^\] ]+)(?: ([^\]]+))?)?\] ?(.*)$")


class LogLine(NamedTuple):
    """One line: by the stack or by the agent, in which case (empty: in none), without its mark."""

    by: str
    case: str
    text: str


def log_lines(lines: Iterable[str], engine: str) -> Iterator[LogLine]:
    """Every line with its writer; what a slot writes between two lines of a case belongs to it."""
    unmarked = _writer_without_mark(engine)
    at: dict[str, str] = {}
    for line in lines:
        found = _LINE.match(line)
        if found is None:
            yield LogLine("agent", "", line)
            continue
        slot, case, program, text = found.groups()
        if case is None:
            yield LogLine("agent", at.get(slot, ""), text)
            continue
        at[slot] = case
        if (program or unmarked) == "stack":
            yield LogLine("stack", case, text)
        else:
            yield LogLine("agent", case, f"{program}: {text}" if program else text)


def _writer_without_mark(engine: str) -> str:
    # The cluster may have engines that are not installed where its logs are read.
    return fields_of(engine).unmarked_lines if engine in engine_names() else "agent"


def of_case(log: str, case: str, by: str, engine: str) -> list[str]:
    """What the stack or the agent wrote in one case."""
    return [s.text for s in log_lines(log.splitlines(), engine) if s.case == case and s.by == by]


def of_all(log: str, by: str, engine: str) -> list[str]:
    """What the stack or the agent wrote, each line with its case."""
    return [
        f"[{s.case}] {s.text}" if s.case else s.text
        for s in log_lines(log.splitlines(), engine)
        if s.by == by
    ]
