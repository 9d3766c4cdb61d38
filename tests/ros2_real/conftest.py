"""An agent beside a real ROS 2, once for each middleware that is installed."""

import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from bagpipe.run.master_ports import master_ports
from tests import ros2_recording
from tests.agent_binary import built as built_agent
from tests.integration.conftest import RunningAgent
from tests.ros2_real import nodes
from tests.ros2_real.jobs import Trial
from tests.ros2_real.place import NowhereError, Place, found

_PATIENCE_SECONDS = 90
MESSAGES = 400


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "rmw" in metafunc.fixturenames:
        metafunc.parametrize("rmw", _middlewares(), scope="session")


def _middlewares() -> list[Any]:
    try:
        rmws = found().rmws()
    except NowhereError as error:
        # `make test-ros2` does not come here; who runs all that pytest finds goes on without it.
        return [pytest.param("none", marks=pytest.mark.skip(reason=str(error)))]
    assert rmws, "the ROS 2 has no middleware that is known here: set RMW_IMPLEMENTATION"
    return list(rmws)


@pytest.fixture(scope="session")
def place() -> Place:
    """Where ROS 2 is."""
    return found()


@pytest.fixture(scope="session")
def agent_binary() -> Path:
    """The static agent, built as the images build it."""
    return built_agent()


@pytest.fixture(scope="session")
def prefix(place: Place) -> Path:
    """Where the trial's nodes are installed."""
    return nodes.built(place)


@pytest.fixture
def start_agent(
    place: Place, prefix: Path, agent_binary: Path, tmp_path: Path
) -> Iterator[Callable[..., RunningAgent]]:
    """Starts an agent where ROS 2 is, with a number of slots; it is ended after the test."""
    started: list[RunningAgent] = []
    with ExitStack() as ports:

        def start(slots: int = 1) -> RunningAgent:
            shared = tmp_path / f"shared{len(started)}"
            shared.mkdir()
            port = ports.enter_context(master_ports(slots))
            words = [str(agent_binary), "serve", "--shared", str(shared), "--slots", str(slots)]
            folders = [tmp_path, agent_binary.parent]
            command = place.command([*words, "--master-port", str(port)], prefix, folders)
            log = tmp_path / f"agent{len(started)}.log"
            with log.open("wb") as output:
                process = subprocess.Popen(
                    command,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    env=place.environment() | {"TMPDIR": str(tmp_path)},
                    start_new_session=True,
                )
            agent = RunningAgent(shared, process, log)
            started.append(agent)
            _await_ready(agent_binary, agent)
            return agent

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
        pause.wait(0.05)


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    """Claims, with 400 messages of /in, 5 ms after each other, as drive.mcap."""
    claims = {name: tmp_path / name for name in ("recordings", "results")}
    for path in claims.values():
        path.mkdir()
    ros2_recording.write(claims["recordings"] / "drive.mcap", ["/in"], MESSAGES)
    return {name: str(path) for name, path in claims.items()}


@pytest.fixture
def trial(folders: dict[str, str], start_agent: Callable[..., RunningAgent], rmw: str) -> Trial:
    """One slot."""
    return Trial(folders, start_agent(), rmw)
