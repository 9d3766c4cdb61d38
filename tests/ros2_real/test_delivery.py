"""What nodes of a real ROS 2 got is proved by their own counts, or is named as lost."""

import shlex
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

from tests import ros2_recording
from tests.ros2_real.conftest import MESSAGES
from tests.ros2_real.jobs import LOCKSTEP, NODE, PYTHON, Trial, ledger_of, passed
from tests.ros2_real.recordings import write_texts

ANSWERS = [{"name": "answers", "presence": {"topic": "/out", "min": MESSAGES}}]
REENTRANT = ["--ros-args", "-p", "reentrant:=true"]
# A point cloud's, more than a socket holds on most machines.
LARGE = 4_000_000
LARGE_ANSWERS = 20
# Who publishes by it waits for room in sockets.
HELD_BACK = "rmw_cyclonedds_cpp"
EXECUTORS = {
    "single": ["single", "Answering"],
    "multi": ["multi", "Answering", *REENTRANT],
    "events": ["events", "Answering"],
}


@pytest.mark.parametrize("executor", EXECUTORS)
@pytest.mark.parametrize("mode", ["max", "realtime"])
def test_all_that_is_sent_is_called_and_recorded(
    trial: Trial, require_executor: Callable[[str], None], mode: str, executor: str
) -> None:
    require_executor(executor)
    job = trial.spec([*NODE, *EXECUTORS[executor]], {"mode": mode}, evaluate=ANSWERS)
    row = trial.run(job)
    assert passed(row), row
    assert ledger_of(row) == (MESSAGES, MESSAGES, 0, "called")
    assert row["result"]["recorded"]["messages"] == MESSAGES


@pytest.mark.parametrize("threads", [1, 3])
def test_what_rclpy_takes_is_proved_as_taken(trial: Trial, threads: int) -> None:
    command = [*PYTHON, "--ros-args", "-p", f"threads:={threads}"]
    row = trial.run(trial.spec(command, {"mode": "max"}, evaluate=ANSWERS))
    assert passed(row), row
    assert ledger_of(row) == (MESSAGES, MESSAGES, 0, "taken")


@pytest.mark.parametrize("qos", [["best_effort:=true"], ["depth:=1"]])
def test_the_smallest_queue_loses_nothing_at_full_speed(trial: Trial, qos: list[str]) -> None:
    slow = ["-p", "work_us:=500", *(word for one in qos for word in ("-p", one))]
    job = trial.spec([*NODE, "single", "Answering", "--ros-args", *slow], {"mode": "max"})
    row = trial.run(job)
    assert passed(row), row
    assert ledger_of(row) == (MESSAGES, MESSAGES, 0, "called")
    assert len(trial.texts(row)) == MESSAGES


def test_what_a_queue_overwrites_is_lost_in_the_ledger(trial: Trial) -> None:
    """Every 5 ms a message, 20 ms for each, and room for two: most can't be called."""
    slow = ["--ros-args", "-p", "work_us:=20000", "-p", "depth:=2"]
    row = trial.run(trial.spec([*NODE, "single", "Answering", *slow], {"mode": "realtime"}))
    sent, received, dropped, strength = ledger_of(row)
    assert (row["outcome"], row["reason"]) != ("passed", None), row
    assert (sent, received + dropped) == (MESSAGES, MESSAGES)
    # Whether the last callback has ended when it is looked for is the machine's.
    assert strength in ("taken", "called")
    # What was called was answered, no more and no less.
    assert received == len(trial.texts(row))
    assert MESSAGES // 8 < received < MESSAGES // 2


def test_a_node_that_publishes_twice_is_recorded_twice(trial: Trial) -> None:
    command = [*NODE, "single", "Answering", "--ros-args", "-p", "copies:=2"]
    row = trial.run(trial.spec(command, {"mode": "max"}))
    assert passed(row), row
    texts = trial.texts(row)
    assert len(texts) == len(set(texts)) == 2 * MESSAGES


def test_messages_of_a_megabyte_arrive_whole(trial: Trial) -> None:
    recording = Path(trial.folders["recordings"]) / "drive.mcap"
    lengths = [1_000_000 + number for number in range(100)]
    write_texts(recording, {"/in": ("x" * length for length in lengths)})
    row = trial.run(trial.spec([*NODE, "single", "Passing"], {"mode": "max"}))
    assert passed(row), row
    assert ledger_of(row) == (100, 100, 0, "called")
    assert [int(text.split()[0]) for text in trial.texts(row)] == lengths


@pytest.mark.parametrize("best_effort", [True, False])
@pytest.mark.parametrize("playback", [{"mode": "max"}, LOCKSTEP])
def test_what_a_node_publishes_is_recorded_though_it_is_larger_than_a_socket(
    trial: Trial, playback: dict[str, Any], best_effort: bool
) -> None:
    recording = Path(trial.folders["recordings"]) / "drive.mcap"
    ros2_recording.write(recording, ["/in"], LARGE_ANSWERS)
    large = ["-p", f"bytes:={LARGE}", "-p", f"out_best_effort:={str(best_effort).lower()}"]
    command = [*NODE, "single", "Answering", "--ros-args", *large]
    if best_effort and playback == LOCKSTEP and trial.rmw != HELD_BACK:
        pytest.skip("an answer that does not come is waited for in each step")
    row = trial.run(trial.spec(command, playback))
    if best_effort and trial.rmw != HELD_BACK and not passed(row):
        assert row["reason"] == "RecordingIncomplete", row
        return
    assert passed(row), row
    assert ledger_of(row) == (LARGE_ANSWERS, LARGE_ANSWERS, 0, "called")
    assert [len(text) for text in trial.texts(row)] == [LARGE] * LARGE_ANSWERS


@pytest.mark.parametrize(
    ("by_itself", "reasons"),
    [
        (True, ["StackCrashed"]),
        # `ros2 run` is its parent: how it ended is known to whoever reads it first.
        (False, ["StackCrashed", "NodeGone"]),
    ],
)
def test_a_node_that_is_killed_fails_its_case(
    trial: Trial, prefix: Path, by_itself: bool, reasons: list[str]
) -> None:
    node = [str(prefix / "lib/bagpipe_nodes/node")] if by_itself else NODE
    command = [*node, "single", "Answering", "--ros-args", "-p", "die_after:=50"]
    row = trial.run(trial.spec(command, {"mode": "max"}))
    assert row["outcome"] == "failed", row
    assert row["reason"] in reasons, row


def test_a_node_that_nobody_counts_proves_nothing(trial: Trial) -> None:
    command = ["env", "-u", "LD_PRELOAD", *NODE, "single", "Answering"]
    row = trial.run(trial.spec(command, {"mode": "max"}))
    assert (row["outcome"], row["reason"]) == ("invalid", "DeliveryUnproved"), row
    assert "what /answering got on /in is proved no further than `sent`" in row["message"]


# A node that does not count, whose name another one has.
NAMESAKE = """
import rclpy
from sensor_msgs.msg import Imu
rclpy.init()
node = rclpy.create_node("answering")
publisher = node.create_publisher(Imu, "/out", 10)
rclpy.spin(node)
"""


@pytest.mark.parametrize("topics", [["/out"], ["/o.*"]])
def test_what_a_namesake_publishes_as_another_type_is_missed(
    trial: Trial, topics: list[str]
) -> None:
    beside = 'env -u LD_PRELOAD python3 -c "$0" & "$@"; wait'
    command = ["bash", "-c", beside, NAMESAKE, *NODE, "single", "Answering"]
    # Before it is there the play would be over.
    realtime = {"mode": "realtime", "rate": 0.2}
    row = trial.run(trial.spec(command, realtime, record={"topics": topics}))
    assert row["reason"] == "RecordingIncomplete", row
    # Which of them is recorded is by which one the graph has first.
    imu, string = "sensor_msgs/msg/Imu", "std_msgs/msg/String"
    others = (
        f"that do not count and publish it as {imu}, and it is recorded as {string}",
        f"/answering publishes /out as {string}, and it is recorded as {imu}",
    )
    assert any(other in row["message"] for other in others), row


def test_who_counts_and_publishes_nothing_as_another_type_is_missed_by_nobody(
    trial: Trial,
) -> None:
    """Else the graph had other GIDs than the ledger, and who counts would be missed."""
    other = NAMESAKE.replace("sensor_msgs", "std_msgs").replace("Imu", "UInt8")
    # The recorder takes the type of who is there when it looks.
    recorded = 'while not node.count_subscribers("/out"): time.sleep(0.02)\npublisher ='
    other = "import time" + other.replace("publisher =", recorded)
    command = ["bash", "-c", 'python3 -c "$0" & "$@"; wait', other, *NODE, "single", "Answering"]
    realtime = {"mode": "realtime", "rate": 0.2}
    row = trial.run(trial.spec(command, realtime, record={"topics": ["/out"]}))
    assert passed(row), row["message"]
    warnings = row["result"]["playback"].get("warnings", [])
    assert not any("a name that another has" in warning for warning in warnings), warnings


EITHER = pytest.mark.parametrize(
    ("node", "strength"),
    [([*NODE, "single", "Answering"], "called"), (PYTHON, "taken")],
    ids=["rclcpp", "rclpy"],
)
PUBLISH = "ros2 topic pub --rate 20 /in sensor_msgs/msg/Imu > /dev/null &"


@EITHER
@pytest.mark.parametrize("mode", ["max", "lockstep", "realtime"])
def test_what_the_stack_publishes_too_is_none_of_what_is_played(
    trial: Trial, node: list[str], strength: str, mode: str
) -> None:
    """Another node is there first, and publishes before the play and in it."""
    there = "until ros2 topic list --no-daemon | grep -qx /in; do :; done"
    both = f"{PUBLISH} {there}; exec {shlex.join(node)}"
    row = trial.run(trial.spec(["bash", "-c", both], {"mode": mode}))
    assert passed(row), row
    assert ledger_of(row) == (MESSAGES, MESSAGES, 0, strength)
    # It answers what the other publishes as well.
    assert row["result"]["recorded"]["messages"] > MESSAGES


@EITHER
@pytest.mark.parametrize("mode", ["max", "lockstep"])
def test_who_begins_to_publish_late_makes_no_loss(
    trial: Trial, node: list[str], strength: str, mode: str
) -> None:
    """What it publishes before it and the node know each other reaches nobody."""
    row = trial.run(
        trial.spec(["bash", "-c", f"{PUBLISH} exec {shlex.join(node)}"], {"mode": mode})
    )
    assert passed(row), row
    assert ledger_of(row) == (MESSAGES, MESSAGES, 0, strength)


def test_late_subscribers_of_latched_topics_get_them(trial: Trial) -> None:
    """A recorded one comes to the node, and what the node published first is recorded."""
    recording = Path(trial.folders["recordings"]) / "drive.mcap"
    latched = (
        "- history: keep_last\n  depth: 1\n  reliability: reliable\n  durability: transient_local\n"
    )
    write_texts(recording, {"/in": ["map"]}, latched)
    command = [*NODE, "single", "Keeping", "--ros-args", "-p", "settings:=seven"]
    job = trial.spec(command, {"mode": "max"}, record={"topics": ["/out", "/settings"]})
    row = trial.run(job)
    assert passed(row), row
    assert ledger_of(row) == (1, 1, 0, "called")
    assert (trial.texts(row), trial.texts(row, "/settings")) == (["map"], ["seven"])


@pytest.mark.parametrize(
    "command", [[*NODE, "single", "Answering"], PYTHON], ids=["rclcpp", "rclpy"]
)
def test_on_dds_alone_the_same_bytes_are_played_and_recorded(
    trial: Trial, command: Iterable[str]
) -> None:
    digests = set()
    for player in ("rcl", "dds"):
        row = trial.run(trial.spec(command, LOCKSTEP, stack={"ros2": {"player": player}}))
        assert passed(row), row
        assert row["result"]["player"]["name"] == player
        assert ledger_of(row)[:3] == (MESSAGES, MESSAGES, 0)
        digests.add(trial.digest(row))
    assert len(digests) == 1
