"""What an end or a loss of the stack means for its case, by cause."""

import copy
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from bagpipe.engine.delivery import judge
from bagpipe.faults import ALLOWABLE, CAUSES, FAILURES, FaultPolicy, FaultRule
from bagpipe.plan.case import Case
from bagpipe.run import case_run
from bagpipe.run.attempts import Again, next_attempt
from bagpipe.run.case_run import Row, RunContext, case_map, run_case
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.fake_agent import (
    RESULT,
    FakeAgent,
    Script,
    aborting,
    make_slot,
    well_behaved,
)
from tests.unit.bagpipe.jobs import make_spec

Run = Callable[..., Row]

CRASH = {
    "cause": "StackCrashed",
    "what": "node",
    "name": "/tracker",
    "exit_status": None,
    "signal": 11,
    "bag_seconds": 12.3,
    "message": "/tracker was ended by signal 11 (SIGSEGV) at 12.3 s",
}
IDLE = {
    "busy": False, "message": "no stall above 4 ms", "throttled_seconds": 0.0,
    "stall_max_seconds": 0.0, "late_max_seconds": 0.0,
    "cpu_pressure_seconds": None, "steal_seconds": None,
}  # fmt: skip
BUSY = IDLE | {
    "busy": True,
    "message": "the pod was throttled for 2.1 s",
    "throttled_seconds": 2.1,
}


def policy(*rules: dict[str, Any]) -> FaultPolicy:
    return FaultPolicy([FaultRule.model_validate(rule) for rule in rules])


def ended(**end: Any) -> dict[str, Any]:
    """RESULT of a run in which something of the stack ended."""
    result = copy.deepcopy(RESULT)
    result["stack"] |= {"ended": [CRASH | end], "stderr": ["boom"]}
    return result


def lossy(machine: dict[str, Any] | None = None, **subscriber: Any) -> dict[str, Any]:
    """RESULT of a run in which a node lost a message."""
    result = copy.deepcopy(RESULT)
    lost = {"received": 2, "dropped": 1, "waited_seconds": 60.0} | subscriber
    result["ledger"]["topics"][0]["subscribers"][0] |= lost
    return result | ({"machine": machine} if machine else {})


@pytest.fixture
def context(tmp_path: Path) -> RunContext:
    folders = {name: str(tmp_path / name) for name in ("recordings", "results")}
    (tmp_path / "recordings").mkdir()
    write_bag(tmp_path / "recordings/a.bag", steady("/scan", 50, 10_000_000), chunk_bytes=512)
    return RunContext("lab/drive", make_spec(), folders, "pvc://results/r", str(tmp_path / "s"))


@pytest.fixture
def run(context: RunContext) -> Run:
    def with_scripts(*scripts: Script, rules: list[dict[str, Any]] | None = None) -> Row:
        ruled = dataclasses.replace(context, spec=make_spec(faultPolicy=rules or []))
        (case,) = plan_of(ruled)
        with FakeAgent(make_slot(Path(context.shared)), *scripts):
            return run_case(case, ruled)

    return with_scripts


def plan_of(context: RunContext) -> list[Case]:
    return plan(context.spec, Storage(context.volumes)).cases


def kept(context: RunContext) -> list[str]:
    return Storage(context.volumes).names("pvc://results/r/cases")


def ending_with(result: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> Script:
    """A session whose RESULT is this one."""

    def script(agent: FakeAgent) -> None:
        with monkeypatch.context() as patched:
            patched.setattr("tests.unit.bagpipe.fake_agent.RESULT", result)
            well_behaved(b"recorded")(agent)

    return script


@pytest.mark.parametrize("cause", ["StackCrashed", "StackExited", "NodeGone", "NodeRespawned"])
def test_an_end_of_the_stack_fails_its_case_unless_just_that_is_allowed(cause: str) -> None:
    judged = judge(ended(cause=cause))
    assert (judged.outcome, judged.reason) == ("failed", cause)
    assert judged.message == CRASH["message"]
    allowed = judge(ended(cause=cause), policy({"cause": cause, "action": "allow"}))
    assert (allowed.outcome, allowed.reason) == ("passed", "")
    assert [each.as_row() for each in allowed.allowed] == [
        {"cause": cause, "message": CRASH["message"]}
    ]
    others = [{"cause": c, "action": "allow"} for c in sorted(ALLOWABLE - {cause})]
    assert judge(ended(cause=cause), policy(*others)).reason == cause


def test_what_is_allowed_is_reported_beside_what_is_not() -> None:
    result = ended(cause="NodeRespawned", message="it came back")
    result["stack"]["ended"].append(CRASH)
    judged = judge(result, policy({"cause": "NodeRespawned", "action": "allow"}))
    assert (judged.outcome, judged.reason) == ("failed", "StackCrashed")
    assert [each.cause for each in judged.allowed] == ["NodeRespawned"]


# Promise: end-is-judged-first
def test_a_crash_goes_before_the_loss_that_it_causes() -> None:
    result = ended()
    result["ledger"] = lossy()["ledger"]
    assert judge(result).reason == "StackCrashed"


def test_an_allowed_end_proves_nothing_where_nothing_was_recorded() -> None:
    result = ended()
    result["recorded"]["messages"] = 0
    judged = judge(result, policy({"cause": "StackCrashed", "action": "allow"}))
    assert (judged.outcome, judged.reason) == ("invalid", "NothingRecorded")
    assert [each.cause for each in judged.allowed] == ["StackCrashed"]


@pytest.mark.parametrize(
    ("machine", "outcome", "reason"),
    [
        (BUSY, "errored", "MachineBusy"),
        (IDLE, "failed", "MessagesLost"),
        # Nobody measured: nothing speaks for the machine's fault.
        (None, "failed", "MessagesLost"),
    ],
)
def test_a_loss_is_the_machine_s_only_where_that_was_measured(
    machine: dict[str, Any] | None, outcome: str, reason: str
) -> None:
    judged = judge(lossy(machine))
    assert (judged.outcome, judged.reason) == (outcome, reason)
    assert judged.message.startswith("/stack processed 2 of 3 messages on /scan, 1 dropped")
    assert str(machine["message"] if machine else "") in judged.message


def test_a_loss_is_reported_with_what_waits_in_the_queue() -> None:
    assert "1 dropped, 7 in its queue" in judge(lossy(queue=7)).message


@pytest.mark.parametrize("change", [{"received": 2, "dropped": 0}, {"received": 3, "dropped": 1}])
def test_any_mismatch_in_the_ledger_is_a_loss(change: dict[str, Any]) -> None:
    assert judge(lossy(**change)).reason == "MessagesLost"


def test_more_received_than_sent_proves_nothing() -> None:
    judged = judge(lossy(received=4, dropped=0))
    assert (judged.outcome, judged.reason) == ("errored", "ProtocolError")


# Promise: loss-is-the-stack-s
def test_a_stack_that_loses_now_and_then_is_not_run_until_it_does_not(
    run: Run, context: RunContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = run(ending_with(lossy(IDLE), monkeypatch))
    assert (row["outcome"], row["reason"], row["attempts"]) == ("failed", "MessagesLost", 1)
    assert row["result"]["ledger"]["topics"][0]["subscribers"][0]["dropped"] == 1
    assert (row["discarded"], len(kept(context))) == ([], 1)


def test_a_busy_machine_is_tried_again_and_the_run_is_reported(
    run: Run, context: RunContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = run(ending_with(lossy(BUSY), monkeypatch), well_behaved(b"whole"))
    assert (row["outcome"], row["attempts"]) == ("passed", 2)
    (before,) = row["discarded"]
    assert before["reason"] == "MachineBusy"
    assert "while the machine was too busy (the pod was throttled" in before["message"]
    assert (before["machine"], before["ledger"]) == (BUSY, lossy()["ledger"])
    assert before["seconds"] > 0
    # What the lossy run recorded never counts.
    assert kept(context) == [row["recorded"].removeprefix("cases/")]


def test_a_machine_that_stays_busy_is_an_error_after_six_runs(
    run: Run, context: RunContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(case_run, "_pause", lambda _: None)
    row = run(*[ending_with(lossy(BUSY), monkeypatch)] * 6)
    assert (row["outcome"], row["reason"], row["attempts"]) == ("errored", "MachineBusy", 6)
    # Beside `result`, whose ledgers are summed over the cases that were run.
    assert (row["result"], row["recorded"], kept(context)) == (None, None, [])
    assert row["evidence"] == {"ledger": lossy()["ledger"], "machine": BUSY}


def test_a_crash_after_the_last_answer_keeps_its_recording_and_last_lines(
    run: Run, context: RunContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = run(ending_with(ended(), monkeypatch))
    assert (row["outcome"], row["reason"]) == ("failed", "StackCrashed")
    assert (row["stderr"], len(kept(context))) == (["boom"], 1)
    assert "allowed" not in row


def test_an_allowed_end_is_in_the_row(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    allowing = [{"cause": "StackCrashed", "action": "allow"}]
    row = run(ending_with(ended(), monkeypatch), rules=allowing)
    assert (row["outcome"], row["stderr"]) == ("passed", [])
    assert row["allowed"] == [{"cause": "StackCrashed", "message": CRASH["message"]}]


def test_a_crash_is_run_again_where_the_job_asks_for_it(run: Run, context: RunContext) -> None:
    crash = aborting("StackCrashed", "the stack ended with status 3", ["boom"])
    rules = [{"cause": "StackCrashed", "action": "retry", "retries": 2}]
    row = run(crash, crash, crash, rules=rules)
    assert (row["outcome"], row["reason"], row["attempts"]) == ("failed", "StackCrashed", 3)
    assert [each["reason"] for each in row["discarded"]] == ["StackCrashed"] * 2
    assert kept(context) == []


def test_the_agent_receives_what_is_allowed(context: RunContext) -> None:
    rules = [
        {"cause": "StackExited", "action": "allow"},
        {"cause": "NodeGone", "action": "retry"},
    ]
    ruled = dataclasses.replace(context, spec=make_spec(faultPolicy=rules))
    (case,) = plan_of(ruled)
    assert case_map(case, ruled)["faults"] == {"allow": ["StackExited"]}


@pytest.mark.parametrize("cause", CAUSES)
def test_retries_are_of_their_own_cause_and_once_by_default(cause: str) -> None:
    once = policy({"cause": cause, "action": "retry"})
    assert next_attempt(cause, [], once) == Again()
    assert next_attempt(cause, [cause], once) is None
    # What the node ended for lack of memory may have been another pod's, once.
    again = Again() if cause == "StackOutOfMemory" else None
    failing = policy({"cause": cause, "action": "fail"})
    assert next_attempt(cause, [], failing) == again
    assert next_attempt(cause, [cause], failing) is None
    other = "StackCrashed" if cause != "StackCrashed" else "NodeGone"
    assert next_attempt(other, [], once) is None


@pytest.mark.parametrize("reason", ["MachineBusy", "AgentDied", "BagUnreadable"])
def test_no_policy_changes_what_is_not_the_stack_s(reason: str) -> None:
    rules = [{"cause": cause, "action": "retry", "retries": 20} for cause in CAUSES]
    tried = [next_attempt(reason, [reason] * n, policy(*rules)) for n in range(5)]
    assert tried == [next_attempt(reason, [reason] * n) for n in range(5)]


@pytest.mark.parametrize(
    ("rules", "words"),
    [
        ([{"cause": "StackCrashed", "action": "allow", "retries": 1}], "retries has no meaning"),
        ([{"cause": "CaseDeadlineExceeded", "action": "allow"}], "can't be allowed"),
        ([{"cause": "StackCrashed", "action": "retry", "retries": 21}], "less than or equal to 20"),
        ([{"cause": "NodeGone", "action": "fail"}] * 2, "two rules of one cause"),
        ([{"cause": "Sunspots", "action": "fail"}], "Input should be"),
    ],
)
def test_what_makes_no_sense_is_refused(rules: list[dict[str, Any]], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        make_spec(faultPolicy=rules)


def test_every_cause_that_can_be_allowed_fails_a_case_and_both_are_causes() -> None:
    # What is unproved may be allowed, and is nobody's failure.
    assert set(CAUSES) > FAILURES > ALLOWABLE - {"DeliveryUnproved"}
    assert "DeliveryUnproved" in ALLOWABLE - FAILURES
