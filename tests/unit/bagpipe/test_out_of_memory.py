"""A stack that takes too much memory, of which the kernel ends the whole container.

The count of the node is faked, as the machine of the tests has a cgroup of version 1, whose kernel
ends one process alone.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from bagpipe.faults import FaultRule
from bagpipe.row_facts import tally
from bagpipe.run import memory_kills as memory_kills_module
from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.run.memory_kills import kills_since, memory_kills
from bagpipe.run.out_of_memory import out_of_memory
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from bagpipe.wire.frames import FrameType
from bagpipe.wire.session import SessionError
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.fake_agent import FakeAgent, Script, dying, make_slot, well_behaved
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

    def script(agent: FakeAgent) -> None:
        agent.read_until(FrameType.HELLO)
        agent.greet(agent.open_outgoing())
        vmstat.write_text("nr_free_pages 1\noom_kill 7\n")
        agent.vanish()

    return script


def test_a_stack_that_takes_too_much_memory_has_failed_and_is_not_tried_again(
    run: Run, killed: Script
) -> None:
    row = run(killed)
    assert (row["outcome"], row["reason"], row["attempts"]) == ("failed", "StackOutOfMemory", 1)
    assert row["message"] == (
        "the stack's container ended, and meanwhile the kernel of its node ended 4 processes for"
        " lack of memory: raise spec.stack.resources.limits.memory, or look at what the stack keeps"
    )
    assert row["result"] is None


def test_a_policy_may_ask_for_another_try(run: Run, killed: Script) -> None:
    rule = FaultRule(cause="StackOutOfMemory", action="retry")
    row = run(killed, well_behaved(), rules=(rule,))
    assert (row["outcome"], row["attempts"]) == ("passed", 2)
    assert [each["reason"] for each in row["discarded"]] == ["StackOutOfMemory"]


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
    assert out_of_memory(error, 5, 1) is error


def test_an_agent_that_comes_back_at_once_may_look_as_if_it_broke_the_protocol() -> None:
    error = out_of_memory(SessionError("ProtocolError", "no frame", ["boom"]), 2, 1)
    assert (error.reason, error.stderr) == ("StackOutOfMemory", ["boom"])
    assert "ended 2 processes for lack of memory" in str(error)


@pytest.mark.parametrize("slots", [1, 4])
def test_a_single_process_that_is_ended_was_the_agent_and_no_stack(slots: int) -> None:
    """As with cgroup v1: what the agent holds of a recording was more than the stack's part."""
    error = out_of_memory(SessionError("AgentDied", "it left the pipe"), 1, slots)
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


def test_it_counts_as_a_crash(run: Run, killed: Script) -> None:
    assert tally(run(killed))["crashed"] == 1
