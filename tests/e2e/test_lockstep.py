"""The example in lock-step: nothing dropped by a queue of one, and the same bytes on every run.

On the cluster twice, from the bag and from MCAP of the same messages, and by `bagpipe run` on this
machine.
"""

import hashlib
import json
from pathlib import Path

import pytest

from tests.agent_binary import built
from tests.e2e import jobs
from tests.e2e import kubectl as k
from tests.integration.laptop import Laptop
from tests.integration.stacks import folders_with_recording
from tests.mcap_of_bag import mcap_of
from tests.recording import MESSAGES, fetch

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("recordings")]


def run(namespace: str, name: str, recording: str | None = None) -> tuple[k.Object, str]:
    """The only row of a run of the example, or of another recording on its claim, and the digest of
    what it recorded.
    """
    job = jobs.make_job(name)
    if recording is not None:
        job["spec"]["source"]["bags"] = [f"pvc://recordings/{recording}"]
    with jobs.applied(namespace, job):
        status = jobs.ended(namespace, name, 400)["status"]
        assert (status["phase"], status["verdict"]) == ("Complete", "Passed"), status
        _, (row,) = k.results(namespace, status["results"])
        path = "/" + status["results"].removeprefix("pvc://") + "/" + row["recorded"]
        return row, k.in_toolbox(namespace, "sha256sum", path).split()[0]


def run_here(folder: Path) -> tuple[k.Object, str]:
    """The same of a run without a cluster, with Debian's node in place of the image's."""
    laptop = Laptop(folder, built())
    folders_with_recording(folder)
    manifest = laptop.manifest("lockstep", jobs.make_job("lockstep")["spec"])
    status, _, errors = laptop.job(manifest, "--results", folder / "kept")
    laptop.await_nothing_left()
    assert status == 0, errors
    (line,) = (folder / "kept/results.jsonl").read_text().splitlines()
    row = json.loads(line)
    return row, hashlib.sha256((folder / "kept" / row["recorded"]).read_bytes()).hexdigest()


def test_every_message_is_answered_and_each_run_records_the_same_bytes(
    namespace: str, tmp_path: Path
) -> None:
    mcap = mcap_of(fetch(), tmp_path / "drive.mcap", "zstd")
    k.put(namespace, mcap, "mcap/drive.mcap")
    first, digest = run(namespace, "lockstep-once")
    second, again = run(namespace, "lockstep-again", "mcap/drive.mcap")
    third, here = run_here(tmp_path)
    for row in (first, second, third):
        ledger = row["result"]["ledger"]
        assert (ledger["sent"], ledger["received"], ledger["dropped"]) == (MESSAGES, MESSAGES, 0)
        assert row["attempts"] == 1
        recorded = {t["topic"]: t["messages"] for t in row["result"]["recorded"]["topics"]}
        assert recorded == {"/tf": MESSAGES}
    # Not in the recording's time, though a machine that stands still may hold one of them up.
    took = [row["result"]["playback"]["played_seconds"] for row in (first, second, third)]
    assert min(took) < 16, took
    assert digest == again == here
