"""The published applications as jobs: localisation, obstacles, pedestrians, on real recordings."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from bagpipe.compare.compare import compare
from bagpipe.run.case_run import Row
from tests.integration.conftest import RunningAgent
from tests.integration.example_jobs import (
    EXAMPLES,
    SHARED,
    example,
    found_by_name,
    missing,
    run_all,
)
from tests.photographs import PORTRAIT, STREET, fetch

pytestmark = pytest.mark.integration

JACKAL, LUMINAR = "jackal_bz2.bag", "luminar_lz4.bag"
StartAgent = Callable[..., RunningAgent]


def outcomes(row: Row) -> dict[str, str]:
    return {name: found["outcome"] for name, found in found_by_name(row).items()}


def camera_bags(folder: Path) -> dict[str, Path]:
    """A bag of each photograph, made as the example's page says, by its name on the claim."""
    made = {}
    for name, photograph in (("portrait", PORTRAIT), ("street", STREET)):
        bag = folder / f"{name}.bag"
        command = [sys.executable, str(EXAMPLES / "pedestrians-node/camera_bag.py"), str(bag)]
        subprocess.run([*command, str(fetch()[photograph])], check=True, timeout=60)
        made[f"camera/{name}.bag"] = bag
    return made


def figure(row: Row, criterion: str) -> float:
    return float(found_by_name(row)[criterion]["figure"])


@pytest.mark.skipif(bool(missing(JACKAL)), reason=missing(JACKAL))
def test_the_tuned_filter_ends_where_the_recording_says_and_the_other_is_worse(
    tmp_path: Path, start_agent: StartAgent
) -> None:
    spec = example("localisation/job.yaml", tmp_path, {"jackal/jackal.bag": SHARED / JACKAL})
    rows = {row["variant"]: row for row in run_all(spec, tmp_path, start_agent())}
    tuned, trusting = rows["tuned"], rows["trusts-the-wheels"]
    assert (tuned["outcome"], trusting["outcome"]) == ("passed", "failed"), tuned["message"]
    assert set(outcomes(tuned).values()) == {"passed"}
    # Dead reckoning by the IMU's own attitude ends 0.018 m away, too; the wheels' own pose 20.9 m.
    assert figure(tuned, "ends where it must") == pytest.approx(0.0186, abs=0.0005)
    assert figure(trusting, "ends where it must") == pytest.approx(7.654, abs=0.01)
    for row in (tuned, trusting):
        assert figure(row, "answers every reading of the wheels") == 3060
        steps = {step["answer"]: step for step in row["result"]["playback"]["steps"]}
        assert steps["/attitude"]["answered"] == 3061
        assert row["result"]["ledger"]["dropped"] == 0
        usage = row["result"]["stack"]["usage"]
        assert 0 < usage["cpu_seconds"] < 2 * usage["seconds"]
        assert figure(row, "is cheap") == usage["peak_memory_bytes"] > 20 << 20
    (comparison,) = compare([tuned, trusting], ["tuned", "trusts-the-wheels"])
    assert comparison.verdict == "worse"
    assert [each["case"] for each in comparison.regressed] == [trusting["case"]]


@pytest.mark.skipif(bool(missing(LUMINAR)), reason=missing(LUMINAR))
def test_obstacles_are_found_in_every_scan_under_three_conditions(
    tmp_path: Path, start_agent: StartAgent
) -> None:
    recordings = {"luminar/luminar.bag": SHARED / LUMINAR}
    spec = example("obstacles-node/job.yaml", tmp_path, recordings)
    rows = run_all(spec, tmp_path, start_agent())
    assert [row["values"]["least"] for row in rows] == [15, 30, 300]
    assert [row["outcome"] for row in rows] == ["passed", "passed", "failed"]
    for row in rows:
        scans = figure(row, "answers the scans")
        assert scans in (4, 5)
        # From the first scan to the last it is 0.36 s.
        assert figure(row, "keeps up") == pytest.approx(scans / 0.361, rel=0.01)
        assert 0 < figure(row, "answers in time") < 20
        # The largest stands still beside the road, wherever a cluster begins to count.
        assert figure(row, "sees the largest beside the road") == pytest.approx(14.58, abs=0.01)
    unseen = {name for name, outcome in outcomes(rows[2]).items() if outcome == "failed"}
    assert unseen == {"sees some dozens of obstacles", "sees the car ahead on the left"}


def test_pedestrians_are_found_in_a_cameras_frames_and_only_where_they_walk(
    tmp_path: Path, start_agent: StartAgent
) -> None:
    bags = camera_bags(tmp_path)
    spec = example("pedestrians-node/job.yaml", tmp_path, bags)
    rows = {row["fragment"]: row for row in run_all(spec, tmp_path, start_agent())}
    portrait, street = rows["portrait-0000"], rows["street-0000"]
    assert (street["outcome"], portrait["outcome"]) == ("passed", "failed"), street["message"]
    assert set(outcomes(street).values()) == {"passed"}
    assert figure(street, "boxes reach down to the street") == pytest.approx(969, abs=5)
    assert figure(street, "is sure of the first") == pytest.approx(1.68, abs=0.02)
    assert figure(portrait, "answers every frame") == 10
    assert outcomes(portrait)["sees both who walk in front"] == "failed"
    # Nobody is found, so there is no box to judge: that is no answer, and never a pass.
    assert outcomes(portrait)["is sure of the first"] == "invalid"


def test_an_expected_failure_passes_where_nobody_walks(
    tmp_path: Path, start_agent: StartAgent
) -> None:
    spec = example("pedestrians-node/nobody.yaml", tmp_path, camera_bags(tmp_path))
    (row,) = run_all(spec, tmp_path, start_agent())
    assert row["outcome"] == "passed", row["message"]
    expected = found_by_name(row)["sees both who walk in front"]
    assert (expected["outcome"], expected["expected_failure"]) == ("passed", True)
    assert expected["message"].startswith("failed as expected")
    assert figure(row, "sees nobody") == 1.0
