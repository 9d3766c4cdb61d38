"""Jobs of nodes of the real rclpy over the real librcl and Fast DDS, from PyPI."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from rosbags.rosbag1 import Writer as Bag
from rosbags.typesys import Stores, get_typestore

from bagpipe.cli.__main__ import main
from tests import ros2_recording
from tests.integration.conftest import RunningAgent
from tests.integration.test_ros2_jobs import ALL, LOCKSTEP, MESSAGES, digest, run, spec
from tests.ros2_rclpy import wheels

pytestmark = pytest.mark.integration

NODES = Path(__file__).parents[1] / "ros2_real/nodes/scripts"
HEADER = "std_msgs/msg/Header"
MAX = {"mode": "max"}
REALTIME = {"mode": "realtime"}
# How far what it takes is proved: rclpy has no tracepoints; in lock-step each input was answered.
STRENGTHS = {"max": "taken", "realtime": "taken", "lockstep": "called"}


@pytest.fixture(scope="session")
def ros2() -> Path:
    return wheels.installed()


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    return ros2_recording.claims(tmp_path, MESSAGES)


def answering(ros2: Path, *arguments: str) -> list[str]:
    """A node that answers each message of /in on /out."""
    words = [wheels.python(ros2), str(NODES / "answering.py")]
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
    setup = {"rcl": wheels.environment_for_all, "dds": wheels.environment}[player]
    # By the clock, no pause of the machine overwrites anything in a queue that has room for all.
    depth = MESSAGES if playback is REALTIME else 10
    command = answering(ros2, "-p", f"depth:={depth}")
    row = run(spec(setup(ros2), playback, command, evaluate=ALL), folders, start_agent())
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
    job = spec(wheels.environment_for_all(ros2), LOCKSTEP, command)
    digests = set()
    for _ in range(3):
        row = run(job, folders, agent)
        assert (row["outcome"], row["attempts"]) == ("passed", 1), row
        assert row["result"]["playback"]["steps"][0]["answered"] == MESSAGES
        digests.add(digest(row, folders))
    assert len(digests) == 1


@pytest.mark.alone
def test_who_sleeps_by_the_clock_has_lost_what_its_queue_of_ten_had_no_room_for(
    folders: dict[str, str], ros2: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    """200 messages a second, and its first two callbacks sleep for 0.4 s each."""
    command = answering(ros2, "-p", "sleeps:=2")
    job = spec(wheels.environment_for_all(ros2), REALTIME, command)
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
        wheels.environment_for_all(ros2),
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


def test_a_drive_of_ros_1_is_played_once_its_messages_are_those_of_ros_2(
    folders: dict[str, str], ros2: Path, start_agent: Callable[..., RunningAgent], tmp_path: Path
) -> None:
    old = get_typestore(Stores.ROS1_NOETIC)
    imu = get_typestore(Stores.ROS2_HUMBLE)
    stamps = [ros2_recording.BEGIN + number * 5_000_000 for number in range(MESSAGES)]
    with Bag(tmp_path / "drive.bag") as bag:
        connection = bag.add_connection("/in", ros2_recording.IMU, typestore=old)
        for number, stamp in enumerate(stamps):
            message: Any = imu.deserialize_cdr(
                ros2_recording.imu(stamp, number), ros2_recording.IMU
            )
            header = old.types[HEADER](number, message.header.stamp, "imu")
            message = dataclasses.replace(message, header=header)
            bag.write(connection, stamp, old.serialize_ros1(message, ros2_recording.IMU))
    target = Path(folders["recordings"], "drive.mcap")
    target.unlink()
    words = ["bag", "convert", str(tmp_path / "drive.bag"), "--to", str(target)]
    made = CliRunner().invoke(main, [*words, "--messages", "ros2"])
    assert made.exit_code == 0, made.output
    row = run(
        spec(wheels.environment_for_all(ros2), LOCKSTEP, answering(ros2)),
        folders,
        start_agent(),
    )
    assert (row["outcome"], row["attempts"]) == ("passed", 1), row
    recorded = Path(folders["results"], "r", row["recorded"])
    kind = "std_msgs/msg/String"
    with recorded.open("rb") as stream:
        answers: list[Any] = [
            imu.deserialize_cdr(message.data, kind)
            for _, _, message in make_reader(stream).iter_messages()
        ]
    assert [answer.data for answer in answers] == [
        f"{stamp} {number:f}" for number, stamp in enumerate(stamps)
    ]


def test_a_node_that_nobody_counts_proves_nothing(
    folders: dict[str, str], ros2: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    command = ["env", "-u", "LD_PRELOAD", *answering(ros2)]
    row = run(spec(wheels.environment(ros2), MAX, command), folders, start_agent())
    assert (row["outcome"], row["reason"]) == ("invalid", "DeliveryUnproved"), row
    assert "what /answering got on /in is proved no further than `sent`" in row["message"]


OTHERS = Path(__file__).parent / "nodes"


@pytest.mark.parametrize(
    ("distribution", "playback", "wanted"),
    [
        ("jazzy", MAX, ("passed", "")),
        # Where it is not known that more than 32 places can be looked at, none are.
        ("humble", MAX | {"subscribeTimeout": "5s"}, ("errored", "NeverSubscribed")),
    ],
)
def test_nodes_meet_behind_the_places_at_which_ros_2_looks_by_itself(
    distribution: str,
    playback: dict[str, Any],
    wanted: tuple[str, str],
    folders: dict[str, str],
    ros2: Path,
    start_agent: Callable[..., RunningAgent],
) -> None:
    python, crowd = wheels.python(ros2), str(OTHERS / "crowded_domain.py")
    first = [python, str(OTHERS / "passing_on.py")]
    # The first sends as fast as it takes.
    second = answering(ros2, "-r", "in:=between", "-p", f"depth:={MESSAGES}")
    both = " ".join(first) + " & exec " + " ".join(second)
    setup = wheels.environment_for_all(ros2) | {"ROS_DISTRO": distribution}
    job = spec(setup, playback, [python, crowd, "bash", "-c", both], evaluate=ALL)
    row = run(job, folders, start_agent())
    assert (row["outcome"], row["reason"]) == wanted, row
