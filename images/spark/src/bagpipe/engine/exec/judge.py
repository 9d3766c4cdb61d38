"""The verdict on a case of the exec engine: the program's own, if it ended as it should."""

import json
import re
from typing import Any

from bagpipe.case_reasons import REASONS
from bagpipe.engine.exec.outputs import REASON
from bagpipe.faults import FaultPolicy
from bagpipe.judgement import Judgement, ends, first_that_counts
from bagpipe.wire.session import SessionError

_MAX_MESSAGE = 2000
_NO_POLICY = FaultPolicy([])
_REASON = re.compile(r"[A-Z][A-Za-z0-9]{0,63}")


def judge_program(result: dict[str, Any], policy: FaultPolicy = _NO_POLICY) -> Judgement:
    """Judge a RESULT map of the exec engine (docs/reference/binpipe.md, "The exec engine").

    Raises SessionError where the program's exit status is not 0, or its own RESULT could not be
    written as JSON.
    """
    stack = result["stack"]
    if stack["exit_status"] != 0:
        message = f"the program's exit status is {stack['exit_status']}"
        raise SessionError("StackCrashed", message, stack.get("stderr"))
    return first_that_counts(ends(result), policy, _by_result(result))


def _by_result(result: dict[str, Any]) -> Judgement:
    """The verdict by what the program gave back."""
    program = result.get("program")
    # A RESULT without a word and files without a byte are what a program gives that did nothing.
    if not program and not (result["records_out"] and result["bytes_out"]):
        return Judgement(
            "invalid",
            "NothingRecorded",
            "the program gave back neither a RESULT nor a file with anything in it, so nothing"
            " speaks for it",
        )
    if program is None:
        return Judgement("passed")
    try:
        json.dumps(program, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise SessionError(REASON, f"the program's RESULT is not JSON: {error}") from error
    return _own_word(program)


def _own_word(program: dict[str, Any]) -> Judgement:
    if "outcome" not in program:
        # A misspelt word must not pass, and figures are no verdict.
        keys = ", ".join(sorted(map(str, program)))[:100] or "nothing"
        return Judgement(
            "invalid",
            "UnknownOutcome",
            f"the program's RESULT has {keys} and no outcome: write passed, failed or invalid",
        )
    outcome = program["outcome"]
    message = str(program.get("message", ""))[:_MAX_MESSAGE]
    if outcome == "passed":
        return Judgement("passed", "", message)
    if outcome not in ("failed", "invalid"):  # of any type: a list has no hash
        return Judgement(
            "invalid",
            "UnknownOutcome",
            f"the program's outcome is {str(outcome)[:100]!r}: write passed, failed or invalid",
        )
    message = message or f"the program says {outcome}, and not why"
    reason = program.get("reason")
    own = reason if isinstance(reason, str) and _REASON.fullmatch(reason) else ""
    # By Bagpipe's own words a case is run again, or counts as one that had no input.
    if own and own not in REASONS:
        return Judgement(outcome, own, message)
    reason = "ProgramFailed" if outcome == "failed" else "ProgramInvalid"
    return Judgement(outcome, reason, f"{own}: {message}" if own else message)
