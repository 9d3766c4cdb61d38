"""A recorded camera beside the simulated drive: a rospy node steers by both, twice the same."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_typestore

from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.integration.conftest import RunningAgent
from tests.integration.drives import EXAMPLE, PATH, PYTHON
from tests.waiting import patient

pytestmark = pytest.mark.integration

Start = Callable[..., RunningAgent]

SECOND = 1_000_000_000
BEGIN = 1_700_000_000 * SECOND
KIND = "sensor_msgs/msg/Image"
CAMERA = "/camera/image_raw"
# More than a frame of the pipe holds.
WIDTH, HEIGHT = 1280, 1000
FROM, STEPS = 10, 60
DARK_FROM = 40


def write_dusk(path: Path) -> None:
    """Seven seconds of a camera, which after four of them sees nothing any more."""
    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    path.parent.mkdir()
    with Writer(path) as bag:
        camera = bag.add_connection(CAMERA, KIND, typestore=store)
        for number in range(FROM + STEPS):
            time = BEGIN + number * SECOND // 10
            stamp = types["builtin_interfaces/msg/Time"](*divmod(time, SECOND))
            header = types["std_msgs/msg/Header"](seq=number, stamp=stamp, frame_id="camera")
            light = 20 if number >= DARK_FROM else 200
            pixels = np.full(WIDTH * HEIGHT, light, dtype=np.uint8)
            frame = types[KIND](header, HEIGHT, WIDTH, "mono8", 0, WIDTH, pixels)
            bag.write(camera, time, store.serialize_ros1(frame, KIND))


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    for claim in ("recordings", "results"):
        (tmp_path / claim).mkdir()
    write_dusk(tmp_path / "recordings/street/dusk.bag")
    return {claim: str(tmp_path / claim) for claim in ("recordings", "results")}


def spec_with(**changed: Any) -> SimulationJobSpec:
    spec = patient(yaml.safe_load((EXAMPLE / "dusk.yaml").read_text())["spec"])
    spec["stack"]["command"] = [PYTHON, str(EXAMPLE / "dusk.py")]
    return SimulationJobSpec.model_validate(spec | changed)


def run(spec: SimulationJobSpec, folders: dict[str, str], agent: RunningAgent) -> Row:
    (case,) = plan(spec, Storage(folders)).cases
    context = RunContext("lab/dusk", spec, folders, "pvc://results/r", str(agent.shared))
    return run_case(case, context)


def counts_of(row: Row, folders: dict[str, str]) -> dict[str, int]:
    with Reader(Path(folders["results"]) / "r" / row["recorded"]) as bag:
        return {topic: found.msgcount for topic, found in bag.topics.items()}


def test_the_driver_slows_down_when_the_recording_gets_dark_and_twice_alike(
    folders: dict[str, str], start_agent: Start
) -> None:
    agent, spec = start_agent(path=PATH), spec_with()
    digests = set()
    for _ in range(2):
        row = run(spec, folders, agent)
        assert (row["outcome"], row["attempts"]) == ("passed", 1), row
        (camera,) = [t for t in row["result"]["ledger"]["topics"] if t["topic"] == CAMERA]
        (subscriber,) = camera["subscribers"]
        assert (camera["sent"], subscriber["received"], subscriber["dropped"]) == (STEPS, STEPS, 0)
        (step,) = row["result"]["playback"]["steps"]
        assert (step["released"], step["answered"], step["no_output"]) == (STEPS, STEPS, 0)
        recorded = Path(folders["results"]) / "r" / row["recorded"]
        digests.add(hashlib.sha256(recorded.read_bytes()).hexdigest())
        print(row["result"]["playback"], row["result"]["recorded"]["bytes"], row["seconds"])
    assert len(digests) == 1
    # The camera is in its own recording already.
    assert counts_of(row, folders) == {
        "/cmd": STEPS, "/ego/odom": STEPS, "/obstacles": STEPS, "/ego/collision": STEPS,
        "/scene": 1,
    }  # fmt: skip
    (part,) = row["parts"]
    assert (part["window"][0], part["at"]) == (BEGIN + SECOND, SECOND)


def test_what_record_topics_name_is_recorded_with_the_drive_s_stamps(
    folders: dict[str, str], start_agent: Start
) -> None:
    row = run(spec_with(record={"topics": ["/cmd", "/camera/.*"]}), folders, start_agent(path=PATH))
    assert row["outcome"] == "passed", row
    assert counts_of(row, folders)[CAMERA] == STEPS
    with Reader(Path(folders["results"]) / "r" / row["recorded"]) as bag:
        cameras = [each for each in bag.connections if each.topic == CAMERA]
        times = [(time, raw[4:12]) for _, time, raw in bag.messages(connections=cameras)]
    moments = [SECOND + n * SECOND // 10 for n in range(STEPS)]
    assert [time for time, _ in times] == moments
    stamps = [
        int.from_bytes(raw[:4], "little") * SECOND + int.from_bytes(raw[4:], "little")
        for _, raw in times
    ]
    assert stamps == moments


def test_a_recording_that_gets_no_darker_fails_the_drive(
    folders: dict[str, str], start_agent: Start
) -> None:
    fields = yaml.safe_load((EXAMPLE / "dusk.yaml").read_text())["spec"]["source"]
    fields["simulator"] |= {"duration": "3s"}
    brief = [{"name": "slow", "expression": {
        "topic": "/ego/odom", "holds": "msg.twist.twist.linear.x < 10.0"}}]  # fmt: skip
    row = run(spec_with(source=fields, evaluate=brief), folders, start_agent(path=PATH))
    assert (row["outcome"], row["reason"]) == ("failed", "CriterionFailed"), row
