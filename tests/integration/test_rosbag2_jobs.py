"""A job over a folder of rosbag2: what the stack receives, and so what it answers, is a bag's.

The folder holds messages of ROS 1, which rosbag2 never records, so that they can be played to a
stack of which there is a bag: planning and the worker's stream know no middleware.
"""

import hashlib
import itertools
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from bagpipe import MemoryBag
from bagpipe.run.case_run import RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from tests.integration.conftest import RunningAgent
from tests.integration.stacks import folders_with_recording, in_one_piece, over, run_all, stepped
from tests.mcap_of_bag import mcap_of
from tests.recording import MESSAGES

pytestmark = pytest.mark.integration


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    """The recording as a bag, and as a folder of three files of MCAP, on one claim."""
    claims = folders_with_recording(tmp_path)
    bag = Path(claims["recordings"]) / "pr2/joint_states.bag"
    whole = MemoryBag.open(bag)
    assert whole.start is not None
    folder = bag.with_name("drive")
    folder.mkdir()
    names = []
    edges = [whole.start, whole.start + 5 * 10**9, whole.start + 9 * 10**9, None]
    for number, (start, end) in enumerate(itertools.pairwise(edges)):
        part = tmp_path / "part.bag"
        part.write_bytes(whole.slice(start, end).to_bytes())
        names.append(f"drive_{number}.mcap")
        mcap_of(part, folder / names[-1], "zstd")
    about: dict[str, Any] = {
        "version": 6,
        "storage_identifier": "mcap",
        "message_count": MESSAGES,
        "relative_file_paths": names,
    }
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": about}))
    return claims


def test_in_lock_step_the_answers_are_the_same_bytes_as_to_the_bag(
    folders: dict[str, str], start_agent: Callable[..., RunningAgent]
) -> None:
    agent = start_agent()
    digests = set()
    for recording in ("joint_states.bag", "drive/"):
        (row,) = run_all(over(in_one_piece(), recording), folders, agent)
        assert (row["outcome"], row["attempts"]) == ("passed", 1), row
        ledger = row["result"]["ledger"]
        assert (ledger["sent"], ledger["received"], ledger["dropped"]) == (MESSAGES, MESSAGES, 0)
        recorded = Path(folders["results"]) / "r" / row["recorded"]
        digests.add(hashlib.sha256(recorded.read_bytes()).hexdigest())
    assert len(digests) == 1
    assert row["bag"].endswith("drive/metadata.yaml")
    assert len(row["parts"]) == 3


def test_its_fragments_play_every_message_once(
    folders: dict[str, str], start_agent: Callable[..., RunningAgent]
) -> None:
    rows = run_all(over(stepped(), "drive"), folders, start_agent())
    assert [row["outcome"] for row in rows] == ["passed"] * len(rows)
    assert len(rows) == 4
    assert sum(row["result"]["ledger"]["sent"] for row in rows) == MESSAGES
    assert {len(row["parts"]) for row in rows} == {1, 2}


def test_a_file_that_changed_since_it_was_planned_is_no_input(
    folders: dict[str, str], start_agent: Callable[..., RunningAgent]
) -> None:
    spec = over(in_one_piece(), "drive")
    (case,) = plan(spec, Storage(folders)).cases
    file = Path(folders["recordings"]) / "pr2/drive/drive_1.mcap"
    shutil.copyfile(file.with_name("drive_2.mcap"), file)
    agent = start_agent()
    context = RunContext("lab/pr2", spec, folders, "pvc://results/r", str(agent.shared))
    row = run_case(case, context)
    assert row["outcome"] == "errored"
    assert "no longer the file that was planned" in row["message"]
