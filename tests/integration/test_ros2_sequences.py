"""Pieces of recordings of ROS 2 through the real agent and a node of the stand-in."""

from collections.abc import Callable
from pathlib import Path

import pytest

import bagpipe
from bagpipe.run.case_run import RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests import ros2_recording, ros2_standin
from tests.integration.conftest import RunningAgent
from tests.ros2_recording import BEGIN, IMU, imu
from tests.waiting import patient

pytestmark = pytest.mark.integration

POSE = "geometry_msgs/msg/PoseStamped"
MS = 1_000_000


def test_a_sequence_is_played_with_its_stamps_and_nothing_is_lost(
    tmp_path: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    standin = ros2_standin.built()
    claims = {name: str(tmp_path / name) for name in ("recordings", "results")}
    for folder in claims.values():
        Path(folder).mkdir()
    ros2_recording.write(tmp_path / "recordings/a.mcap", ["/in"], 40)
    relay = ["--sub", f"/in:{IMU}:10:reliable", "--pub", f"/out:{POSE}:10:reliable"]
    setup = ros2_standin.environment(standin)
    piece = {"bag": "pvc://recordings/a.mcap", "from": "50ms"}
    spec = SimulationJobSpec.model_validate(
        patient({
            "source": {"sequence": [piece, {**piece, "to": "100ms", "times": 2}]},
            "stack": {
                "engine": "ros2",
                "image": "registry.example/relay:1",
                "command": [str(standin / "standin_node"), "--name", "/relay", *relay,
                            "--relay-stamp", "/in=/out"],
                "env": [{"name": name, "value": value} for name, value in setup.items()],
            },
            "playback": {"mode": "lockstep"},
            "record": {"topics": ["/out"]},
            "output": {"uri": "pvc://results/r"},
        })
    )  # fmt: skip
    agent = start_agent()
    (case,) = plan(spec, Storage(claims)).cases
    row = run_case(
        case, RunContext("lab/pieces", spec, claims, "pvc://results/r", str(agent.shared))
    )
    agent.await_no_descendants()
    assert row["outcome"] == "passed", row
    ledger = row["result"]["ledger"]
    assert (ledger["sent"], ledger["received"], ledger["strength"]) == (50, 50, "called")
    data = (tmp_path / "results/r" / row["recorded"]).read_bytes()
    found = [(time // MS, bytes(raw)) for _, time, raw in bagpipe.MemoryMcap(data).messages()]
    whole = [(number, BEGIN + number * 5 * MS) for number in range(10, 40)]
    # The whole one ends 1 ns behind its last message.
    ends = BEGIN + 195 * MS + 1
    halves = [(10 + n, at + n * 5 * MS) for at in (ends, ends + 50 * MS) for n in range(10)]
    played = whole + halves
    assert [time for time, _ in found] == [time // MS for _, time in played]
    # The relay answers with its input's stamp.
    assert [raw[4:12] for _, raw in found] == [imu(time, 0)[4:12] for _, time in played]
