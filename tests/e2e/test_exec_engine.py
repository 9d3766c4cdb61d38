"""The exec engine's example: another simulator in place of ROS, its files and verdicts kept."""

import csv
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from tests.e2e import jobs
from tests.e2e import kubectl as k

pytestmark = pytest.mark.e2e

EXAMPLE = Path(__file__).parents[2] / "docs/examples/exec-highway"
# Steps until its end and the cars' least distance in metres, of each scenario.
EXPECTED = {
    "front-right-slower-left": (150, "passed", 4.001),
    "front-slower-straight": (150, "passed", 4.002),
    "left-faster-right": (150, "passed", 4.014),
    "rear-faster-straight": (45, "failed", 5.0),
    "rear-left-equal-right": (150, "passed", 20.266),
    "right-equal-left": (21, "failed", 2.472),
}


@pytest.fixture
def job(namespace: str) -> Iterator[k.Object]:
    """The example's manifest, its scenarios on the claim."""
    for scenario in sorted((EXAMPLE / "scenarios").glob("*.json")):
        k.put(namespace, scenario, f"scenarios/{scenario.name}")
    manifest = yaml.safe_load((EXAMPLE / "job.yaml").read_text())
    with jobs.applied(namespace, manifest):
        yield manifest


def test_every_scenario_is_simulated_and_judged(namespace: str, job: k.Object) -> None:
    status = jobs.ended(namespace, job["metadata"]["name"], 400)["status"]
    assert (status["phase"], status["verdict"]) == ("Complete", "Failed"), status
    cases = status["cases"]
    assert (cases["planned"], cases["passed"], cases["failed"]) == (6, 4, 2)
    assert sorted(failure["case"] for failure in status["failures"]) == [
        "rear-faster-straight", "right-equal-left",
    ]  # fmt: skip
    assert {failure["reason"] for failure in status["failures"]} == {"Collision"}
    manifest, rows = k.results(namespace, status["results"])
    assert manifest["verdict"] == "Failed"
    assert sorted(row["case"] for row in rows) == sorted(EXPECTED)
    folder = "/" + status["results"].removeprefix("pvc://")
    for row in rows:
        steps, outcome, closest = EXPECTED[row["case"]]
        figures = row["result"]["program"]["figures"]
        assert (row["outcome"], figures["steps"]) == (outcome, steps)
        assert figures["closest_metres"] == closest
        (name,) = row["recorded"]
        trajectory = k.in_toolbox(namespace, "cat", f"{folder}/{name}")
        assert len(list(csv.DictReader(trajectory.splitlines()))) == steps
