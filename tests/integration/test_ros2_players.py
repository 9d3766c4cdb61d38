"""What plays ROS 2: the image's librcl, or DDS alone where there is none, and what each proves.

The stack is the stand-in's node, or a program of DDS without ROS 2 whose topics have ROS 2's names.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests import ros2_recording, ros2_standin
from tests.integration.conftest import RunningAgent
from tests.integration.test_ros2_jobs import (
    ALL,
    DEPTHS,
    LOCKSTEP,
    MESSAGES,
    digest,
    relay,
    run,
    spec,
)

pytestmark = pytest.mark.integration

ALLOWED = [{"cause": "DeliveryUnproved", "action": "allow"}]
MISSING = "librcl.so: cannot open shared object file"
# Whatever is sourced where the tests run.
WITHOUT_ROS = {"LD_LIBRARY_PATH": "/nowhere"}


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    return ros2_recording.claims(tmp_path, MESSAGES)


def without_ros(standin: Path, *name: str) -> list[str]:
    """A program of DDS that answers each message of /in on /out; `name`: as it announces itself."""
    package, _, kind = ros2_recording.IMU.split("/")
    return [str(standin / "dds_relay"), "/in", "/out", f"{package}/{kind}", *name]


def playing(player: str) -> dict[str, Any]:
    return {"stack": {"ros2": {"player": player}}}


@pytest.mark.parametrize("mode", ["max", "realtime"])
def test_on_dds_alone_nodes_that_count_are_proved_as_by_librcl(
    mode: str, folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    setup = ros2_standin.environment(standin)
    command = relay(standin, depth=DEPTHS[mode])
    job = spec(setup, {"mode": mode}, command, evaluate=ALL, **playing("dds"))
    row = run(job, folders, start_agent())
    assert (row["outcome"], row["attempts"]) == ("passed", 1), row
    ledger = row["result"]["ledger"]
    assert (ledger["sent"], ledger["received"], ledger["dropped"]) == (MESSAGES, MESSAGES, 0)
    assert ledger["strength"] == "called"
    assert row["result"]["recorded"]["messages"] == MESSAGES
    assert row["result"]["player"] == {"name": "dds", "why": "the job asks for it"}


def test_either_player_records_the_same_bytes(
    folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    agent = start_agent()
    setup, digests = ros2_standin.environment(standin), set()
    for player, chosen in [("auto", "rcl"), ("rcl", "rcl"), ("dds", "dds")]:
        command = relay(standin, "--use-sim-time")
        stack = {"parameters": {"/relay/use_sim_time": True}, "ros2": {"player": player}}
        row = run(spec(setup, LOCKSTEP, command, stack=stack), folders, agent)
        assert (row["outcome"], row["attempts"]) == ("passed", 1), row
        assert row["result"]["player"]["name"] == chosen
        digests.add(digest(row, folders))
    assert len(digests) == 1


@pytest.mark.parametrize(
    ("name", "node"), [((), "/unnamed_dds_participant_1"), (("16", "/ns/relay"), "/ns/relay")]
)
def test_without_librcl_dds_plays_and_proves_nothing_unless_the_job_allows_it(
    name: tuple[str, ...],
    node: str,
    folders: dict[str, str],
    standin: Path,
    start_agent: Callable[..., RunningAgent],
) -> None:
    agent = start_agent()
    command = without_ros(standin, *name)
    row = run(spec(WITHOUT_ROS, {"mode": "max"}, command, evaluate=ALL), folders, agent)
    assert (row["outcome"], row["reason"]) == ("invalid", "DeliveryUnproved"), row
    assert f"what {node} got on /in is proved no further than `sent`" in row["message"]
    player = row["result"]["player"]
    assert player["name"] == "dds"
    assert MISSING in player["why"]
    allowing = spec(WITHOUT_ROS, {"mode": "max"}, command, evaluate=ALL, faultPolicy=ALLOWED)
    row = run(allowing, folders, agent)
    assert (row["outcome"], row["allowed"][0]["cause"]) == ("passed", "DeliveryUnproved"), row
    assert row["result"]["recorded"]["messages"] == MESSAGES
    assert row["result"]["ledger"]["strength"] == "sent"


@pytest.mark.usefixtures("soon_given_up")
def test_who_asks_for_librcl_gets_no_other_player(
    folders: dict[str, str], standin: Path, start_agent: Callable[..., RunningAgent]
) -> None:
    job = spec(WITHOUT_ROS, {"mode": "max"}, without_ros(standin), **playing("rcl"))
    row = run(job, folders, start_agent())
    assert row["outcome"] == "errored", row
    assert MISSING in row["message"]
