"""What the cameras of a failed case showed at its failing moment: the stack's, and the input's."""

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from bagpipe.engine.engine import Attempt
from bagpipe.evaluate.cameras import first_moment, is_camera, seen
from bagpipe.evaluate.evidence import Recording
from bagpipe.plan.variant import stack_of

# Of the input so much is read before the moment: a camera that is slower shows nothing.
_LOOK_BACK = 2_000_000_000

log = logging.getLogger(__name__)


def images_of(
    attempt: Attempt, recorded: Recording, result: dict[str, Any], findings: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """As a case's row has them (bagpipe.evaluate.cameras); none of a case without such a moment.

    Never raises: they decide nothing.
    """
    try:
        window = attempt.case.window
        at = first_moment(findings, window.start)
        if at is None:
            return []
        outputs = {name: lambda: recorded for name in _cameras(result["recorded"]["topics"])}
        return seen(outputs, _inputs(attempt, result, at), window.start, at)
    except Exception:  # the case is what it is
        log.info("no images of case %s", attempt.case.id, exc_info=True)
        return []


def _cameras(topics: list[dict[str, Any]]) -> list[str]:
    return [str(each["topic"]) for each in topics if is_camera(str(each["type"]))]


def _inputs(
    attempt: Attempt, result: dict[str, Any], at: int
) -> dict[str, Callable[[], Recording]]:
    """The input's cameras, by the names that the recording has.

    Only of a case that is a piece of one recording: of these a moment can be read, and of others
    the whole would have to be in memory once more.
    """
    case = attempt.case
    if case.parts or not case.ranges or "://" not in case.bag:
        return {}
    before = max(case.window.lead_in_start, at - _LOOK_BACK)
    moment = replace(case, window=replace(case.window, start=before, end=at + 1))
    remapped = stack_of(attempt.spec, case.conditions).remap

    def of(topic: str) -> Callable[[], Recording]:
        return lambda: Recording(
            lambda: attempt.source.truth(moment, {topic}, attempt.storage), before, at + 1
        )

    names = [remapped.get(name, name) for name in _cameras(result["ledger"]["topics"])]
    return {name: of(name) for name in names}
