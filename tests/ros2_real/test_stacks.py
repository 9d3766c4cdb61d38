"""Stacks as people write them for ROS 2: launch files, containers, life cycles, other slots."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.integration.conftest import RunningAgent
from tests.ros2_real.conftest import MESSAGES
from tests.ros2_real.jobs import LOCKSTEP, NODE, PYTHON, Trial, ledger_of, passed
from tests.ros2_recording import BEGIN

LAUNCH = ["ros2", "launch", "bagpipe_nodes", "all.launch.py"]
# Fourteen programs beside the one whose answers are recorded.
MANY = """node() { ros2 run bagpipe_nodes node single Answering "$@" & }
for one in $(seq 14); do node --ros-args -r __node:=other_$one -r out:=/out_$one; done
node
wait"""
PARAMETERS = {"/front/answering/prefix": "p-", "/front/answering/gain": 2.0}


def test_a_launch_file_has_namespaces_remaps_parameters_and_components(trial: Trial) -> None:
    digests = set()
    for _ in range(2):
        row = trial.run(trial.spec(LAUNCH, LOCKSTEP, stack={"parameters": PARAMETERS}))
        assert passed(row), row
        assert ledger_of(row) == (MESSAGES, MESSAGES, 0, "called")
        texts = trial.texts(row)
        assert len(texts) == MESSAGES
        # Each of both hands on what it got with its length in front.
        assert texts[7].split()[2:] == [f"p-{BEGIN + 7 * 5_000_000}", "14.000000", "0"]
        digests.add(trial.digest(row))
    assert len(digests) == 1


def test_parameters_and_remaps_of_a_job_reach_the_node(trial: Trial) -> None:
    command = [*NODE, "single", "Answering", "--ros-args", "-r", "__ns:=/lane", "-r", "out:=/out"]
    stack = {
        "parameters": {"/lane/answering/prefix": "q-", "/lane/answering/copies": 2},
        "remap": {"/lane/in": "/in"},
    }
    row = trial.run(trial.spec(command, {"mode": "max"}, stack=stack))
    assert passed(row), row
    texts = trial.texts(row)
    assert len(texts) == 2 * MESSAGES
    assert all(text.startswith("q-") for text in texts)


def test_a_life_cycle_is_waited_for(trial: Trial) -> None:
    row = trial.run(trial.spec(["ros2", "run", "bagpipe_nodes", "lifecycle"], LOCKSTEP))
    assert passed(row), row
    assert len(trial.texts(row)) == MESSAGES


@pytest.mark.parametrize("deaf", [False, True])
def test_a_node_in_python_is_ended_even_if_it_is_deaf_to_sigint(trial: Trial, deaf: bool) -> None:
    command = [*PYTHON, "--ros-args", "-p", f"deaf:={str(deaf).lower()}"]
    began = time.monotonic()
    row = trial.run(trial.spec(command, {"mode": "max"}))
    assert passed(row), row
    assert time.monotonic() - began < 60


def test_a_stack_of_fifteen_programs_has_room(trial: Trial) -> None:
    """Humble's Cyclone DDS has places for ten on localhost, unless it is asked for more."""
    others = [f"/other_{number}" for number in range(1, 15)]
    row = trial.run(trial.spec(["bash", "-c", MANY], LOCKSTEP | {"waitFor": others}))
    assert passed(row), row
    assert ledger_of(row) == (MESSAGES, MESSAGES, 0, "called")


def test_two_slots_never_receive_from_each_other(
    folders: dict[str, str], start_agent: Callable[..., RunningAgent], rmw: str
) -> None:
    trial = Trial(folders, start_agent(2), rmw)
    specs = [
        trial.spec([*NODE, "single", "Answering", "--ros-args", "-p", f"prefix:={name}-"], LOCKSTEP)
        for name in ("a", "b", "a", "b")
    ]
    with ThreadPoolExecutor(2) as pool:
        rows = list(pool.map(trial.run_beside, specs))
    assert all(map(passed, rows)), rows
    for name, row in zip("abab", rows, strict=True):
        texts = trial.texts(row)
        assert (len(texts), {text[:2] for text in texts}) == (MESSAGES, {f"{name}-"})
    assert trial.digest(rows[0]) == trial.digest(rows[2]) != trial.digest(rows[1])
