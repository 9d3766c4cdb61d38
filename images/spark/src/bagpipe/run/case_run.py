"""One case from lease to row. Every fault becomes a row; nothing is raised to Spark.

The recorded bag is stored under a name of this attempt's own, so that two attempts of a
case can never meet; which one counts is decided by the driver's manifest alone.
"""

import errno
import logging
import posixpath
import random
import threading
import time
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bagpipe.engine.chosen import engine_of
from bagpipe.engine.engine import Attempt, Played
from bagpipe.engine_fields import fields_of
from bagpipe.faults import CAUSES, FAILURES, FaultPolicy
from bagpipe.json_equality import same
from bagpipe.plan.case import Case
from bagpipe.plan.made import Unplanned
from bagpipe.plan.variant import image_of, stack_of
from bagpipe.run import out_of_memory
from bagpipe.run.attempts import Again, next_attempt
from bagpipe.run.memory_kills import kills_since, memory_kills
from bagpipe.source.chosen import source_of
from bagpipe.source.source import Turns
from bagpipe.spec import SimulationJobSpec, Stack, shared_folder
from bagpipe.storage import Storage, StorageError
from bagpipe.texts import duration_seconds
from bagpipe.wire.hello_case import HelloCase, HelloQos
from bagpipe.wire.session import (
    Answer,
    InputFile,
    SessionError,
    Sink,
    Sinks,
    run_session,
    run_turns,
)
from bagpipe.wire.slot import Ends, SlotUnavailableError, lease, open_ends

# The agent ends a case at its deadline; the worker allows this much more for the answer.
_GRACE_SECONDS = 30.0
# A slot is free for every task; longer than this means that the agent is gone.
_MEETING_SECONDS = 60.0
_RECORD_BYTES = 1 << 30

_REASONS: list[tuple[type[Exception], str]] = [
    (SlotUnavailableError, "SlotUnavailable"),
    (StorageError, "StorageFailed"),
    # The pipes and locks of the shared volume: an agent that restarts makes them again.
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
    # How many cases one agent, and its container, runs at a time; None where there is no container.
    slots: int | None = None


def run_case(case: Case, context: RunContext, starts: int = 1) -> Row:
    """Run a case until it counts or its attempts are used up; gives its row for the manifest.

    `starts` says how often the case was given to an executor, this time included.
    """
    begun = since = time.monotonic()
    row, may_pass = _attempt(case, context)
    discarded: list[Row] = []
    reasons: list[str] = []
    policy = FaultPolicy(context.spec.fault_policy)
    while again := _again(row, reasons, policy, may_pass):
        _throw_away(row, context)
        discarded.append(_discarded(row, time.monotonic() - since))
        reasons.append(row["reason"])
        _pause(again)
        since = time.monotonic()
        row, may_pass = _attempt(case, context)
    if (row["outcome"], row["reason"]) == ("errored", "MachineBusy") and row["result"]:
        row = _unproved(row, context)
    if row["outcome"] == "passed" and not policy.retries(out_of_memory.REASON):
        row = _unless_out_of_memory(row, discarded)
    return _row(case, row, discarded, starts, time.monotonic() - begun)


def _again(row: Row, reasons: list[str], policy: FaultPolicy, may_pass: bool) -> Again | None:
    """Whether the case is run again: a verdict is one, whatever its reason is called, but where the
    job's policy asks for another try.
    """
    if row["outcome"] != "errored" and row["reason"] not in CAUSES:
        return None
    return next_attempt(row["reason"], reasons, policy, may_pass)


def _unless_out_of_memory(row: Row, discarded: list[Row]) -> Row:
    """The row of a case that passed, if no try before ended as for want of memory: whose fault that
    was is not known, so that it neither passed nor failed.
    """
    for each in discarded:
        if each["reason"] == out_of_memory.REASON:
            message = out_of_memory.passed_after(each["message"])
            return row | {"outcome": "invalid", "reason": out_of_memory.ONCE, "message": message}
    return row


def lost_row(case: Case, starts: int) -> Row:
    """The row of a case that is not started again: none of its starts brought it to an end."""
    message = (
        f"this case was started {starts} times and no executor brought it to an end, at least"
        f" {starts - 1} of them were lost: it may need more memory than"
        " spec.spark.executor.resources or spec.stack.resources allow, or its nodes are failing"
    )
    lost = _row(case, _errored("ExecutorLost", message), [], starts, 0.0)
    return lost | {"attempts": 0, "evidence": {"starts": []}}


def unplanned_row(bag: Unplanned) -> Row:
    """The row of a bag that yields no case."""
    return {
        "case": bag.id,
        "bag": bag.bag,
        "outcome": "errored",
        "reason": bag.reason,
        "message": bag.message,
        "recorded": None,
        "result": None,
        "attempts": 0,
        "discarded": [],
        "starts": 0,
    }


def is_of(row: Row, case: Case) -> bool:
    """Whether a row was made of this very case: the same window of the same, unchanged file."""
    return all(same(row.get(key), value) for key, value in _identity(case).items())


def _identity(case: Case) -> Row:
    window = [case.window.lead_in_start, case.window.start, case.window.end]
    conditions = case.conditions
    return {
        "case": case.id,
        "fragment": case.fragment,
        "variant": conditions.variant,
        "scenario": conditions.scenario,
        "values": conditions.values,
        "seed": conditions.seed,
        "round": conditions.round,
        "bag": case.bag,
        "bag_version": case.bag_version,
        "window": window,
    } | case.pieces


def _pause(again: Again) -> None:
    # Two cases that keep each other from running must not begin again together.
    spread = random.uniform(0.5, 1.5) if again.about else 1.0  # noqa: S311  no secret
    threading.Event().wait(again.seconds * spread)


def _throw_away(row: Row, context: RunContext) -> None:
    """Remove what a run recorded that does not count."""
    recorded = row["recorded"] or []
    for name in [recorded] if isinstance(recorded, str) else recorded:
        try:
            Storage(context.volumes).remove(posixpath.join(context.results, name))
        except StorageError as error:
            # Its name is no other's, and what the manifest does not name goes at the job's end.
            log.warning("a run that does not count leaves %s: %s", name, error)


def _discarded(row: Row, seconds: float) -> Row:
    """A run that does not count, as the row of its case describes it."""
    result = row["result"] or {}
    measured = {key: result[key] for key in ("ledger", "machine") if result.get(key)}
    discarded = {"reason": row["reason"], "message": row["message"], "seconds": round(seconds, 3)}
    return discarded | measured


def _unproved(row: Row, context: RunContext) -> Row:
    """The row of a run whose recording proves nothing: its figures stay, apart from `result`,
    whose ledgers are summed.
    """
    _throw_away(row, context)
    measured = {key: row["result"][key] for key in ("ledger", "machine")}
    row = {key: value for key, value in row.items() if key not in ("log", "images")}
    return row | {"recorded": None, "result": None, "criteria": [], "evidence": measured}


def _row(case: Case, ended: Row, discarded: list[Row], starts: int, seconds: float) -> Row:
    tries = {"attempts": len(discarded) + 1, "discarded": discarded, "starts": starts}
    return ended | _identity(case) | tries | {"seconds": round(seconds, 3)}


def _attempt(case: Case, context: RunContext) -> tuple[Row, bool]:
    """One run, and whether storage may give another answer the next time."""
    try:
        return _played(case, context), False
    except SessionError as error:
        return _ended(error), False
    except Exception as error:  # a fault of ours costs one case, never the whole job
        may_pass = isinstance(error, StorageError) and error.may_pass
        for kind, reason in _REASONS:
            if isinstance(error, kind):
                full = _says_full(error)
                return _errored("StorageFull" if full else reason, str(error)), may_pass
        log.exception("case %s", case.id)
        return _errored("Internal", f"{type(error).__name__}: {error}"), False


def _says_full(error: BaseException) -> bool:
    cause = error.__cause__ if isinstance(error, StorageError) else None
    return isinstance(cause, OSError) and cause.errno in (errno.ENOSPC, errno.EDQUOT)


def _ended(error: SessionError) -> Row:
    """A run that was cut short: failed where the stack's end is why."""
    row = _errored(error.reason, str(error), error.stderr)
    return row | {"outcome": "failed"} if error.reason in FAILURES else row


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
    engine, source = engine_of(context.spec.stack.engine), source_of(context.spec)
    storage = Storage(context.volumes)
    name = f"cases/{case.id}.{uuid.uuid4().hex[:12]}"
    attempt = Attempt(case, context.spec, source, storage, context.results, name)

    def exchange(sink: Sink | Sinks) -> Answer:
        # Before the agent is met: pieces of recordings are fetched and put together here.
        return _answered(case, context, engine.input(source, case, storage), sink)

    played = engine.play(attempt, exchange)
    found: Row = {} if played.findings is None else {"criteria": played.findings}
    more = {"log": played.log, "images": played.images}
    return _judged(played) | found | {key: value for key, value in more.items() if value}


def _judged(played: Played) -> Row:
    judgement, answer = played.judgement, played.answer
    stack = answer.result["stack"]
    allowed = {"allowed": [each.as_row() for each in judgement.allowed]}
    return (allowed if judgement.allowed else {}) | {
        "outcome": judgement.outcome,
        "reason": judgement.reason,
        "message": judgement.message,
        "stderr": stack.get("stderr", []) if judgement.reason in FAILURES else [],
        "recorded": played.recorded,
        "result": answer.result
        | {"pipe_bytes": _pipe_bytes(answer), "input_bytes": answer.input_bytes}
        | {"software": str(answer.hello.get("software") or "")},
    }


def _answered(
    case: Case, context: RunContext, inputs: InputFile | Turns, sink: Sink | Sinks
) -> Answer:
    meeting = time.monotonic() + _MEETING_SECONDS
    with lease(_shared(case, context), meeting) as slot, open_ends(slot, meeting) as ends:
        deadline = time.monotonic() + _case_seconds(context.spec) + _GRACE_SECONDS
        # What was ended before the agent is met was ended without this case.
        before = memory_kills()
        try:
            return _exchanged(ends, case_map(case, context), inputs, sink, deadline)
        except SessionError as error:
            known = out_of_memory.named(error, kills_since(before), context.slots)
            raise known from None


def _exchanged(
    ends: Ends, described: HelloCase, inputs: InputFile | Turns, sink: Sink | Sinks, deadline: float
) -> Answer:
    if isinstance(inputs, InputFile):
        return run_session(ends, described, [inputs], sink, deadline)
    described["simulator"] = inputs.described
    return run_turns(ends, described, inputs, sink, deadline)


def _shared(case: Case, context: RunContext) -> Path:
    """The volume of the agent in whose container this case's image runs."""
    number = image_of(context.spec, case.conditions.variant)
    return Path(shared_folder(context.shared, number))


def _pipe_bytes(answer: Answer) -> int:
    return int(answer.hello.get("pipe_bytes", 0))


def _case_seconds(spec: SimulationJobSpec) -> float:
    return duration_seconds(spec.playback.case_timeout)


def _offered(stack: Stack) -> dict[str, HelloQos]:
    return {
        topic: {"reliability": qos.reliability, "durability": qos.durability, "depth": qos.depth}
        for topic, qos in (stack.ros2.qos if stack.ros2 else {}).items()
    }


def case_map(case: Case, context: RunContext) -> HelloCase:
    """The case as HELLO carries it."""
    spec = context.spec
    stack = stack_of(spec, case.conditions)
    return {
        "id": case.id,
        "job": context.job,
        "engine": fields_of(spec.stack.engine).agent,
        "source": case.bag,
        "window": {
            "lead_in_start": case.window.lead_in_start,
            "start": case.window.start,
            "end": case.window.end,
        },
        "topics": spec.source.topics,
        "stack": {
            "command": stack.command,
            # Values of Secrets, ConfigMaps and the pod are in the stack's container already.
            "environment": {v.name: v.value for v in stack.env if v.value_from is None},
            "parameters": stack.parameters,
            "remap": stack.remap,
            "qos": _offered(stack),
            "player": stack.ros2.player if stack.ros2 else "auto",
            "active": stack.ros2.active if stack.ros2 else [],
            "flow_control": stack.ros2.flow_control if stack.ros2 else True,
            "master": stack.ros1.master if stack.ros1 else "agent",
        },
        "playback": {
            "mode": spec.playback.mode,
            "rate": spec.playback.rate,
            "steps": [
                {
                    "trigger": step.trigger,
                    "answer": step.answer,
                    "deadline": duration_seconds(step.deadline),
                    "by": step.by,
                    "optional": step.optional,
                }
                for step in spec.playback.steps
            ],
            "wait_for": spec.playback.wait_for,
        },
        # The agent plays on after an allowed end of the command.
        "faults": {"allow": FaultPolicy(spec.fault_policy).allowed},
        "record": {
            "topics": spec.record.topics if spec.record else [],
            "byte_budget": _RECORD_BYTES,
        },
        "deadlines": {
            "start": 30.0,
            "subscribe": duration_seconds(spec.playback.subscribe_timeout),
            "drain": 10.0,
            "stop": 5.0,
            "case": _case_seconds(spec),
        },
    }
