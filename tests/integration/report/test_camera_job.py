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
from PIL import Image

from bagpipe.pictures import MOST_BYTES
from tests.integration.conftest import ROOT
from tests.integration.laptop import Laptop

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


def test_the_report_shows_what_the_camera_saw_when_it_failed(laptop: Laptop) -> None:
    recordings = laptop.folder / "recordings"
    recordings.mkdir()
    files = [photograph(laptop.folder / f"{n}.jpg", each) for n, each in enumerate(COLOURS)]
    command = [sys.executable, str(CAMERA_BAG), str(recordings / "street.bag"), *map(str, files)]
    subprocess.run(command, check=True, timeout=100)
    status, _, errors = laptop.job(laptop.manifest("street", spec()))
    assert status == 1, errors
    folder = laptop.folder / "bagpipe-results/street"
    (row,) = (json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines())
    assert row["outcome"] == "failed"
    images = {each["of"]: each for each in row["images"]}
    assert images["output"]["topic"] == SEEN
    assert images["input"]["topic"] == TOPIC
    page = (folder / "report.html").read_text()
    for each in images.values():
        assert (each["width"], each["height"], each["type"]) == (640, 480, "image/png"), each
        assert each["at"] == pytest.approx(TOO_LATE, abs=0.11)
        shown = Image.open(io.BytesIO(base64.b64decode(each["data"]))).convert("RGB")
        mean = np.asarray(shown, dtype=float).mean(axis=(0, 1))
        # By a step of the few colours that a picture with grain gets.
        assert mean == pytest.approx(np.array(COLOURS[TOO_LATE]), abs=51)
        assert each["data"] in page
