"""Lock-step through the worker: the node with a queue of one loses nothing, twice the same."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from bagpipe.plan.cases import plan
from bagpipe.run.case_run import RunContext, run_case
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.integration.conftest import ROOT, RunningAgent
from tests.integration.stacks import folders_with_recording
from tests.recording import MESSAGES

pytestmark = pytest.mark.integration


def test_two_runs_lose_nothing_and_record_the_same_bytes(
    tmp_path: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    folders = folders_with_recording(tmp_path)
    manifest = yaml.safe_load((ROOT / "docs/examples/lockstep/job.yaml").read_text())
    spec = SimulationJobSpec.model_validate(manifest["spec"])
    agent = start_agent()
    context = RunContext("lab/pr2", spec, folders, "pvc://results/r", str(agent.shared))
    (case,) = plan(spec, Storage(folders)).cases
    digests = set()
    for _ in range(2):
        row = run_case(case, context)
        assert (row["outcome"], row["attempts"]) == ("passed", 1), row
        ledger = row["result"]["ledger"]
        assert (ledger["sent"], ledger["received"], ledger["dropped"]) == (MESSAGES, MESSAGES, 0)
        recorded = Path(folders["results"]) / "r" / row["recorded"]
        digests.add(hashlib.sha256(recorded.read_bytes()).hexdigest())
        print(row["result"]["playback"], row["result"]["recorded"], row["seconds"])
    assert len(digests) == 1
