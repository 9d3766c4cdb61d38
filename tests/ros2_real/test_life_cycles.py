"""Nodes with a life cycle that a job names: rclcpp's own, configured and activated in each way."""

import pytest

from bagpipe.run.case_run import Row
from tests.ros2_real.conftest import MESSAGES
from tests.ros2_real.jobs import LOCKSTEP, Trial, activating, ledger_of, passed

LIVING = "ros2 run bagpipe_nodes lifecycle --ros-args -p"


def run(trial: Trial, script: str, patience: str = "60s") -> Row:
    """The row of a job that waits for /living to be active."""
    playback = LOCKSTEP | {"subscribeTimeout": patience}
    stack = {"ros2": {"active": ["/living"]}}
    return trial.run(trial.spec(["bash", "-c", script], playback, stack=stack))


@pytest.mark.parametrize(
    "script",
    [f"exec {LIVING} by_itself:=true", activating(f"{LIVING} by_itself:=false", "/living")],
    ids=["by itself", "by another"],
)
def test_nothing_is_played_before_a_node_is_active(trial: Trial, script: str) -> None:
    row = run(trial, script)
    assert passed(row), row
    assert ledger_of(row) == (MESSAGES, MESSAGES, 0, "called")
    assert len(trial.texts(row)) == MESSAGES


def test_a_node_that_nobody_activates_is_named_with_its_state(trial: Trial) -> None:
    row = run(trial, f"exec {LIVING} by_itself:=false", "5s")
    assert (row["outcome"], row["reason"]) == ("errored", "NeverSubscribed"), row
    assert "for /living to be active (it is unconfigured)" in row["message"], row


def test_a_node_that_leaves_midway_fails_its_case(trial: Trial) -> None:
    row = run(trial, f"exec {LIVING} by_itself:=true -p leave_after:=20")
    assert (row["outcome"], row["reason"]) == ("failed", "NodeInactive"), row
    assert "/living, which stack.ros2.active names, has left the state active" in row["message"]
