"""Fragments replayed apart and merged are the whole replayed at once, byte for byte.

For a stateless node, in lock-step, on real recordings: cutting and distribution then change
nothing of what a stack answers.
"""

import itertools
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from bagpipe import MemoryBag
from bagpipe.run.case_run import RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.integration.conftest import ROOT, RunningAgent
from tests.integration.stacks import whole_fields
from tests.recording import MESSAGES, fetch
from tests.waiting import patient

pytestmark = pytest.mark.integration

RELAY = ROOT / "tests/integration/nodes/relay_type.py"
SHARED = ROOT.parent / "shared/data"
# Of each recording: its topic, the topic's type and messages, and what length cuts it how often.
RECORDINGS = {
    "pr2_joint_states_bz2.bag": ("/joint_states", "sensor_msgs/JointState", MESSAGES, "4s", 4),
    "jackal_bz2.bag": ("/imu/data", "sensor_msgs/Imu", 3061, "15s", 4),
    "luminar_lz4.bag": ("/luminar_pointcloud", "sensor_msgs/PointCloud2", 5, "100ms", 4),
}


def found(name: str) -> Path:
    if name.startswith("pr2"):
        return fetch()
    if not (SHARED / name).exists():
        pytest.skip(f"{name} is not beside the checkout")
    return SHARED / name


def relaying(topic: str, kind: str, length: str) -> SimulationJobSpec:
    spec = {
        "source": {
            "bags": ["pvc://recordings/*.bag"],
            "topics": [topic],
            "fragment": {"length": length},
        },
        "stack": {
            "image": "-",
            "command": ["/usr/bin/python3", str(RELAY), kind, topic, "/relayed"],
            "parameters": {"/use_sim_time": True},
        },
        "playback": {"mode": "lockstep", "steps": [{"trigger": topic, "answer": "/relayed"}]},
        "record": {"topics": ["/relayed"]},
        "output": {"uri": "pvc://results/out"},
    }
    return SimulationJobSpec.model_validate(patient(spec))


def publishing_states(length: str) -> SimulationJobSpec:
    """The example in lock-step, whose node answers each message by that message alone."""
    fields = whole_fields()
    fields["source"] |= {"bags": ["pvc://recordings/*.bag"], "fragment": {"length": length}}
    return SimulationJobSpec.model_validate(fields)


def recordings_of(
    spec: SimulationJobSpec, folders: dict[str, str], agent: RunningAgent
) -> list[MemoryBag]:
    context = RunContext("lab/whole", spec, folders, "pvc://results/r", str(agent.shared))
    cases = sorted(plan(spec, Storage(folders)).cases, key=lambda case: case.id)
    for one, next_one in itertools.pairwise(cases):
        assert one.window.end == next_one.window.start
    bags = []
    for case in cases:
        row = run_case(case, context)
        assert row["outcome"] == "passed", row
        bags.append(MemoryBag.open(Path(folders["results"]) / "r" / row["recorded"]))
    return bags


def assert_the_parts_are_the_whole(
    specs: Callable[[str], SimulationJobSpec],
    length: str,
    folders: dict[str, str],
    agent: RunningAgent,
) -> tuple[int, int]:
    """Gives the number of parts and of messages."""
    parts = recordings_of(specs(length), folders, agent)
    (whole,) = recordings_of(specs("1h"), folders, agent)
    merged = MemoryBag.merge(parts)
    assert merged.message_count == whole.message_count
    assert merged.to_bytes() == MemoryBag.merge([whole]).to_bytes()
    return len(parts), whole.message_count


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    made = {name: str(tmp_path / name) for name in ("recordings", "results")}
    for path in made.values():
        Path(path).mkdir()
    return made


@pytest.mark.parametrize("name", RECORDINGS)
def test_fragments_through_a_relay_are_the_whole_through_it(
    name: str, folders: dict[str, str], start_agent: Callable[..., RunningAgent]
) -> None:
    topic, kind, messages, length, parts = RECORDINGS[name]
    shutil.copyfile(found(name), Path(folders["recordings"]) / name)
    assert assert_the_parts_are_the_whole(
        lambda cut: relaying(topic, kind, cut), length, folders, start_agent()
    ) == (parts, messages)


def test_fragments_through_robot_state_publisher_are_the_whole_through_it(
    folders: dict[str, str], start_agent: Callable[..., RunningAgent]
) -> None:
    shutil.copyfile(fetch(), Path(folders["recordings"]) / "pr2.bag")
    assert assert_the_parts_are_the_whole(publishing_states, "4s", folders, start_agent()) == (
        4,
        MESSAGES,
    )
