"""What becomes of a drive whose stack does not steer, steers nonsense, or dies; or its worker."""

import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bagpipe.run.case_run import Row, run_case
from tests.integration.conftest import RunningAgent
from tests.integration.drives import PATH, PYTHON, cases_of, context_of, spec_with
from tests.waiting import PATIENCE

pytestmark = pytest.mark.integration

Start = Callable[..., RunningAgent]

# A node that receives the odometry and then does what the test says.
NODE = """
import os, rospy, sys, time
from geometry_msgs.msg import Twist, PointStamped
from nav_msgs.msg import Odometry
rospy.init_node("node")
received = [0]
def on_odometry(odometry):
    received[0] += 1
    {body}
commands = rospy.Publisher("/cmd", {kind}, queue_size=10)
rospy.Subscriber("/ego/odom", Odometry, on_odometry)
rospy.spin()
"""
# Time enough for a node on a busy machine to answer in.
STEP = {"trigger": "/ego/odom", "answer": "/cmd", "deadline": "60s"}
# Of a node that does not: each step costs so much.
BRIEFLY = {"deadline": "50ms"}


def drive(
    agent: RunningAgent, folder: Path, body: str, kind: str = "Twist", **playback: Any
) -> Row:
    """One case of ten simulated seconds with that node as its stack."""
    spec = spec_with(
        stack={"image": "x", "command": [PYTHON, "-c", NODE.format(body=body, kind=kind)]},
        playback={"mode": "lockstep", "steps": [STEP], "subscribeTimeout": "60s"} | playback,
        evaluate=[],
    )
    return run_case(cases_of(spec)[0], context_of(spec, agent, folder))


def test_a_stack_that_never_answers_ends_with_a_reason(tmp_path: Path, start_agent: Start) -> None:
    row = drive(start_agent(path=PATH), tmp_path, "pass", steps=[STEP | BRIEFLY])
    assert (row["outcome"], row["reason"], row["attempts"]) == ("errored", "StackNeverAnswered", 1)
    assert "did not answer on /cmd in 20 steps in a row, up to 2 s of the drive" in row["message"]


def test_a_stack_that_may_be_silent_and_is_proves_nothing(
    tmp_path: Path, start_agent: Start
) -> None:
    steps = [STEP | {"optional": True, "deadline": "2ms"}]
    row = drive(start_agent(path=PATH), tmp_path, "pass", steps=steps)
    assert (row["outcome"], row["reason"]) == ("invalid", "NothingAnswered"), row
    assert row["result"]["playback"]["steps"][0]["skipped"] == 100


def test_an_answer_that_is_missing_now_and_then_is_counted(
    tmp_path: Path, start_agent: Start
) -> None:
    body = "received[0] % 40 and commands.publish(Twist())"
    # Two answers are waited for in vain; the others must not come later than this.
    row = drive(start_agent(path=PATH), tmp_path, body, steps=[STEP | {"deadline": "20s"}])
    assert row["outcome"] == "passed", row
    (step,) = row["result"]["playback"]["steps"]
    assert (step["released"], step["answered"], step["no_output"]) == (100, 98, 2)


def test_the_error_of_a_stack_without_control_messages_lists_their_types(
    tmp_path: Path, start_agent: Start
) -> None:
    row = drive(
        start_agent(path=PATH), tmp_path, "commands.publish(PointStamped())", "PointStamped"
    )
    assert (row["outcome"], row["reason"]) == ("errored", "BadControl")
    assert "publishes geometry_msgs/PointStamped on /cmd, and the simulator obeys" in row["message"]


def test_a_wish_that_is_no_number_is_an_error(tmp_path: Path, start_agent: Start) -> None:
    body = "t = Twist(); t.linear.x = float('nan'); commands.publish(t)"
    row = drive(start_agent(path=PATH), tmp_path, body)
    assert (row["outcome"], row["reason"]) == ("errored", "BadControl")
    assert "asks for the speed nan" in row["message"]


def test_a_stack_that_dies_in_the_middle_is_reported_with_its_last_lines(
    tmp_path: Path, start_agent: Start
) -> None:
    body = """commands.publish(Twist())
    if received[0] == 30:
        sys.stderr.write("the brakes are on fire\\n"); sys.stderr.flush(); os._exit(3)"""
    agent = start_agent(path=PATH)
    begun = time.monotonic()
    row = drive(agent, tmp_path, body)
    assert (row["outcome"], row["reason"], row["attempts"]) == ("failed", "StackCrashed", 1)
    assert "the brakes are on fire" in row["message"]
    assert time.monotonic() - begun < PATIENCE
    agent.await_no_descendants()


def test_a_stack_that_is_not_there_is_named(tmp_path: Path, start_agent: Start) -> None:
    spec = spec_with(stack={"image": "x", "command": ["no-such-planner"]})
    row = run_case(cases_of(spec)[0], context_of(spec, start_agent(path=PATH), tmp_path))
    assert (row["outcome"], row["reason"]) == ("errored", "CommandNotFound")


def test_a_worker_that_dies_in_the_middle_leaves_a_free_slot_and_no_stack(
    tmp_path: Path, start_agent: Start
) -> None:
    agent = start_agent(path=PATH)
    mark = tmp_path / "driving"
    # Each answer takes 20 ms, so the drive is still under way when the mark is seen.
    body = f"open({str(mark)!r}, 'w'); time.sleep(0.02); commands.publish(Twist())"
    worker = os.fork()
    if worker == 0:
        drive(agent, tmp_path, body)
        os._exit(0)
    deadline, pause = time.monotonic() + 90, threading.Event()
    while not mark.exists():
        assert time.monotonic() < deadline, "the stack never received anything"
        pause.wait(0.01)
    os.kill(worker, signal.SIGKILL)
    os.waitpid(worker, 0)
    agent.await_no_descendants()
    spec = spec_with()
    row = run_case(cases_of(spec)[0], context_of(spec, agent, tmp_path))
    assert row["outcome"] == "passed", row
