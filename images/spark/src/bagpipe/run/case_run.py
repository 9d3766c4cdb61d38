"""One case from lease to row. Every fault becomes a row; nothing is raised to Spark.

The recorded bag is stored under a name of this attempt's own, so that two attempts of a
case can never meet; which one counts is decided by the driver's manifest alone.
"""

import logging
import posixpath
import time
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bagpipe.pipe.session import Answer, SessionError, run_session
from bagpipe.pipe.slot import SlotUnavailableError, lease, open_ends
from bagpipe.plan.cases import Case
from bagpipe.run.fragment_stream import fragment_file
from bagpipe.run.judge import DeliveryIncompleteError, judge
from bagpipe.spec import SimulationJobSpec, duration_seconds
from bagpipe.storage import NewFile, Storage, StorageError

ATTEMPTS = 3
# A node with a short queue loses messages while its machine is busy, which passes.
REALTIME_ATTEMPTS = 10
# The agent ends a case at its deadline; the worker allows this much more for the answer.
_GRACE_SECONDS = 30.0
# A slot is free for every task; longer than this means that the agent is gone.
_MEETING_SECONDS = 60.0
_RECORD_BYTES = 1 << 30

# Faults of the machinery or of timing, where the same case may well succeed the next time.
_WORTH_ANOTHER_TRY = {
    "AgentDied",
    "DeliveryIncomplete",
    "ProtocolError",
    "RosMasterFailed",
    "SlotUnavailable",
}

_REASONS: list[tuple[type[Exception], str]] = [
    (DeliveryIncompleteError, "DeliveryIncomplete"),
    (SlotUnavailableError, "SlotUnavailable"),
    (StorageError, "StorageFailed"),
    # The pipes and locks of the shared volume: an agent that starts anew makes them again.
    (OSError, "SlotUnavailable"),
]

Row = dict[str, Any]

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class RunContext:
    """What all cases of a job share; pickled once per task."""

    job: str
    spec: SimulationJobSpec
    volumes: dict[str, str]
    results: str
    shared: str = "/bagpipe/shared"


def run_case(case: Case, context: RunContext) -> Row:
    """Run a case until it counts or its attempts are used up; gives its row for the manifest."""
    begun = time.monotonic()
    attempts = 1
    row = _attempt(case, context)
    while attempts < attempts_allowed(row["reason"], context.spec.playback.mode):
        attempts += 1
        row = _attempt(case, context)
    return row | {
        "case": case.id,
        "bag": case.bag,
        "window": [case.window.lead_in_start, case.window.start, case.window.end],
        "attempts": attempts,
        "seconds": round(time.monotonic() - begun, 3),
    }


def attempts_allowed(reason: str, mode: str) -> int:
    """How often a case that ended with `reason` may be run in all."""
    if reason == "DeliveryIncomplete" and mode == "realtime":
        return REALTIME_ATTEMPTS
    return ATTEMPTS if reason in _WORTH_ANOTHER_TRY else 1


def _attempt(case: Case, context: RunContext) -> Row:
    try:
        return _played(case, context)
    except SessionError as error:
        return _errored(error.reason, str(error), error.stderr)
    except Exception as error:  # a fault of ours costs one case, never the whole job
        for kind, reason in _REASONS:
            if isinstance(error, kind):
                return _errored(reason, str(error))
        log.exception("case %s", case.id)
        return _errored("Internal", f"{type(error).__name__}: {error}")


def _errored(reason: str, message: str, stderr: list[str] | None = None) -> Row:
    return {
        "outcome": "errored",
        "reason": reason,
        "message": message,
        "stderr": stderr or [],
        "recorded": None,
        "result": None,
    }


def _played(case: Case, context: RunContext) -> Row:
    storage = Storage(context.volumes)
    name = f"cases/{case.id}.{uuid.uuid4().hex[:12]}.bag"
    recorded = posixpath.join(context.results, name)
    try:
        with storage.create(recorded) as sink:
            answer = _answered(case, context, storage, sink)
        judgement = judge(answer.result)
    except DeliveryIncompleteError:
        storage.remove(recorded)
        raise
    return {
        "outcome": judgement.outcome,
        "reason": judgement.reason,
        "message": judgement.message,
        "stderr": [],
        "recorded": name,
        "result": answer.result | {"pipe_bytes": _pipe_bytes(answer)},
    }


def _answered(case: Case, context: RunContext, storage: Storage, sink: NewFile) -> Answer:
    meeting = time.monotonic() + _MEETING_SECONDS
    with lease(Path(context.shared), meeting) as slot, open_ends(slot, meeting) as ends:
        deadline = time.monotonic() + _case_seconds(context.spec) + _GRACE_SECONDS
        files = [fragment_file(case, storage)]
        return run_session(ends, case_map(case, context), files, sink, deadline)


def _pipe_bytes(answer: Answer) -> int:
    return int(answer.hello.get("pipe_bytes", 0))


def _case_seconds(spec: SimulationJobSpec) -> float:
    return duration_seconds(spec.playback.case_timeout)


def case_map(case: Case, context: RunContext) -> dict[str, Any]:
    """The case as HELLO carries it."""
    spec = context.spec
    return {
        "id": case.id,
        "job": context.job,
        "window": {
            "lead_in_start": case.window.lead_in_start,
            "start": case.window.start,
            "end": case.window.end,
        },
        "topics": spec.source.topics,
        "stack": {
            "command": spec.stack.command,
            "environment": {variable.name: variable.value for variable in spec.stack.env},
            "parameters": spec.stack.parameters,
            "remap": spec.stack.remap,
        },
        "playback": {
            "mode": spec.playback.mode,
            "rate": spec.playback.rate,
            "steps": [
                step.model_dump() | {"deadline": duration_seconds(step.deadline)}
                for step in spec.playback.steps
            ],
        },
        "record": {"topics": spec.record.topics, "byte_budget": _RECORD_BYTES},
        "deadlines": {
            "start": 30.0,
            "subscribe": duration_seconds(spec.playback.subscribe_timeout),
            "drain": 10.0,
            "stop": 5.0,
            "case": _case_seconds(spec),
        },
    }
