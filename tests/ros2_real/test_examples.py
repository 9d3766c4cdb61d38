"""The examples of ROS 2's own packages, as their manifests have them."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from bagpipe.spec import SimulationJobSpec
from tests.ros2_real.jobs import Trial, activating, ledger_of, passed
from tests.ros2_real.place import ROOT, Place
from tests.ros2_real.recordings import write_scans, write_texts, write_twists

EXAMPLES = ROOT / "docs/examples/ros2"
PARAMETERS = "--ros-args --params-file $BAGPIPE_PARAMETERS"
JACKAL = ROOT.parent / "shared/data/jackal_bz2.bag"


def example(trial: Trial, place: Place, name: str, package: str) -> dict[str, Any]:
    """The manifest's fields with the trial's middleware; skipped where its package is not."""
    if not place.has(package):
        pytest.skip(f"{package} is not installed")
    fields: dict[str, Any] = yaml.safe_load((EXAMPLES / name).read_text())["spec"]
    fields["stack"]["env"] = [{"name": "RMW_IMPLEMENTATION", "value": trial.rmw}]
    return fields


def recording(trial: Trial, name: str) -> Path:
    path = Path(trial.folders["recordings"], name)
    path.parent.mkdir()
    return path


def test_the_listener_receives_all_that_is_published(trial: Trial, place: Place) -> None:
    fields = example(trial, place, "listener.yaml", "demo_nodes_cpp")
    texts = (f"Hello World: {number}" for number in range(200))
    write_texts(recording(trial, "chatter/chatter.mcap"), {"/chatter": texts})
    row = trial.run(SimulationJobSpec.model_validate(fields))
    assert passed(row), row
    assert ledger_of(row) == (200, 200, 0, "called")


def test_a_turtlebot_stands_before_the_wall_twice_alike(trial: Trial, place: Place) -> None:
    fields = example(trial, place, "turtlebot.yaml", "turtlebot3_example")
    # Ten seconds at 0.25 m/s towards a wall that is 2 m away: half a metre is left after six.
    write_scans(recording(trial, "corridor/corridor.mcap"), (2 - n / 20 for n in range(51)))
    digests = set()
    for _ in range(2):
        row = trial.run(SimulationJobSpec.model_validate(fields))
        assert passed(row), row
        assert ledger_of(row)[:3] == (51, 51, 0)
        digests.add(trial.digest(row))
    assert len(digests) == 1


def test_a_robot_is_driven_smoothly_once_its_smoother_is_active(trial: Trial, place: Place) -> None:
    fields = example(trial, place, "velocity-smoother.yaml", "nav2_velocity_smoother")
    if place.run(["bash", "-c", "echo $ROS_DISTRO"]).stdout.strip() == "humble":
        # A node of Nav2 has no autostart_node there.
        command = " ".join([*fields["stack"]["command"], PARAMETERS])
        fields["stack"]["command"] = ["bash", "-c", activating(command, "/velocity_smoother")]
    # Two seconds of more than it may drive, two of standing, and one of turning on the spot.
    commands = [(0.8, 0.0)] * 40 + [(0.0, 0.0)] * 40 + [(0.0, 1.0)] * 20
    write_twists(recording(trial, "commands/commands.mcap"), commands)
    row = trial.run(SimulationJobSpec.model_validate(fields))
    assert passed(row), row
    assert ledger_of(row) == (100, 100, 0, "called")


def test_robot_localization_ends_where_its_authors_say_and_twice_alike(
    trial: Trial, place: Place
) -> None:
    if not JACKAL.is_file():
        pytest.skip("the Jackal's recording is not there")
    fields = example(trial, place, "ekf.yaml", "robot_localization")
    # As the example's page has it.
    folder = Path(trial.folders["recordings"], "jackal")
    words = ["--src", str(JACKAL), "--dst", str(folder), "--dst-storage", "mcap"]
    subprocess.run([sys.executable, "-m", "rosbags.convert", *words], check=True, timeout=300)
    digests = set()
    for _ in range(2):
        row = trial.run(SimulationJobSpec.model_validate(fields))
        assert passed(row), row
        assert ledger_of(row) == (6121, 6121, 0, "called")
        digests.add(trial.digest(row))
    assert len(digests) == 1
