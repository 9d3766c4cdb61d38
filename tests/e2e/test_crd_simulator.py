"""What source.simulator takes, as the API server says it."""

import copy
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.e2e.test_crd_refusals import (
    Manifest,
    crd,  # noqa: F401  the fixture sees to the CRD in this module too
    dry_run,
)

pytestmark = pytest.mark.e2e

EXAMPLE = Path(__file__).parents[2] / "docs/examples/barrier-car/job.yaml"
RECORDED = {"bag": "pvc://recordings/drive.bag", "topics": ["/camera"]}
LOCKSTEP = {"mode": "lockstep", "steps": [{"trigger": "/ego/odom", "answer": "/cmd"}]}


def drive(spec: dict[str, Any], simulator: dict[str, Any]) -> Manifest:
    """The barrier car's job with fields of its spec and its simulator replaced."""
    manifest: Manifest = copy.deepcopy(yaml.safe_load(EXAMPLE.read_text()))
    manifest["metadata"]["namespace"] = "default"
    manifest["spec"]["source"]["simulator"] |= simulator
    manifest["spec"] |= spec
    return manifest


REFUSED: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "a simulator and bags": (
        {"source": {"simulator": {"duration": "1s"}, "bags": ["pvc://a/b.bag"]}}, {},
        "source needs one of bags, sequence, files and simulator",
    ),
    "a simulator and topics": (
        {"source": {"simulator": {"duration": "1s"}, "topics": ["/tf"]}}, {},
        "write the names into source.simulator.topics",
    ),
    "another engine": (
        {"stack": {"image": "i", "command": ["c"], "engine": "exec"}}, {},
        "source.simulator speaks ROS 1",
    ),
    "no lock-step": ({"playback": {"mode": "max"}}, {}, "write playback.mode: lockstep"),
    "nobody steers": (
        {"playback": LOCKSTEP}, {"topics": {"control": "/wheel"}},
        "no step of playback.steps has the answer by which the simulated car is steered",
    ),
    "a remap": (
        {"stack": {"image": "i", "command": ["c"], "remap": {"/a": "/b"}}}, {},
        "stack.remap joins names to a recording's",
    ),
    "no unit": ({}, {"duration": "10"}, "source.simulator.duration must be a duration above zero"),
    "too short a step": ({}, {"step": "0.1ms"}, "must be a duration of at least 1ms"),
    "no duration": ({"source": {"simulator": {"step": "1s"}}}, {}, "simulator.duration: Required"),
    "no topic": ({}, {"topics": {"odometry": "odom"}}, "write for example /ego/odom"),
    "recorded without topics": (
        {}, {"recorded": [RECORDED | {"topics": []}]}, "recorded needs the topics that are heard",
    ),
    "recorded bags": (
        {}, {"recorded": [RECORDED | {"bag": "pvc://a/*.bag"}]}, "a piece is of one bag",
    ),
    "recorded and its own": (
        {}, {"recorded": [RECORDED | {"topics": ["/obstacles"]}]}, "is the simulator's own",
    ),
    "a recorded clock": (
        {}, {"recorded": [RECORDED | {"topics": ["/clock"]}]}, "is the simulator's own, or /clock",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_makes_no_drive_is_refused(case: str) -> None:
    spec, simulator, sentence = REFUSED[case]
    answer = dry_run(drive(spec, simulator))
    assert answer.returncode == 1, answer.stdout
    assert sentence in answer.stderr


def test_the_barrier_car_is_taken_and_its_names_may_differ() -> None:
    answer = dry_run(drive({}, {}))
    assert answer.returncode == 0, answer.stderr
    answer = dry_run(drive({"playback": LOCKSTEP}, {"topics": {"obstacles": "/cars"}}))
    assert answer.returncode == 0, answer.stderr


def test_recorded_topics_stand_beside_the_drive() -> None:
    pieces = [RECORDED, RECORDED | {"from": "{{ start }}s", "topics": ["/imu", "/gps"]}]
    answer = dry_run(drive({}, {"recorded": pieces}))
    assert answer.returncode == 0, answer.stderr
