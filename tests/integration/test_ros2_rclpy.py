"""Jobs of nodes of the real rclpy over the real librcl and Fast DDS, from PyPI."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests import rclpy_wheels, ros2_recording
from tests.integration.conftest import RunningAgent
from tests.integration.test_ros2_jobs import ALL, LOCKSTEP, MESSAGES, digest, run, spec

pytestmark = pytest.mark.integration

NODES = Path(__file__).parents[1] / "ros2_real/nodes/scripts"
MAX = {"mode": "max"}
REALTIME = {"mode": "realtime"}
# How far what it takes is proved: rclpy has no tracepoints; in lock-step each input was answered.
STRENGTHS = {"max": "taken", "realtime": "taken", "lockstep": "called"}


@pytest.fixture(scope="session")
def ros2() -> Path:
    return rclpy_wheels.installed()


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    return ros2_recording.claims(tmp_path, MESSAGES)


def answering(ros2: Path, *arguments: str) -> list[str]:
    """A node that answers each message of /in on /out."""
    words = [rclpy_wheels.python(ros2), str(NODES / "answering.py")]
    return [*words, "--ros-args", *arguments] if arguments else words


@pytest.mark.parametrize("playback", [MAX, LOCKSTEP, REALTIME], ids=lambda of: of["mode"])
@pytest.mark.parametrize("player", ["rcl", "dds"])
def test_all_that_is_sent_is_taken_and_recorded(
    player: str,
    playback: dict[str, Any],
    folders: dict[str, str],
    ros2: Path,
    start_agent: Callable[..., RunningAgent],
) -> None:
    setup = {"rcl": rclpy_wheels.environment_for_all, "dds": rclpy_wheels.environment}[player]
    row = run(spec(setup(ros2), playback, answering(ros2), evaluate=ALL), folders, start_agent())
    assert (row["outcome"], row["attempts"]) == ("passed", 1), row
    ledger = row["result"]["ledger"]
    assert (ledger["sent"], ledger["received"], ledger["dropped"]) == (MESSAGES, MESSAGES, 0)
    assert ledger["strength"] == STRENGTHS[playback["mode"]]
    assert row["result"]["recorded"]["messages"] == MESSAGES
    assert row["result"]["player"]["name"] == player


def test_lock_step_records_the_same_bytes_each_time(
    folders: dict[str, str], ros2: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    agent = start_agent()
    command = answering(ros2, "-p", "use_sim_time:=true")
    job = spec(rclpy_wheels.environment_for_all(ros2), LOCKSTEP, command)
    digests = set()
    for _ in range(3):
        row = run(job, folders, agent)
        assert (row["outcome"], row["attempts"]) == ("passed", 1), row
        assert row["result"]["playback"]["steps"][0]["answered"] == MESSAGES
        digests.add(digest(row, folders))
    assert len(digests) == 1


def test_who_sleeps_by_the_clock_has_lost_what_its_queue_of_ten_had_no_room_for(
    folders: dict[str, str], ros2: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    """200 messages a second, and its first two callbacks sleep for 0.4 s each."""
    command = answering(ros2, "-p", "sleeps:=2")
    job = spec(rclpy_wheels.environment_for_all(ros2), REALTIME, command)
    row = run(job, folders, start_agent())
    assert (row["outcome"], row["reason"]) == ("failed", "MessagesLost"), row
    ledger = row["result"]["ledger"]
    assert ledger["received"] + ledger["dropped"] == ledger["sent"] == MESSAGES
    # It answers what it takes, once each, and never anything else.
    assert ledger["received"] == row["result"]["recorded"]["messages"]
    assert ledger["dropped"] >= 2 * (0.4 * 200 - 10) - 40


def test_two_nodes_of_one_name_are_a_line_each_and_both_are_recorded(
    folders: dict[str, str], ros2: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    one, other = answering(ros2), answering(ros2, "-r", "out:=out_other")
    both = " ".join(one) + " & exec " + " ".join(other)
    job = spec(
        rclpy_wheels.environment_for_all(ros2),
        MAX,
        ["bash", "-c", both],
        record={"topics": ["/out.*"]},
    )
    row = run(job, folders, start_agent())
    assert (row["outcome"], row["attempts"]) == ("passed", 1), row
    lines = row["result"]["ledger"]["topics"][0]["subscribers"]
    assert [(one["received"], one["dropped"]) for one in lines] == [(MESSAGES, 0)] * 2
    recorded = row["result"]["recorded"]["topics"]
    assert {one["topic"]: one["messages"] for one in recorded} == {
        "/out": MESSAGES,
        "/out_other": MESSAGES,
    }


def test_a_node_that_nobody_counts_proves_nothing(
    folders: dict[str, str], ros2: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    command = ["env", "-u", "LD_PRELOAD", *answering(ros2)]
    row = run(spec(rclpy_wheels.environment(ros2), MAX, command), folders, start_agent())
    assert (row["outcome"], row["reason"]) == ("invalid", "DeliveryUnproved"), row
    assert "what /answering got on /in is proved no further than `sent`" in row["message"]
