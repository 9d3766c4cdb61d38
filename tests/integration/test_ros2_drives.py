"""Simulated drives that ROS 2 nodes steer: the worker's world, the real agent, and a node of the
stand-in, which speaks CDR over Debian's Cyclone DDS.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

import bagpipe
from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.simulator.model import START, Simulator
from bagpipe.simulator.scenario import Scenario
from bagpipe.simulator.serialisation import CDR
from bagpipe.simulator.world import Steering, World
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests import ros2_recording, ros2_standin
from tests.integration.conftest import RunningAgent
from tests.ros2_recording import IMU, imu
from tests.waiting import patient

pytestmark = pytest.mark.integration

STEPS = 60
STEP = {"trigger": "/ego/odom", "answer": "/cmd"}
ODOMETRY = "nav_msgs/msg/Odometry"
TWIST = "geometry_msgs/msg/Twist"


def driver(standin: Path, answer: str = TWIST, work: str = "--steer") -> list[str]:
    """A node that publishes a wish after each odometry, faster each time."""
    topics = ["--sub", f"/ego/odom:{ODOMETRY}:10:reliable", "--pub", f"/cmd:{answer}:10:reliable"]
    return [str(standin / "standin_node"), "--name", "/driver", *topics, work, "/ego/odom=/cmd"]


def drive(
    command: list[str], standin: Path, folder: Path, agent: RunningAgent, *beside: dict[str, Any]
) -> Row:
    """The row of a drive with a barrier on the road, 8 m ahead, and with recorded topics."""
    setup = ros2_standin.environment(standin)
    spec = SimulationJobSpec.model_validate(patient({
        "source": {
            "simulator": {
                "duration": f"{STEPS / 10:g}s",
                "ego": {"speed": 10},
                "scene": {"barriers": [{"x": 8, "y": 0}]},
                "recorded": list(beside),
            }
        },
        "stack": {
            "engine": "ros2",
            "image": "registry.example/driver:1",
            "command": command,
            "env": [{"name": name, "value": value} for name, value in setup.items()],
        },
        "playback": {"mode": "lockstep", "steps": [STEP]},
        "record": {"topics": ["/cmd", "/ego/odom", "/in"]},
        "evaluate": [
            {"name": "safe", "expression": {"topic": "/ego/collision", "holds": "!msg.data"}}
        ],
        "output": {"uri": "pvc://results/r"},
    }))  # fmt: skip
    claims = {"results": str(folder), "recordings": str(folder)}
    (case,) = plan(spec, Storage(claims)).cases
    row = run_case(
        case, RunContext("lab/drive", spec, claims, "pvc://results/r", str(agent.shared))
    )
    agent.await_no_descendants()
    return row


def recorded(row: Row, folder: Path, topic: str) -> list[bytes]:
    data = (folder / "r" / row["recorded"]).read_bytes()
    return [bytes(raw) for _, _, raw in bagpipe.MemoryMcap(data).messages([topic])]


def expected() -> list[bytes]:
    """The odometry of the same world, where nobody is between it and who steers."""
    described: dict[str, Any] = {"ego": {"speed": 10}}
    simulator = Simulator.model_validate({"duration": f"{STEPS / 10:g}s", **described})
    world = World(simulator, Scenario.model_validate(described), Steering(frozenset(), False), CDR)
    types = get_typestore(Stores.ROS2_HUMBLE)
    vector = types.types["geometry_msgs/msg/Vector3"]
    made: list[bytes] = []
    answer: list[list[Any]] = []
    while (step := world.step({"messages": answer})) is not None:
        made += [
            data
            for place, data in step["messages"]
            if world.publications[place].topic == "/ego/odom"
        ]
        twist = types.types[TWIST](linear=vector(len(made) / 10, 0, 0), angular=vector(0, 0, 0))
        answer = [["/cmd", TWIST, bytes(types.serialize_cdr(twist, TWIST))]]
    return made


def test_a_node_steers_a_drive_and_each_step_is_as_the_world_alone_has_it(
    tmp_path: Path, standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    agent = start_agent()
    rows = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        rows.append(drive(driver(standin), standin, tmp_path / name, agent))
    (row, again) = rows
    assert (row["outcome"], row["reason"]) == ("failed", "CriterionFailed"), row
    (step,) = row["result"]["playback"]["steps"]
    assert (step["released"], step["answered"]) == (STEPS, STEPS)
    assert row["result"]["ledger"]["strength"] == "called"
    odometry = recorded(row, tmp_path / "first", "/ego/odom")
    assert odometry == expected()
    assert len(recorded(row, tmp_path / "first", "/cmd")) == STEPS
    first = (tmp_path / "first/r" / row["recorded"]).read_bytes()
    assert first == (tmp_path / "second/r" / again["recorded"]).read_bytes()


def test_what_is_no_wish_ends_the_drive_with_the_types_that_are(
    tmp_path: Path, standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    command = driver(standin, "std_msgs/msg/String", "--relay")
    row = drive(command, standin, tmp_path, start_agent())
    assert (row["outcome"], row["reason"]) == ("errored", "BadControl"), row
    assert "publishes std_msgs/msg/String on /cmd, and the simulator obeys" in row["message"]
    assert "geometry_msgs/msg/Twist or geometry_msgs/msg/TwistStamped" in row["message"]


def test_recorded_topics_are_played_beside_the_drive_with_their_stamps_in_its_time(
    tmp_path: Path, standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    ros2_recording.write(tmp_path / "a.mcap", ["/in"], 60)
    beside = {"bag": "pvc://recordings/a.mcap", "from": "100ms", "topics": ["/in"]}
    command = [*driver(standin), "--sub", f"/in:{IMU}:10:reliable"]
    row = drive(command, standin, tmp_path, start_agent(), beside)
    assert (row["outcome"], row["reason"]) == ("failed", "CriterionFailed"), row
    assert (row["result"]["ledger"]["dropped"], row["result"]["ledger"]["strength"]) == (
        0,
        "called",
    )
    # 40 of them, 5 ms after each other, from the drive's first moment on.
    expected = [imu(START + number * 5_000_000, 20 + number) for number in range(40)]
    assert recorded(row, tmp_path, "/in") == expected
