"""A camera's job from its recording to the pictures of its report: JPEGs of some 60 KB."""

import base64
import io
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType
from PIL import Image
from rosbags.typesys import Stores, get_typestore

from bagpipe.pictures import MOST_BYTES
from tests import ros2_recording, ros2_standin
from tests.integration.conftest import ROOT
from tests.integration.laptop import Laptop
from tests.waiting import patient

pytestmark = pytest.mark.integration

RELAY = ROOT / "tests/integration/nodes/relay_type.py"
CAMERA_BAG = ROOT / "docs/examples/pedestrians-node/camera_bag.py"
# As that program has them: ten frames a second for each photograph.
TOPIC, BEGIN = "/camera/image/compressed", 1_700_000_000
KIND = "sensor_msgs/CompressedImage"
SEEN = "/camera/seen"
# One for each second of the recording, and the second that is one too many.
COLOURS = [(200, 40, 40), (40, 200, 40), (40, 40, 200), (200, 200, 40)]
TOO_LATE = 2


@pytest.fixture
def laptop(tmp_path: Path, agent_binary: Path) -> Iterator[Laptop]:
    made = Laptop(tmp_path, agent_binary)
    yield made
    made.await_nothing_left()


def photograph(path: Path, colour: tuple[int, int, int]) -> Path:
    """One of a colour, and of so much grain that its file is as large as a camera's."""
    grain = np.random.default_rng(1).integers(-30, 30, (480, 640, 3))
    Image.fromarray((np.array(colour) + grain).astype(np.uint8)).save(path, "JPEG", quality=90)
    assert path.stat().st_size > 3 * MOST_BYTES
    return path


def spec() -> dict[str, Any]:
    early = {"topic": SEEN, "field": "header.stamp.sec", "max": BEGIN + TOO_LATE - 1}
    return {
        "source": {"bags": ["pvc://recordings/street.bag"], "topics": [TOPIC]},
        "stack": {
            "image": "-", "command": ["/usr/bin/python3", str(RELAY), KIND, TOPIC, SEEN],
        },
        "playback": {"mode": "lockstep", "steps": [{"trigger": TOPIC, "answer": SEEN}]},
        "record": {"topics": [SEEN]},
        "evaluate": [{"name": "early", "bounds": early}],
        "output": {"uri": "pvc://results/street"},
    }  # fmt: skip


def failed(laptop: Laptop, spec: dict[str, Any]) -> tuple[dict[str, Any], str]:
    """The row of the one case, which failed, and the report."""
    status, _, errors = laptop.job(laptop.manifest("street", spec))
    assert status == 1, errors
    folder = laptop.folder / "bagpipe-results/street"
    (row,) = (json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines())
    assert row["outcome"] == "failed"
    return row, (folder / "report.html").read_text()


def assert_shown(image: dict[str, Any], page: str) -> None:
    """Of the photograph of the second that is one too many."""
    assert (image["width"], image["height"], image["type"]) == (640, 480, "image/png"), image
    assert image["at"] == pytest.approx(TOO_LATE, abs=0.11)
    shown = Image.open(io.BytesIO(base64.b64decode(image["data"]))).convert("RGB")
    mean = np.asarray(shown, dtype=float).mean(axis=(0, 1))
    # By a step of the few colours that a picture with grain gets.
    assert mean == pytest.approx(np.array(COLOURS[TOO_LATE]), abs=51)
    assert image["data"] in page


@pytest.fixture
def photographs(laptop: Laptop) -> list[Path]:
    (laptop.folder / "recordings").mkdir()
    return [photograph(laptop.folder / f"{n}.jpg", each) for n, each in enumerate(COLOURS)]


def test_the_report_shows_what_the_camera_saw_when_it_failed(
    laptop: Laptop, photographs: list[Path]
) -> None:
    bag = laptop.folder / "recordings/street.bag"
    subprocess.run(
        [sys.executable, str(CAMERA_BAG), str(bag), *map(str, photographs)], check=True, timeout=100
    )
    row, page = failed(laptop, patient(spec()))
    images = {each["of"]: each for each in row["images"]}
    assert images["output"]["topic"] == SEEN
    assert images["input"]["topic"] == TOPIC
    for each in images.values():
        assert_shown(each, page)


def camera_mcap(path: Path, photographs: list[Path]) -> None:
    """The frames of the bag, as a camera of ROS 2 has them recorded."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types, kind = store.types, "sensor_msgs/msg/CompressedImage"

    def frame(time: int, photograph: Path) -> bytes:
        stamp = types["builtin_interfaces/msg/Time"](*divmod(time, 10**9))
        header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="camera")
        data = np.frombuffer(photograph.read_bytes(), np.uint8)
        made = types[kind](header=header, format="jpeg", data=data)
        return bytes(store.serialize_cdr(made, kind))

    times = [BEGIN * 10**9 + number * 10**8 for number in range(10 * len(photographs))]
    frames = (
        (TOPIC, time, frame(time, photographs[number // 10])) for number, time in enumerate(times)
    )
    ros2_recording.write_messages(
        path, kind, [TOPIC], frames, chunk_size=256 << 10, compression=CompressionType.ZSTD
    )


def test_and_what_a_camera_of_ros_2_saw(
    laptop: Laptop, photographs: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a node whose answers have the stamps of the frames, and no picture of their own."""
    standin = ros2_standin.built()
    for name, value in ros2_standin.environment(standin).items():
        monkeypatch.setenv(name, value)
    camera_mcap(laptop.folder / "recordings/street.mcap", photographs)
    topics = [
        "--sub", f"{TOPIC}:sensor_msgs/msg/CompressedImage:10:reliable",
        "--pub", "/pose:geometry_msgs/msg/PoseStamped:10:reliable",
        "--relay-stamp", f"{TOPIC}=/pose",
    ]  # fmt: skip
    job = patient(spec())
    job["source"]["bags"] = ["pvc://recordings/street.mcap"]
    command = [str(standin / "standin_node"), "--name", "/relay", *topics]
    job["stack"] |= {"engine": "ros2", "command": command}
    job["playback"]["steps"][0]["answer"] = "/pose"
    job["record"]["topics"] = ["/pose"]
    job["evaluate"][0]["bounds"]["topic"] = "/pose"
    row, page = failed(laptop, job)
    (image,) = row["images"]
    assert (image["of"], image["topic"]) == ("input", TOPIC)
    assert_shown(image, page)
