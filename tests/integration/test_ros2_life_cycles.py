"""Jobs that name nodes with a life cycle: the worker, the real agent, and the stand-in's node."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bagpipe.run.case_run import Row
from tests import ros2_recording, ros2_standin
from tests.integration.conftest import RunningAgent
from tests.integration.test_ros2_jobs import ALL, LOCKSTEP, MESSAGES, relay, run, spec

pytestmark = pytest.mark.integration


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    return ros2_recording.claims(tmp_path, MESSAGES)


@pytest.fixture
def played(
    folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> Callable[..., Row]:
    """Plays to a relay with these options, in a job with these fields."""

    def play(*options: str, **fields: Any) -> Row:
        stack = {"ros2": {"active": ["/relay"]}}
        setup = ros2_standin.environment(standin)
        command = relay(standin, *options)
        whole = {"stack": stack, "evaluate": ALL} | fields
        return run(spec(setup, LOCKSTEP, command, **whole), folders, start_agent())

    return play


def test_a_node_that_is_active_gets_all(played: Callable[..., Row]) -> None:
    row = played("--life-cycle", "active")
    assert (row["outcome"], row["attempts"]) == ("passed", 1), row
    ledger = row["result"]["ledger"]
    assert (ledger["sent"], ledger["received"], ledger["strength"]) == (
        MESSAGES,
        MESSAGES,
        "called",
    )


def test_a_node_that_leaves_midway_fails_its_case_and_is_named(played: Callable[..., Row]) -> None:
    row = played("--life-cycle", "active", "--leave-after", "20")
    assert (row["outcome"], row["reason"]) == ("failed", "NodeInactive"), row
    assert "/relay, which stack.ros2.active names, has left the state active" in row["message"]


def test_a_job_may_have_such_a_case_tried_again(played: Callable[..., Row]) -> None:
    rules = [{"cause": "NodeInactive", "action": "retry", "retries": 1}]
    row = played("--life-cycle", "active", "--leave-after", "20", faultPolicy=rules)
    assert (row["reason"], row["attempts"]) == ("NodeInactive", 2), row


def test_where_dds_plays_no_node_can_be_waited_for(
    folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    package, _, kind = ros2_recording.IMU.split("/")
    command = [str(standin / "dds_relay"), "/in", "/out", f"{package}/{kind}", "16", "/ns/relay"]
    stack = {"ros2": {"active": ["/ns/relay"]}}
    job = spec({"LD_LIBRARY_PATH": "/nowhere"}, {"mode": "max"}, command, stack=stack)
    row = run(job, folders, start_agent())
    assert (row["outcome"], row["reason"]) == ("errored", "Ros2Failed"), row
    assert (
        "stack.ros2.active names /ns/relay, whose state the image's librcl alone" in row["message"]
    )
