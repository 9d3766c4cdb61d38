"""What is written of a case where ROS 2's security is on; the stand-in has none, and refuses."""

from collections.abc import Callable
from pathlib import Path

import pytest

from bagpipe.spec import SimulationJobSpec
from tests import ros2_recording, ros2_standin
from tests.integration.conftest import RunningAgent
from tests.integration.test_ros2_jobs import relay, run, spec

pytestmark = pytest.mark.integration


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    return ros2_recording.claims(tmp_path, 5)


def secured(
    standin: Path, strategy: str, command: list[str], player: str = "auto", timeout: str = "60s"
) -> SimulationJobSpec:
    setup = ros2_standin.environment(standin)
    setup |= {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": strategy}
    playback = {"mode": "max", "subscribeTimeout": timeout}
    return spec(setup, playback, command, stack={"ros2": {"player": player}})


def test_a_node_that_is_refused_names_the_domains_that_its_keys_must_be_for(
    folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    row = run(secured(standin, "Enforce", relay(standin)), folders, start_agent())
    # The node may be there for a moment, so that a player joins it, and is refused as well.
    allowed = {"StackCrashed": "the domains 1 to 101", "Ros2Failed": "let it into domain"}
    assert "ROS_SECURITY_ENABLE is true" in row["message"], row
    assert allowed[row["reason"]] in row["message"], row


@pytest.mark.parametrize(
    ("player", "end"),
    [("dds", "let stack.ros2.player be rcl"), ("rcl", "keep the player apart")],
)
def test_where_nobody_subscribes_security_may_be_why(
    player: str,
    end: str,
    folders: dict[str, str],
    standin: Path,
    start_agent: Callable[..., RunningAgent],
) -> None:
    bare = [str(standin / "standin_node"), "--name", "/bare"]
    row = run(secured(standin, "Permissive", bare, player, "2s"), folders, start_agent())
    assert (row["outcome"], row["reason"]) == ("errored", "NeverSubscribed"), row
    assert row["message"].split("; its last line")[0].endswith(end), row
