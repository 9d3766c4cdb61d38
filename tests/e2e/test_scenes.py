"""Scenes on a cluster: the paper's barrier car in a closed loop, and a sequence of pieces."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.e2e import jobs
from tests.e2e import kubectl as k

pytestmark = pytest.mark.e2e

EXAMPLES = Path(__file__).parents[2] / "docs/examples"

# Six of the example's 54 combinations; tests/integration/test_barrier_car.py plays all.
SIX = {
    "direction": ["front", "left"],
    "speed": ["equal", "faster"],
    "motion": ["straight", "right"],
}
COLLIDES = {("left", "equal", "right")}


def example(name: str) -> k.Object:
    """An example's job, small enough for any node."""
    job: k.Object = yaml.safe_load((EXAMPLES / name / "job.yaml").read_text())
    job["spec"]["spark"] = jobs.spark(1, 2)
    return jobs.patient(job)


def counts_of(status: k.Object) -> list[int]:
    return [status["cases"][each] for each in ("planned", "passed", "failed", "errored")]


def test_the_barrier_car_has_the_paper_s_verdict(namespace: str) -> None:
    job = example("barrier-car")
    job["spec"]["matrix"]["variables"] = SIX
    with jobs.applied(namespace, job) as name:
        status = jobs.ended(namespace, name, 300)["status"]
        assert (status["phase"], status["verdict"]) == ("Complete", "Failed"), status
        assert counts_of(status) == [6, 5, 1, 0]
        _, rows = k.results(namespace, status["results"])
    # The API server keeps no order of a map's keys.
    names = ("direction", "speed", "motion")
    failed = {
        tuple(row["values"][name] for name in names) for row in rows if row["outcome"] == "failed"
    }
    assert failed == COLLIDES
    for row in rows:
        (step,) = row["result"]["playback"]["steps"]
        assert (step["released"], step["answered"], step["no_output"]) == (100, 100, 0)


BAG = "pvc://recordings/pr2/joint_states.bag"
# The later scene first, and a second of the earlier one twice.
PIECES: list[dict[str, Any]] = [
    {"bag": BAG, "from": "12s", "to": "14s"},
    {"bag": BAG, "from": "1s", "to": "2s", "times": 2, "pause": "100ms"},
]


@pytest.mark.usefixtures("recordings")
def test_pieces_of_a_recording_are_played_as_one_case(namespace: str) -> None:
    job = example("recombined")
    job["spec"]["source"] = {"sequence": PIECES, "topics": ["/joint_states"]}
    del job["spec"]["matrix"]
    with jobs.applied(namespace, job) as name:
        status = jobs.ended(namespace, name, 400)["status"]
        assert (status["phase"], status["verdict"]) == ("Complete", "Passed"), status
        _, (row,) = k.results(namespace, status["results"])
    ledger = row["result"]["ledger"]
    # 100 a second, within a few: the recorder's own beat.
    assert ledger["sent"] == ledger["received"] == pytest.approx(400, abs=10)
    (step,) = row["result"]["playback"]["steps"]
    assert (step["answered"], step["no_output"]) == (ledger["sent"], 0)
    first, second, third = row["parts"]
    begin = first["window"][0]
    assert [part["at"] - begin for part in (first, second, third)] == [
        0, 2_100_000_000, 3_200_000_000,
    ]  # fmt: skip
    assert second["window"] == third["window"]
