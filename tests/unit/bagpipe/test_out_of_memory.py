"""A stack that takes too much memory, of which the kernel ends the whole container.

The count of the node is faked, as the machine of the tests has a cgroup of version 1, whose kernel
ends one process alone.
"""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from bagpipe.case_reasons import REASONS
from bagpipe.faults import FaultRule
from bagpipe.row_facts import tally
from bagpipe.run import case_run as case_run_module
from bagpipe.run import memory_kills as memory_kills_module
from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.run.memory_kills import kills_since, memory_kills
from bagpipe.run.out_of_memory import named
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from bagpipe.wire import session as session_module
from bagpipe.wire import slot as slot_module
from bagpipe.wire.frames import Encoder, FrameType
from bagpipe.wire.session import AgentGoneError, SessionError
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.fake_agent import (
    FakeAgent,
    Script,
    aborting,
    dying,
    make_slot,
    well_behaved,
)
from tests.unit.bagpipe.jobs import make_spec

Run = Callable[..., Row]


@pytest.fixture
def vmstat(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    counts = tmp_path / "vmstat"
    counts.write_text("nr_free_pages 7\noom_kill 3\nnuma_hit 9\n")
    monkeypatch.setattr(memory_kills_module, "VMSTAT", counts)
    return counts


@pytest.fixture
def run(tmp_path: Path) -> Run:
    folders = {name: str(tmp_path / name) for name in ("recordings", "results")}
    (tmp_path / "recordings").mkdir()
    write_bag(tmp_path / "recordings/a.bag", steady("/scan", 50, 10_000_000), chunk_bytes=512)

    def with_scripts(
        *scripts: Script, slots: int | None = 1, rules: tuple[FaultRule, ...] = ()
    ) -> Row:
        spec = make_spec().model_copy(update={"fault_policy": list(rules)})
        shared = str(tmp_path / "s")
        context = RunContext("lab/drive", spec, folders, "pvc://results/r", shared, slots=slots)
        (case,) = plan(spec, Storage(folders)).cases
        with FakeAgent(make_slot(Path(shared)), *scripts):
            return run_case(case, context)

    return with_scripts


@pytest.fixture
def killed(vmstat: Path) -> Script:
    """An agent that dies when the kernel ends its container: it, rosmaster, and two nodes."""

    return _killed(vmstat, 7)


@pytest.fixture
def killed_again(vmstat: Path) -> Script:
    """The next one, which ends so as well."""
    return _killed(vmstat, 11)


def _killed(vmstat: Path, count: int) -> Script:
    def script(agent: FakeAgent) -> None:
        agent.read_until(FrameType.HELLO)
        agent.greet(agent.open_outgoing())
        vmstat.write_text(f"nr_free_pages 1\noom_kill {count}\n")
        agent.vanish()

    return script


ENDED = (
    "the stack's container ended, and meanwhile the kernel of its node ended 4 processes for"
    " lack of memory: raise spec.stack.resources.limits.memory, or look at what the stack keeps"
)


def test_a_stack_that_takes_too_much_memory_twice_has_failed_and_is_not_tried_again(
    run: Run, killed: Script, killed_again: Script
) -> None:
    row = run(killed, killed_again)
    assert (row["outcome"], row["reason"], row["attempts"]) == ("failed", "StackOutOfMemory", 2)
    assert row["message"] == ENDED
    assert row["result"] is None


def test_behind_one_such_end_a_case_neither_passes_nor_fails(run: Run, killed: Script) -> None:
    """Another pod's processes may be what the node ended, and the agent have died of something
    else: a neighbour fails no honest stack, and no stack passes that takes too much now and then.
    """
    row = run(killed, well_behaved())
    assert (row["outcome"], row["reason"], row["attempts"]) == ("invalid", "OutOfMemoryOnce", 2)
    assert row["message"] == (
        f"passed, but a try before it ended so: {ENDED}. Whether that was the stack, or its node's"
        " memory, is not known: one such end more would have failed it"
    )
    # A word of Bagpipe's own, which no program of a user's may take for its verdict.
    assert row["reason"] in REASONS
    # What was recorded can be looked at.
    assert row["recorded"]
    assert row["result"]


def test_a_case_that_fails_behind_one_such_end_has_failed(run: Run, killed: Script) -> None:
    row = run(killed, aborting("StackCrashed", "the command was ended by SIGSEGV", []))
    assert (row["outcome"], row["attempts"]) == ("failed", 2)
    assert row["reason"] == "StackCrashed"


def test_a_policy_may_ask_for_another_try(run: Run, killed: Script) -> None:
    rule = FaultRule(cause="StackOutOfMemory", action="retry")
    row = run(killed, well_behaved(), rules=(rule,))
    assert (row["outcome"], row["attempts"]) == ("passed", 2)
    assert [each["reason"] for each in row["discarded"]] == ["StackOutOfMemory"]


def test_what_was_ended_before_the_agent_was_met_is_not_the_stack_s(
    run: Run, vmstat: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lease = slot_module.lease

    def behind_a_neighbour(shared: Path, deadline: float) -> object:
        vmstat.write_text("oom_kill 9\n")
        return lease(shared, deadline)

    monkeypatch.setattr(case_run_module, "lease", behind_a_neighbour)
    row = run(dying, well_behaved())
    assert (row["outcome"], row["attempts"]) == ("passed", 2)
    assert [each["reason"] for each in row["discarded"]] == ["AgentDied"]


def test_an_agent_that_ends_before_it_greets_has_started_no_stack(
    run: Run, vmstat: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session_module, "GREETING_SECONDS", 0.3)

    def ends(agent: FakeAgent) -> None:
        agent.read_until(FrameType.HELLO)
        agent.open_outgoing()
        vmstat.write_text("oom_kill 9\n")
        agent.vanish()

    row = run(ends, well_behaved())
    assert (row["outcome"], row["attempts"]) == ("passed", 2)
    (before,) = row["discarded"]
    assert (before["reason"], "memory" in before["message"]) == ("AgentDied", False)


def test_an_agent_that_is_late_to_greet_has_not_ended() -> None:
    late = SessionError("AgentDied", "the agent did not answer within 30 s of HELLO")
    assert named(late, 5, 1) is late


def test_of_several_cases_in_one_container_it_is_not_known_whose_stack_it_was(
    run: Run, killed: Script
) -> None:
    row = run(killed, well_behaved(), slots=4)
    assert (row["outcome"], row["attempts"]) == ("passed", 2)
    (before,) = row["discarded"]
    assert before["reason"] == "AgentDied"
    assert before["message"].endswith(
        "meanwhile the kernel of its node ended 4 processes for lack of memory, spark.slots (4)"
        " cases share the container, so it is not known whose:"
        " raise spec.stack.resources.limits.memory"
    )


@pytest.mark.usefixtures("vmstat")
def test_an_agent_that_dies_while_no_memory_lacked_is_met_again(run: Run) -> None:
    row = run(dying, well_behaved())
    assert (row["outcome"], row["attempts"]) == ("passed", 2)
    assert [each["reason"] for each in row["discarded"]] == ["AgentDied"]


def test_where_there_is_no_container_an_agent_is_met_again(run: Run, killed: Script) -> None:
    row = run(killed, well_behaved(), slots=None)
    assert (row["outcome"], row["attempts"]) == ("passed", 2)


def test_what_was_ended_for_memory_on_the_same_node_spoils_no_case(run: Run, vmstat: Path) -> None:
    def beside_another(agent: FakeAgent) -> None:
        vmstat.write_text("oom_kill 4\n")
        well_behaved()(agent)

    row = run(beside_another)
    assert (row["outcome"], row["attempts"]) == ("passed", 1)


@pytest.mark.parametrize("reason", ["StackCrashed", "CaseDeadlineExceeded", "BagUnreadable"])
def test_what_the_agent_reports_itself_stays(reason: str) -> None:
    error = SessionError(reason, "as it was", ["boom"])
    assert named(error, 5, 1) is error


def test_an_agent_that_comes_back_at_once_looks_as_if_the_stream_were_broken(
    run: Run, vmstat: Path
) -> None:
    """The worker has not seen that the first one left the pipe: the next one's frames, which
    begin at number 0, come in the same stream."""

    def replaced(count: int) -> Script:
        def script(agent: FakeAgent) -> None:
            agent.read_until(FrameType.HELLO)
            pipe = agent.open_outgoing()
            agent.greet(pipe)
            vmstat.write_text(f"oom_kill {count}\n")
            next_one = Encoder()
            abort = {"session": "", "reason": "ProtocolError", "message": "no HELLO"}
            os.write(pipe, next_one.encode_fields(FrameType.ABORT, abort))
            agent.vanish()

        return script

    row = run(replaced(7), replaced(11))
    assert (row["outcome"], row["reason"], row["attempts"]) == ("failed", "StackOutOfMemory", 2)
    assert row["message"] == ENDED


def test_what_a_living_agent_calls_broken_is_no_stack_s_beside_a_neighbour_that_is_ended(
    run: Run, vmstat: Path
) -> None:
    """Its own ABORT goes on with its stream: it lives, and so does the stack's container."""

    def beside(count: int) -> Script:
        def script(agent: FakeAgent) -> None:
            agent.read_until(FrameType.HELLO)
            pipe = agent.open_outgoing()
            agent.greet(pipe)
            vmstat.write_text(f"oom_kill {count}\n")
            abort = {"reason": "ProtocolError", "message": "the digest of DATA is another one"}
            agent.send(pipe, FrameType.ABORT, abort)

        return script

    row = run(beside(7), beside(11), well_behaved())
    assert (row["outcome"], row["attempts"]) == ("passed", 3)
    assert [each["reason"] for each in row["discarded"]] == ["ProtocolError"] * 2


@pytest.mark.parametrize("message", ["the agent speaks protocol 2, this worker 1", "END says 1"])
def test_a_fault_within_the_agent_s_own_frames_is_none_of_the_stack_s(message: str) -> None:
    error = SessionError("ProtocolError", message)
    assert named(error, 5, 1) is error


@pytest.mark.parametrize("slots", [1, 4])
def test_a_single_process_that_is_ended_was_the_agent_and_no_stack(slots: int) -> None:
    """As with cgroup v1: what the agent holds of a recording was more than the stack's part."""
    error = named(AgentGoneError("AgentDied", "it left the pipe"), 1, slots)
    assert error.reason == "AgentDied"
    assert str(error) == (
        "it left the pipe; meanwhile the kernel of its node ended a process for lack of memory, the"
        " agent's own, or one of another pod: raise spec.stack.resources.limits.memory"
    )


@pytest.mark.parametrize(
    ("text", "kills"),
    [
        ("oom_kill 0\n", 0),
        ("a 1\noom_kill 12\noom_kill_x 9\n", 12),
        ("a 1\n", None),
        ("oom_kill many\n", None),
        ("", None),
    ],
)
def test_the_kernels_count(vmstat: Path, text: str, kills: int | None) -> None:
    vmstat.write_text(text)
    assert memory_kills() == kills


@pytest.mark.parametrize(("before", "since"), [(3, 0), (1, 2), (None, 0), (9, 0)])
def test_what_came_since(vmstat: Path, before: int | None, since: int) -> None:
    assert kills_since(before) == since
    vmstat.unlink()
    assert (memory_kills(), kills_since(before)) == (None, 0)


def test_this_machine_counts_them() -> None:
    assert memory_kills() is not None


def test_it_counts_as_a_crash(run: Run, killed: Script, killed_again: Script) -> None:
    assert tally(run(killed, killed_again))["crashed"] == 1
