"""The workflow asks for nothing that is not there, and for both distributions of ROS 2."""

import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[3]
JOBS: dict[str, Any] = yaml.safe_load((ROOT / ".github/workflows/checks.yml").read_text())["jobs"]
COMMANDS = [
    (name, step["run"]) for name, job in JOBS.items() for step in job["steps"] if "run" in step
]


@pytest.mark.parametrize(("job", "command"), COMMANDS)
def test_a_command_is_one_of_a_shell_and_its_verbs_are_of_make(job: str, command: str) -> None:
    done = subprocess.run(["bash", "-n"], input=command, text=True, check=False)
    assert done.returncode == 0, job
    verbs = re.findall(
        r"^(?:\S+: )?([a-z0-9-]+):.*##", (ROOT / "Makefile").read_text(), re.MULTILINE
    )
    assert set(re.findall(r"^\s*make ([a-z0-9-]+)", command, re.MULTILINE)) <= set(verbs)


def test_a_real_ros_2_is_tried_in_the_images_of_both_distributions_that_were_run() -> None:
    job = JOBS["ros2"]
    assert job["strategy"]["matrix"]["image"] == ["ros:humble", "ros:jazzy"]
    # Docker takes folders by their names on the machine, which are others in a container.
    assert "container" not in job
    assert any("make test-ros2 ROS2_IMAGE=" in step.get("run", "") for step in job["steps"])


def test_no_job_runs_without_an_end() -> None:
    assert [name for name, job in JOBS.items() if "timeout-minutes" not in job] == []
