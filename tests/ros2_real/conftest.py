"""An agent beside a real ROS 2, once for each middleware that is installed."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests import ros2_recording
from tests.agent_binary import built as built_agent
from tests.integration.conftest import RunningAgent
from tests.ros2_real import nodes
from tests.ros2_real.agent import agent
from tests.ros2_real.jobs import NODE, Trial
from tests.ros2_real.place import NowhereError, Place, found

MESSAGES = 400
UNKNOWN_EXECUTOR = 2


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
def require_executor(place: Place, prefix: Path) -> Callable[[str], None]:
    """Skips the test where rclcpp has no executor of a name, as Humble has none of events."""

    def require(name: str) -> None:
        done = place.run([*NODE, name], prefix)
        if done.returncode == UNKNOWN_EXECUTOR:
            pytest.skip(f"rclcpp has no executor {name} here")
        assert done.returncode == 0, done.stderr

    return require


@pytest.fixture
def start_agent(
    place: Place, prefix: Path, agent_binary: Path, tmp_path: Path
) -> Iterator[Callable[..., RunningAgent]]:
    """Starts an agent where ROS 2 is, with a number of slots; it is ended after the test."""
    with ExitStack() as stack:
        yield lambda slots=1: stack.enter_context(
            agent(place, prefix, agent_binary, tmp_path, slots)
        )


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    """Claims, with 400 messages of /in, 5 ms after each other, as drive.mcap."""
    return ros2_recording.claims(tmp_path, MESSAGES)


@pytest.fixture
def trial(folders: dict[str, str], start_agent: Callable[..., RunningAgent], rmw: str) -> Trial:
    """One slot."""
    return Trial(folders, start_agent(), rmw)
