"""The worker, the agent and Debian's unmodified robot_state_publisher on the real recording."""

import collections
import itertools
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.rosbag1 import Reader

from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.integration.conftest import RunningAgent
from tests.integration.machine_witness import Witness
from tests.integration.stacks import folders_with_recording, spec_with, stepped
from tests.recording import MESSAGES, fetch

pytestmark = pytest.mark.integration


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    return folders_with_recording(tmp_path)


def run_all(spec: SimulationJobSpec, folders: dict[str, str], agent: RunningAgent) -> list[Row]:
    cases = plan(spec, Storage(folders)).cases
    context = RunContext("lab/pr2", spec, folders, "pvc://results/r", str(agent.shared))
    return [run_case(case, context) for case in cases]


def rosbag_info(path: Path) -> dict[str, Any]:
    command = ["/usr/bin/python3", "/usr/bin/rosbag", "info", "--yaml", str(path)]
    output = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True).stdout
    loaded: dict[str, Any] = yaml.safe_load(output)
    return loaded


def counted(folders: dict[str, str], row: Row) -> dict[str, int]:
    """Messages per topic of what a case recorded, as Debian's rosbag counts them."""
    info = rosbag_info(Path(folders["results"]) / "r" / row["recorded"])
    assert info["start"] >= row["window"][1] / 1e9
    return {topic["topic"]: topic["messages"] for topic in info["topics"]}


def test_every_message_of_the_recording_is_sent_received_and_answered_once(
    folders: dict[str, str], start_agent: Callable[..., RunningAgent]
) -> None:
    agent = start_agent()
    rows = run_all(stepped(), folders, agent)
    assert [(row["outcome"], row["attempts"]) for row in rows] == [("passed", 1)] * 4
    ledger: collections.Counter[str] = collections.Counter()
    for row in rows:
        ledger.update({k: v for k, v in row["result"]["ledger"].items() if k != "topics"})
        assert counted(folders, row) == {"/tf": row["result"]["ledger"]["sent"]}
    assert (ledger["sent"], ledger["received"], ledger["dropped"]) == (MESSAGES, MESSAGES, 0)
    assert ledger["lead_in"] == pytest.approx(300, abs=6)
    agent.await_no_descendants()


def at_once(window: list[int], seconds: float = 0.002) -> int:
    """How many messages of the window come so soon after another that they may replace it."""
    with Reader(fetch()) as recording:
        times = sorted(time for _, time, _ in recording.messages() if window[1] <= time < window[2])
    return sum(after - before < seconds * 1e9 for before, after in itertools.pairwise(times))


@pytest.mark.alone
def test_in_real_time_a_queue_of_one_loses_at_most_what_comes_at_once_or_the_machine_was_busy(
    folders: dict[str, str], start_agent: Callable[..., RunningAgent]
) -> None:
    agent = start_agent()
    spec = spec_with()
    context = RunContext("lab/pr2", spec, folders, "pvc://results/r", str(agent.shared))
    with Witness() as witness:
        row = run_case(plan(spec, Storage(folders)).cases[0], context)
    print(row["outcome"], row["reason"], row["message"])
    if row["reason"] == "MachineBusy":
        assert row["outcome"] == "errored"
        assert witness.was_disturbed, row
        agent.await_no_descendants()
        return
    ledger = row["result"]["ledger"]
    seconds = (row["window"][2] - row["window"][1]) / 1e9
    assert ledger["sent"] == pytest.approx(100 * seconds, rel=0.02)
    assert ledger["sent"] == ledger["received"] + ledger["dropped"]
    if ledger["dropped"]:
        # A third of this recording's messages have the time of the one before.
        assert (row["outcome"], row["reason"]) == ("failed", "MessagesLost")
        assert ledger["dropped"] <= at_once(row["window"]) or witness.was_disturbed, row["message"]
    else:
        assert row["outcome"] == "passed", row
        counts = counted(folders, row)
        assert counts["/tf_static"] == 1
        assert 40 * seconds < counts["/tf"] < 130 * seconds
    agent.await_no_descendants()
