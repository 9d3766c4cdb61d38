"""How nodes of ROS 2 end where neither kernel nor parent says it."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from bagpipe.run.case_run import Row
from tests import older_kernel, ros2_recording
from tests.integration.conftest import RunningAgent
from tests.integration.test_ros2_jobs import MESSAGES, run, spec
from tests.ros2_rclpy import wheels

pytestmark = pytest.mark.integration

NODES = Path(__file__).parent / "nodes"
ANSWERING = Path(__file__).parents[1] / "ros2_real/nodes/scripts/answering.py"


@pytest.fixture
def played(tmp_path: Path, start_agent: Callable[..., RunningAgent]) -> Callable[..., Row]:
    """The row of a case of these commands, one after the other, each the words behind `python`."""
    ros2 = wheels.installed()
    python = wheels.python(ros2)
    agent = start_agent(below=[sys.executable, older_kernel.__file__])
    folders = ros2_recording.claims(tmp_path, MESSAGES)

    def play(*commands: list[str]) -> Row:
        words = [python, str(NODES / "uninterested_parent.py")]
        for number, command in enumerate(commands):
            words += ["--"] * (number > 0) + [python, *command]
        # A queue has room for all of it: of losses these tests say nothing.
        job = spec(wheels.environment_for_all(ros2), {"mode": "max"}, words)
        return run(job, folders, agent)

    return play


def failing(status: int, messages: int) -> list[str]:
    return [str(NODES / "failing_node.py"), str(status), str(messages)]


@pytest.mark.parametrize(("status", "outcome"), [(3, "failed"), (0, "passed")])
def test_who_fails_behind_its_last_answer_has_crashed(
    status: int, outcome: str, played: Callable[..., Row]
) -> None:
    row = played(failing(status, MESSAGES))
    assert row["outcome"] == outcome, row
    if status:
        assert row["reason"] == "StackCrashed"
        assert "the node /failing ended with exit status 3" in row["message"]


@pytest.mark.parametrize(("status", "outcome"), [(1, "failed"), (0, "passed")])
def test_who_fails_before_the_play_has_crashed(
    status: int, outcome: str, played: Callable[..., Row]
) -> None:
    row = played(failing(status, 0), [str(ANSWERING), "--ros-args", "-p", f"depth:={MESSAGES}"])
    assert row["outcome"] == outcome, row
    if status:
        assert row["reason"] == "StackCrashed"
        assert "the node /failing ended with exit status 1 before the play began" in row["message"]
