"""The real agent as a process, with slots below a folder of the test's own."""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest

from bagpipe.plan.case import Case
from bagpipe.run import case_run
from bagpipe.run.case_run import RunContext, case_map
from bagpipe.run.master_ports import master_ports
from bagpipe.wire.hello_case import HelloCase
from tests import ros2_standin
from tests.agent_binary import built
from tests.processes import below

ROOT = Path(__file__).parents[2]
# Reached in failure only: the agent ends within 5 s, and a stack within its grace, where nothing
# else wants the processors.
_PATIENCE_SECONDS = 90


@dataclass(frozen=True)
class RunningAgent:
    """A serving agent: its shared folder, its process, and the log it writes."""

    shared: Path
    process: subprocess.Popen[bytes]
    log: Path

    def descendants(self) -> list[int]:
        """Every process below the agent's own slots: what its cases started and did not end."""
        return [pid for pid in below(self.process.pid) if not _is_agent(pid)]

    def await_no_descendants(self, seconds: float = _PATIENCE_SECONDS) -> None:
        """Wait until nothing is left of the cases; fails after `seconds`."""
        deadline = time.monotonic() + seconds
        pause = threading.Event()
        while self.descendants():
            assert time.monotonic() < deadline, self.descendants()
            pause.wait(0.05)

    def slot_processes(self) -> list[int]:
        """The agent's own processes, one for each slot."""
        return [pid for pid in below(self.process.pid) if _is_agent(pid)]


@pytest.fixture(scope="session")
def agent_binary() -> Path:
    """The static agent, built as the images build it."""
    return built()


@pytest.fixture(scope="session")
def standin() -> Path:
    """The folder of the stand-in of ROS 2."""
    return ros2_standin.built()


@pytest.fixture
def start_agent(agent_binary: Path, tmp_path: Path) -> Iterator[Callable[..., RunningAgent]]:
    """Start an agent with a number of slots; it is ended after the test."""
    started: list[RunningAgent] = []
    ports = ExitStack()

    def start(
        slots: int = 1, path: str | None = None, *options: str, below: Sequence[str] = ()
    ) -> RunningAgent:
        shared = tmp_path / f"shared{len(started)}"
        shared.mkdir()
        log = tmp_path / f"agent{len(started)}.log"
        environment = dict(os.environ)
        # Debian's ROS tools are scripts of Debian's Python, not of the tests' environment.
        environment["PATH"] = path or "/usr/lib/robot_state_publisher:/usr/bin:/bin"
        # What ROS writes in a case whose slot is killed stays with the test.
        environment["TMPDIR"] = str(tmp_path)
        # A command that becomes the one behind it.
        command = [
            *below,
            str(agent_binary),
            "serve",
            "--shared",
            str(shared),
            "--slots",
            str(slots),
        ]
        port = ports.enter_context(master_ports(slots))
        with log.open("wb") as output:
            process = subprocess.Popen(
                [*command, "--master-port", str(port), *options],
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )
        agent = RunningAgent(shared, process, log)
        started.append(agent)
        _await_ready(agent_binary, agent)
        return agent

    with ports:
        yield start
        for agent in started:
            agent.process.send_signal(signal.SIGTERM)
            agent.process.wait(timeout=_PATIENCE_SECONDS)


def _await_ready(binary: Path, agent: RunningAgent) -> None:
    deadline = time.monotonic() + _PATIENCE_SECONDS
    pause = threading.Event()
    while subprocess.run([binary, "ready", "--shared", agent.shared], check=False).returncode:
        assert agent.process.poll() is None, agent.log.read_text()
        assert time.monotonic() < deadline, agent.log.read_text()
        pause.wait(0.02)


def _is_agent(pid: int) -> bool:
    try:
        return b"bagpipe-agent" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return True


@pytest.fixture
def soon_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cases of which the first node is waited for 2 s in place of 30."""

    def described(case: Case, context: RunContext) -> HelloCase:
        hello = case_map(case, context)
        hello["deadlines"]["start"] = 2.0
        return hello

    monkeypatch.setattr(case_run, "case_map", described)
