"""Jobs of ROS 2 nodes over MCAP on the cluster.

At full speed nothing is lost, and lock-step records the same bytes each time, whichever player
plays. The client library of one image is the stand-in over Debian's Cyclone DDS, and of the other
the real rclpy over librcl and Fast DDS.
"""

from pathlib import Path
from typing import Any

import pytest

from tests import ros2_recording
from tests.e2e import jobs
from tests.e2e import kubectl as k

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("recordings")]

MESSAGES = 1000
STRING = "std_msgs/msg/String:10:reliable"
ON_DDS = {"ros2": {"player": "dds"}}
STEPS = [{"trigger": "/in", "answer": "/out", "deadline": "60s"}]
LOCKSTEP = {"mode": "lockstep", "steps": STEPS}
# In the image of the real rclpy.
ANSWERING = "/opt/nodes/answering.py"


def job(name: str, playback: dict[str, Any], **stack: Any) -> k.Object:
    """A node that answers each message of /in on /out, in four fragments."""
    subscription = f"/in:{ros2_recording.IMU}:10:reliable"
    topics = ["--sub", subscription, "--pub", f"/out:{STRING}", "--relay", "/in=/out"]
    spec = {
        "source": {
            "bags": ["pvc://recordings/ros2/drive.mcap"],
            "fragment": {"length": "1250ms"},
        },
        "stack": {
            "engine": "ros2",
            "image": "bagpipe.local/ros2-standin:0.2.0",
            "command": ["standin_node", "--name", "/relay", *topics],
        }
        | stack,
        "playback": playback | {"subscribeTimeout": "120s"},
        "record": {"topics": ["/out"]},
        "evaluate": [{"name": "answers", "presence": {"topic": "/out", "min": 240}}],
        "spark": jobs.spark(1, 2),
        "output": {"uri": "pvc://results/ros2"},
    }
    kind = {"apiVersion": "sim.bagpipe.io/v1alpha1", "kind": "SimulationJob"}
    return kind | {"metadata": {"name": name}, "spec": spec}


def passed(namespace: str, manifest: k.Object) -> dict[str, dict[str, Any]]:
    """The row of each case, with the digest of its recording, once the job has passed."""
    name = manifest["metadata"]["name"]
    with jobs.applied(namespace, manifest):
        ended = jobs.ended(namespace, name, 400)
        status = ended["status"]
        account = jobs.account(namespace, ended)
        assert (status["phase"], status.get("verdict")) == ("Complete", "Passed"), account
        _, rows = k.results(namespace, status["results"])
        assert sum(row["result"]["ledger"]["sent"] for row in rows) == MESSAGES
        for row in rows:
            path = "/" + status["results"].removeprefix("pvc://") + "/" + row["recorded"]
            row["digest"] = k.in_toolbox(namespace, "sha256sum", path).split()[0]
        return {row["case"]: row for row in rows}


def run(namespace: str, manifest: k.Object, player: str = "rcl") -> dict[str, str]:
    """The digest of each case's recording, once all have passed with every message called."""
    return digests(proved(passed(namespace, manifest), player))


def proved(
    rows: dict[str, dict[str, Any]], player: str = "rcl", strength: str = "called"
) -> dict[str, dict[str, Any]]:
    """The rows of cases, each of which has its own messages and answers and nobody else's."""
    for row in rows.values():
        ledger = row["result"]["ledger"]
        assert (ledger["received"], ledger["dropped"]) == (ledger["sent"], 0)
        assert (ledger["strength"], row["attempts"]) == (strength, 1)
        assert row["result"]["recorded"]["messages"] == ledger["sent"]
        assert row["result"]["player"]["name"] == player
    return rows


def digests(rows: dict[str, dict[str, Any]]) -> dict[str, str]:
    return {case: row["digest"] for case, row in rows.items()}


@pytest.fixture
def drive(namespace: str, tmp_path: Path) -> None:
    k.put(namespace, ros2_recording.write(tmp_path / "d", ["/in"], MESSAGES), "ros2/drive.mcap")


@pytest.mark.usefixtures("drive")
def test_lock_step_is_the_same_twice_by_either_player_and_full_speed_loses_nothing(
    namespace: str,
) -> None:
    once = run(namespace, job("ros2-lockstep-once", LOCKSTEP))
    assert len(once) == 4
    assert run(namespace, job("ros2-lockstep-again", LOCKSTEP)) == once
    assert run(namespace, job("ros2-lockstep-dds", LOCKSTEP, **ON_DDS), "dds") == once
    # Two pods side by side, which have the same domain.
    at_once = job("ros2-max", {"mode": "max"})
    at_once["spec"]["spark"] = jobs.spark(2, 1)
    rows = proved(passed(namespace, at_once))
    assert rows.keys() == once.keys()
    assert len({row["ran_on"]["host"] for row in rows.values()}) == 2


@pytest.mark.usefixtures("drive")
def test_nodes_of_the_real_rclpy_lose_nothing_at_full_speed_and_answer_all_in_lock_step(
    namespace: str,
) -> None:
    rclpy = {"image": "bagpipe.local/ros2-rclpy:0.2.0", "command": ["python3", ANSWERING]}
    rows = passed(namespace, job("rclpy-max", {"mode": "max"}, **rclpy))
    assert len(proved(rows, strength="taken")) == 4
    # The answer to each input is the end of its callback.
    assert len(proved(passed(namespace, job("rclpy-lockstep", LOCKSTEP, **rclpy)))) == 4


@pytest.mark.usefixtures("drive")
def test_a_stack_without_librcl_is_played_on_dds_and_passes_where_that_proof_is_allowed(
    namespace: str,
) -> None:
    command = ["dds_relay", "/in", "/out", "sensor_msgs/Imu"]
    hidden = [{"name": "LD_LIBRARY_PATH", "value": "/nowhere"}]
    manifest = job("ros2-dds", {"mode": "max"}, command=command, env=hidden, **ON_DDS)
    manifest["spec"]["faultPolicy"] = [{"cause": "DeliveryUnproved", "action": "allow"}]
    rows = passed(namespace, manifest)
    assert len(rows) == 4
    for row in rows.values():
        assert (row["outcome"], row["allowed"][0]["cause"]) == ("passed", "DeliveryUnproved")
        assert row["result"]["player"] == {"name": "dds", "why": "the job asks for it"}
        assert row["result"]["ledger"]["strength"] == "sent"
        assert row["result"]["recorded"]["messages"] == row["result"]["ledger"]["sent"]
