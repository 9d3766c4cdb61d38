"""The first own job: `bagpipe init` over a recording, and what it writes runs as it is."""

import json
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from tests import ros2_standin, rosbag2_folders
from tests.integration.laptop import Laptop
from tests.integration.stacks import folders_with_recording
from tests.recording import MESSAGES
from tests.waiting import patient

pytestmark = pytest.mark.integration

# By the clock a verdict would be one about the machine that the tests run on.
MODE = ["--mode", "lockstep"]
STRING = "std_msgs/msg/String:10:reliable"
RELAY = Path(__file__).parent / "nodes/relay_type.py"


@pytest.fixture
def laptop(tmp_path: Path, agent_binary: Path) -> Iterator[Laptop]:
    made = Laptop(tmp_path, agent_binary)
    yield made
    made.await_nothing_left()


def wait_longer(job: Path) -> None:
    """Change nothing of a job but how long its stack is waited for: a busy machine needs more."""
    written = yaml.safe_load(job.read_text())
    patient(written["spec"])
    job.write_text(yaml.safe_dump(written))


def test_what_init_writes_is_planned_runs_and_passes_unchanged(laptop: Laptop) -> None:
    folders_with_recording(laptop.folder)
    bag = laptop.folder / "recordings/pr2/joint_states.bag"
    volume = ("--volume", f"recordings={laptop.folder / 'recordings'}")
    # The recording's own topic as an output: it is played under another name, from which the
    # stack makes it.
    command = f"/usr/bin/python3 {RELAY} sensor_msgs/JointState /recorded/joint_states"
    words = ["--output", "/joint_states", "--command", f"{command} /joint_states", "-o", "job.yaml"]
    status, output, errors = laptop.run(
        "init", bag, *volume, *words, *MODE, "--step", "/joint_states=/joint_states"
    )
    assert (status, errors) == (0, ""), errors
    assert output.startswith("job.yaml is written\n")
    job = laptop.folder / "job.yaml"
    spec = yaml.safe_load(job.read_text())["spec"]
    assert [each["name"] for each in spec["evaluate"]] == ["joint_states rate", "joint_states gap"]
    assert "# /joint_states: in lock-step no latency is demanded" in job.read_text()
    status, output, _ = laptop.run("plan", job, *volume)
    assert status == 0
    assert "Estimate: at least 2 s on 1 slot" in output
    wait_longer(job)
    status, output, errors = laptop.job(job, "--output", "json")
    assert status == 0, (output, errors)
    result = json.loads(output)
    assert result["verdict"] == "Passed"
    assert result["ledger"]["received"] == MESSAGES
    # Now the estimate rests on what it took.
    results = laptop.folder / "bagpipe-results/joint-states"
    status, output, _ = laptop.run("plan", job, *volume, "--results", results)
    assert "It rests on: 1 case by what the same case took." in output


def test_a_job_for_ros2_runs_unchanged_too(laptop: Laptop, monkeypatch: pytest.MonkeyPatch) -> None:
    standin = ros2_standin.built()
    for name, value in ros2_standin.environment(standin).items():
        monkeypatch.setenv(name, value)
    # 5 s of two topics in two files, of which the stack makes one again.
    messages = [
        rosbag2_folders.Message(
            ("/in", "/answer")[number % 2],
            rosbag2_folders.START + number * 10 * rosbag2_folders.MS,
            rosbag2_folders.text(f"message {number}"),
        )
        for number in range(500)
    ]
    drive = laptop.folder / "recordings/drive"
    rosbag2_folders.folder(drive, rosbag2_folders.FORMS[0], [messages[:300], messages[300:]])
    topics = ["--sub", f"/in:{STRING}", "--pub", f"/answer:{STRING}", "--relay", "/in=/answer"]
    command = shlex.join([str(standin / "standin_node"), "--name", "/relay", *topics])
    words = ["--output", "/answer", "--command", command, "-o", "job.yaml"]
    status, _, errors = laptop.run("init", drive, *words, *MODE)
    assert (status, errors) == (0, ""), errors
    job = laptop.folder / "job.yaml"
    spec = yaml.safe_load(job.read_text())["spec"]
    assert spec["stack"]["remap"] == {"/recorded/answer": "/answer"}
    wait_longer(job)
    status, output, errors = laptop.job(job, "--output", "json")
    assert status == 0, (output, errors)
    result = json.loads(output)
    assert (result["verdict"], result["ledger"]["received"]) == ("Passed", 250)
