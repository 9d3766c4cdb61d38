"""The paper's barrier car: an unmodified rospy planner drives every combination in lock-step."""

import hashlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from rosbags.rosbag1 import Reader

from bagpipe.run.case_run import Row, run_case
from tests.integration.conftest import RunningAgent
from tests.integration.drives import PATH, cases_of, context_of, spec_with

pytestmark = pytest.mark.integration

Start = Callable[..., RunningAgent]

# The planner looks ahead in its own lane only: who comes from beside or behind surprises it.
COLLIDES = {
    ("left", "equal", "right"),
    ("right", "equal", "left"),
    ("rear-left", "faster", "right"),
    ("rear-right", "faster", "left"),
    ("rear", "faster", "straight"),
}
STEPS = 100
FASTER_THAN_REAL_TIME = 20


def combination(row: Row) -> tuple[str, str, str]:
    values = row["values"]
    return values["direction"], values["speed"], values["motion"]


def test_the_verdict_finds_exactly_the_combinations_that_collide(
    tmp_path: Path, start_agent: Start
) -> None:
    spec = spec_with()
    context = context_of(spec, start_agent(slots=2, path=PATH), tmp_path)
    cases = cases_of(spec)
    assert len(cases) == 54
    with ThreadPoolExecutor(2) as pool:
        rows = list(pool.map(lambda case: run_case(case, context), cases))
    assert {row["outcome"] for row in rows} == {"passed", "failed"}, rows
    assert {combination(row) for row in rows if row["outcome"] == "failed"} == COLLIDES
    for row in rows:
        outcomes = {found["name"]: found["outcome"] for found in row["criteria"]}
        collided = combination(row) in COLLIDES
        assert outcomes["steers"] == "passed"
        assert outcomes["never collides"] == ("failed" if collided else "passed")
        assert outcomes["keeps away"] == ("failed" if collided else "passed")
        (step,) = row["result"]["playback"]["steps"]
        assert (step["released"], step["answered"], step["no_output"]) == (STEPS, STEPS, 0)
    rates = sorted(row["result"]["playback"]["achieved_rate"] for row in rows)
    print(f"faster than real time: {rates[0]:.0f} to {rates[-1]:.0f} times")


def test_two_runs_record_the_same_bytes_of_the_simulator_too(
    tmp_path: Path, start_agent: Start
) -> None:
    lidar = {"lidar": {"beams": 180, "every": 5}}
    spec = spec_with(lidar)
    context = context_of(spec, start_agent(path=PATH), tmp_path)
    case = cases_of(spec)[0]
    paths = []
    for _ in range(2):
        row = run_case(case, context)
        assert (row["outcome"], row["attempts"]) == ("passed", 1), row
        paths.append(tmp_path / "r" / row["recorded"])
    digests = {hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}
    assert len(digests) == 1
    with Reader(paths[0]) as bag:
        counts = {topic: found.msgcount for topic, found in bag.topics.items()}
    assert counts == {
        "/cmd": STEPS,
        "/ego/odom": STEPS,
        "/obstacles": STEPS,
        "/ego/collision": STEPS,
        "/points": STEPS // 5,
        "/scene": 1,
    }


@pytest.mark.alone
def test_one_core_is_at_least_twenty_times_as_fast_as_real_time(
    tmp_path: Path, start_agent: Start
) -> None:
    everywhere = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(everywhere)})
    try:
        spec = spec_with({"duration": "60s"})
        context = context_of(spec, start_agent(path=PATH), tmp_path)
        row = run_case(cases_of(spec)[0], context)
    finally:
        os.sched_setaffinity(0, everywhere)
    assert row["outcome"] in {"passed", "failed"}, row
    playback = row["result"]["playback"]
    print(f"60 s of the barrier scene in {playback['played_seconds']:.2f} s on one core:"
          f" {playback['achieved_rate']:.0f} times as fast as real time")  # fmt: skip
    assert playback["achieved_rate"] >= FASTER_THAN_REAL_TIME
