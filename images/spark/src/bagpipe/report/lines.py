"""Lines that have a time, for the axis of a case's courses. Pure."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from bagpipe.row_facts import is_finite

Row = Mapping[str, Any]

_MOST_LINES = 60
_CHARACTERS = 300
_LEVELS = frozenset({"fatal", "error", "warn", "info", "debug"})
_SECOND = 1_000_000_000
# So long after its window a case may go on. A line of a time far from it would draw all courses
# into one place of the axis.
_AFTER = 60 * _SECOND
# As rosconsole and rospy write where /use_sim_time is set: the wall's time, then that of /clock.
_ROS1_LINE = re.compile(
    r"(?:\x1b\[[0-9;]*m)?\[ ?(DEBUG|INFO|WARN|ERROR|FATAL)\] \[\d{1,12}\.\d{1,9},"
    r" (\d{1,12})\.(\d{1,9})\]:? (.*?)(?:\x1b\[0m)?"
)


def lines_of(row: Row, stderr: Sequence[str]) -> list[dict[str, Any]]:
    """`at` in seconds after the window's start, `level` and `text` of each line, by time.

    Those of /rosout, if it was recorded; else those of stderr that name a time of /clock from the
    lead-in's start to a minute after the window. Lines without a time are none of these.
    """
    given = row.get("log")
    found = [_logged(line) for line in given] if isinstance(given, list) else []
    lines = [line for line in found if line] or _of_stderr(row.get("window"), stderr)
    return sorted(lines, key=lambda line: float(line["at"]))[:_MOST_LINES]


def _logged(line: Any) -> dict[str, Any] | None:
    if not isinstance(line, Mapping):
        return None
    at, level = line.get("at"), line.get("level")
    if not is_finite(at):
        return None
    text = f"{line.get('node', '')}: {line.get('text', '')}"[:_CHARACTERS]
    return {
        "at": at,
        "level": level if isinstance(level, str) and level in _LEVELS else "info",
        "text": text,
    }


def _of_stderr(window: Any, stderr: Sequence[str]) -> list[dict[str, Any]]:
    if not isinstance(window, list) or len(window) != 3:
        return []
    lines = []
    for line in stderr:
        named = _ROS1_LINE.fullmatch(line)
        if named is None:
            continue
        level, whole, part, text = named.groups()
        time = int(whole) * _SECOND + int(part.ljust(9, "0"))
        if window[0] <= time <= window[2] + _AFTER:
            at = round((time - window[1]) / 1e9, 4)
            lines.append({"at": at, "level": level.lower(), "text": text[:_CHARACTERS]})
    return lines
