"""What the worker reads when the stack, the agent or the worker itself fails; nothing is left."""

import io
import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bagpipe.run.case_run import Row, RunContext, case_map, run_case
from bagpipe.source.bags.stream import fragment_file
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from bagpipe.wire.frames import Encoder, FrameType
from bagpipe.wire.session import SessionError, run_session
from bagpipe.wire.slot import lease, open_ends
from tests.integration.conftest import RunningAgent
from tests.integration.stacks import folders_with_recording, spec_with, stepped
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.integration

Start = Callable[..., RunningAgent]


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    return folders_with_recording(tmp_path)


def run_one(spec: SimulationJobSpec, folders: dict[str, str], agent: RunningAgent) -> Row:
    case = plan(spec, Storage(folders)).cases[0]
    context = RunContext("lab/pr2", spec, folders, "pvc://results/r", str(agent.shared))
    return run_case(case, context)


def play_once(
    spec: SimulationJobSpec, folders: dict[str, str], agent: RunningAgent, case_number: int = 0
) -> dict[str, Any]:
    """The RESULT of one session, whatever its ledger says. Raises SessionError."""
    storage = Storage(folders)
    case = sorted(plan(spec, storage).cases, key=lambda case: case.id)[case_number]
    context = RunContext("lab/pr2", spec, folders, "pvc://results/r", str(agent.shared))
    deadline = time.monotonic() + 200
    with lease(agent.shared, deadline) as slot, open_ends(slot, deadline) as ends:
        files = [fragment_file(case, storage)]
        return run_session(ends, case_map(case, context), files, io.BytesIO(), deadline).result


SH = ["sh", "-c"]
ON_FIRE = [*SH, "echo the laser is on fire >&2; exit 3"]
# Command, outcome, reason and what its sentence holds. A run that can't begin is no failure.
STACKS = [
    (["flyby", "--fast"], "errored", "CommandNotFound", "flyby"),
    (ON_FIRE, "failed", "StackCrashed", "exit status 3"),
    ([*SH, "kill -SEGV $$"], "failed", "StackCrashed", "signal 11"),
    ([*SH, "exit 0"], "failed", "StackExited", "exit status 0"),
    (["sleep", "100"], "errored", "NeverSubscribed", "/joint_states"),
]


@pytest.mark.parametrize(
    ("command", "outcome", "reason", "words"), STACKS, ids=[s[2] + s[3] for s in STACKS]
)
def test_a_stack_that_fails_is_reported_with_a_sentence(
    command: list[str],
    outcome: str,
    reason: str,
    words: str,
    folders: dict[str, str],
    start_agent: Start,
) -> None:
    agent = start_agent()
    # Waited out by the stack that never subscribes alone: had the others to wait for it, that
    # would be their reason.
    patience = "5s" if reason == "NeverSubscribed" else "100s"
    row = run_one(spec_with({"subscribeTimeout": patience}, command=command), folders, agent)
    assert (row["outcome"], row["reason"], row["attempts"]) == (outcome, reason, 1)
    assert words in row["message"]
    if command == ON_FIRE:
        assert "the laser is on fire" in row["stderr"]
    agent.await_no_descendants()


def test_a_missing_rosmaster_is_reported(folders: dict[str, str], start_agent: Start) -> None:
    spec = spec_with(ros1={"master": "image"})
    row = run_one(spec, folders, start_agent(path="/usr/lib/robot_state_publisher"))
    assert (row["outcome"], row["reason"]) == ("errored", "RosMasterNotFound")
    assert "python3-rosmaster" in row["message"]


def test_the_cases_deadline_ends_a_stack_that_never_gets_ready(
    folders: dict[str, str], start_agent: Start
) -> None:
    agent = start_agent()
    timing = {"caseTimeout": "6s", "subscribeTimeout": "60s"}
    row = run_one(spec_with(timing, command=["sleep", "100"]), folders, agent)
    assert (row["outcome"], row["reason"]) == ("errored", "CaseDeadlineExceeded")
    assert row["attempts"] == 1
    agent.await_no_descendants()


def test_a_stack_that_ignores_sigterm_and_leaves_a_daemon_is_ended_whole(
    folders: dict[str, str], start_agent: Start
) -> None:
    agent = start_agent()
    stubborn = "trap '' TERM INT; setsid sleep 300 & exec robot_state_publisher"
    row = run_one(stepped(command=[*SH, stubborn]), folders, agent)
    assert (row["outcome"], row["attempts"]) == ("passed", 1), row
    agent.await_no_descendants()


def test_a_worker_that_dies_frees_the_slot_and_ends_the_stack(
    folders: dict[str, str], start_agent: Start
) -> None:
    agent = start_agent()
    spec = spec_with({"rate": 0.5})
    case = plan(spec, Storage(folders)).cases[0]
    context = RunContext("lab/pr2", spec, folders, "pvc://results/r", str(agent.shared))
    worker = os.fork()
    if worker == 0:
        run_case(case, context)
        os._exit(0)
    pause = threading.Event()
    deadline = time.monotonic() + 90
    while not any(_is_stack(pid) for pid in agent.descendants()):
        assert time.monotonic() < deadline, "the stack never started"
        pause.wait(0.05)
    os.kill(worker, signal.SIGKILL)
    os.waitpid(worker, 0)
    agent.await_no_descendants()
    assert play_once(spec_with(), folders, agent)["ledger"]["sent"] > 0


def _is_stack(pid: int) -> bool:
    try:
        return b"robot_state_publisher" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


def test_a_damaged_frame_is_refused_and_the_next_session_is_served(
    folders: dict[str, str], start_agent: Start
) -> None:
    agent = start_agent()
    deadline = time.monotonic() + 90
    with lease(agent.shared, deadline) as slot, open_ends(slot, deadline) as ends:
        hello = bytearray(Encoder().encode_fields(FrameType.HELLO, {"session": "0" * 32}))
        hello[-1] ^= 1
        os.write(ends.write, hello)
    assert play_once(spec_with(), folders, agent)["ledger"]["sent"] > 0


def test_a_chunk_damaged_on_the_way_names_the_users_own_byte_offset(
    folders: dict[str, str], start_agent: Start
) -> None:
    bag = Path(folders["recordings"]) / "pr2/joint_states.bag"
    data = bytearray(bag.resolve().read_bytes())
    data[180_000] ^= 0xFF
    bag.unlink()
    bag.write_bytes(data)
    with pytest.raises(SessionError) as failed:
        play_once(spec_with(), folders, start_agent(), case_number=1)
    assert failed.value.reason == "BagUnreadable"
    assert "joint_states.bag" in str(failed.value)
    assert "1787" in str(failed.value)


def test_a_killed_slot_is_met_again_by_the_next_attempt(
    folders: dict[str, str], start_agent: Start, tmp_path: Path
) -> None:
    agent = start_agent()
    rows: list[Row] = []
    # Until then the case can't end, however late it is seen.
    gate = tmp_path / "gate"
    waits = f"until [ -e {gate} ]; do sleep 0.05; done; exec robot_state_publisher"
    held = stepped(command=[*SH, waits])
    runner = threading.Thread(target=lambda: rows.append(run_one(held, folders, agent)))
    runner.start()
    try:
        wait_until(
            lambda: any(map(_is_stack, agent.descendants())), PATIENCE, "the stack never started"
        )
        os.kill(agent.slot_processes()[0], signal.SIGKILL)
    finally:
        gate.touch()
    runner.join(timeout=300)
    assert not runner.is_alive()
    killed, *again = [each["reason"] for each in rows[0]["discarded"]]
    # A worker that looks late has its frames read by the slot's next process.
    assert killed in {"AgentDied", "ProtocolError"}
    # The slot's pipes are there again before its process listens, or after it.
    assert again in ([], ["AgentDied"], ["ProtocolError"], ["SlotUnavailable"])
    assert (rows[0]["outcome"], rows[0]["attempts"]) == ("passed", 2 + len(again)), rows[0]
