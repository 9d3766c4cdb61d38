"""What a stack's nodes wrote to /rosout in a case, with its times: its failing moment in words.

Lines of stderr have no time of their own that could be believed; messages have that of receipt.
"""

import logging
from typing import Any

from bagpipe.evaluate.evidence import Recording, Sample

TOPIC = "/rosout"
# Of a case that did not pass; of one that passed only those from WARN on.
MOST_LINES, MOST_PASSED_LINES = 60, 10
_CHARACTERS = 300
# rosgraph_msgs/Log, and rcl_interfaces/msg/Log.
_ROS1 = {1: "debug", 2: "info", 4: "warn", 8: "error", 16: "fatal"}
_ROS2 = {10: "debug", 20: "info", 30: "warn", 40: "error", 50: "fatal"}
_LEVELS = _ROS1 | _ROS2
_ORDER = ("fatal", "error", "warn", "info", "debug")

log = logging.getLogger(__name__)


def written(recorded: Recording, start: int, *, passed: bool) -> list[dict[str, Any]]:
    """`at` (seconds after the window's `start` in ns, when it was received), `level`, `node` and
    `text` of each line, by time: the worst ones where there are too many.

    Nothing where none can be read: it decides nothing.
    """
    try:
        lines = [_line(sample, start) for sample in recorded.samples(TOPIC)]
    except Exception:  # whatever is recorded there, the case is what it is
        log.info("no lines of %s", TOPIC, exc_info=True)
        return []
    if passed:
        lines = [line for line in lines if line["level"] not in ("info", "debug")]
    worst = sorted(lines, key=lambda line: (_ORDER.index(line["level"]), line["at"]))
    kept = worst[: MOST_PASSED_LINES if passed else MOST_LINES]
    return sorted(kept, key=lambda line: line["at"])


def _line(sample: Sample, start: int) -> dict[str, Any]:
    """Raises AttributeError for what is no line of a log."""
    message = sample.message
    return {
        "at": round((sample.time - start) / 1e9, 4),
        "level": _LEVELS.get(int(message.level), "info"),
        "node": str(message.name)[:_CHARACTERS],
        "text": str(message.msg)[:_CHARACTERS],
    }
