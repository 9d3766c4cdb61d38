"""Lock-step through the worker: the node with a queue of one loses nothing, twice the same."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import pytest

from bagpipe.run.case_run import RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from tests.integration.conftest import RunningAgent
from tests.integration.stacks import folders_with_recording, in_one_piece
from tests.recording import MESSAGES

pytestmark = pytest.mark.integration


def test_runs_with_and_without_the_cache_lose_nothing_and_record_the_same_bytes(
    tmp_path: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    folders = folders_with_recording(tmp_path)
    spec = in_one_piece()
    in_memory = start_agent()
    files = tmp_path / "files"
    files.mkdir()
    on_disk = start_agent(1, None, "--on-disk", str(files), "--cold")
    (case,) = plan(spec, Storage(folders)).cases
    digests = set()
    for agent in (in_memory, in_memory, on_disk):
        context = RunContext("lab/pr2", spec, folders, "pvc://results/r", str(agent.shared))
        row = run_case(case, context)
        assert (row["outcome"], row["attempts"]) == ("passed", 1), row
        ledger = row["result"]["ledger"]
        assert (ledger["sent"], ledger["received"], ledger["dropped"]) == (MESSAGES, MESSAGES, 0)
        recorded = Path(folders["results"]) / "r" / row["recorded"]
        digests.add(hashlib.sha256(recorded.read_bytes()).hexdigest())
        print(row["result"]["playback"], row["result"]["recorded"], row["seconds"])
    assert len(digests) == 1
    kept = {path.name for path in files.iterdir()}
    assert kept == {"input-0.bag", "recording-0.bag"}
    digest = hashlib.sha256((files / "recording-0.bag").read_bytes()).hexdigest()
    assert digests == {digest}
    assert on_disk.log.read_text().count("forgotten after") == 2
