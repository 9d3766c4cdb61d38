"""The lock-step example: nothing dropped by a queue of one, and the same bytes on every run."""

from pathlib import Path

import pytest
import yaml

from tests.e2e import jobs
from tests.e2e import kubectl as k
from tests.recording import MESSAGES

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("recordings")]

EXAMPLE = Path(__file__).parents[2] / "docs/examples/lockstep/job.yaml"


def run(namespace: str, name: str) -> tuple[k.Object, str]:
    """The only row of a run of the example, and the digest of what it recorded."""
    job = yaml.safe_load(EXAMPLE.read_text())
    job["metadata"]["name"] = name
    with jobs.applied(namespace, job):
        status = jobs.ended(namespace, name, 400)["status"]
        assert (status["phase"], status["verdict"]) == ("Complete", "Passed"), status
        _, (row,) = k.results(namespace, status["results"])
        path = "/" + status["results"].removeprefix("pvc://") + "/" + row["recorded"]
        return row, k.in_toolbox(namespace, "sha256sum", path).split()[0]


def test_every_message_is_answered_and_two_runs_record_the_same_bytes(namespace: str) -> None:
    first, digest = run(namespace, "lockstep-once")
    second, again = run(namespace, "lockstep-again")
    for row in (first, second):
        ledger = row["result"]["ledger"]
        assert (ledger["sent"], ledger["received"], ledger["dropped"]) == (MESSAGES, MESSAGES, 0)
        assert row["attempts"] == 1
        recorded = {t["topic"]: t["messages"] for t in row["result"]["recorded"]["topics"]}
        assert recorded == {"/tf": MESSAGES}
        assert row["result"]["playback"]["played_seconds"] < 16
    assert digest == again
